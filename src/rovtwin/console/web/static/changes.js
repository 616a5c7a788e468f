/** What has changed of the vehicle, as the monitor beside the autopilot finds it: value and width, beside the least and most it may be. */
import {live} from '/static/live.js';
import {make, mount} from '/static/canvas.js';

const LEAST = {'%': 20, N: 2, mm: 5}; // half of a bar's length at least, by unit: what is small looks small
const EXPLAINED = 'After ± stands one standard deviation; bars are two wide, 0 in the middle is the vehicle as it was. '
  + 'Grey: not learnt in this flight yet.';

let view = null;
let message = null;

/** Largest value that bars of a unit reach, from the rows that tell something of their own. */
export function spans(rows) {
  const found = {...LEAST};
  for (const {unit, interval, learnt, mirrors} of rows) {
    if (learnt && !mirrors) found[unit] = Math.max(found[unit] ?? 0, Math.abs(interval[0]), Math.abs(interval[2]));
  }
  return found;
}

function bar({interval, unit}, span) {
  const at = value => 50 + 47 * Math.max(-1, Math.min(1, value / span));
  const [low, middle, high] = interval.map(value => at(value ?? 0));
  return make('div', {class: 'changes-bar', role: 'img', 'aria-label': `${interval.map(v => v?.toFixed(1)).join(', ')} ${unit}: least, value, most`},
    make('i', {class: 'zero'}), make('i', {class: 'width', style: `left:${low}%;width:${high - low}%`}),
    make('i', {class: 'value', style: `left:${middle}%`}));
}

function line(row, span) {
  const image = row.mirrors && !row.changed;
  const mark = image ? 'mirror' : row.learnt ? '' : 'not known';
  const title = image ? `Only the mirror image of ${row.mirrors}: one that got weaker is likelier than one that got stronger` : null;
  return make('tr', {class: row.changed ? 'changed' : row.learnt && !image ? '' : 'unknown', title},
    make('th', {scope: 'row'}, row.changed ? row.words : row.short), make('td', {class: 'figures'}, row.figures.replace('-', '\u2212')),
    make('td', {}, bar(row, span)), make('td', {class: 'changes-mark'}, mark));
}

/** Rows by the heading that they stand under; what has changed comes first. */
function grouped(rows) {
  const found = new Map();
  for (const row of [...rows.filter(one => one.changed), ...rows.filter(one => !one.changed)]) {
    const title = row.changed ? 'Changed beyond chance' : row.group;
    found.set(title, [...(found.get(title) ?? []), row]);
  }
  return found;
}

class View {
  constructor(element) {
    this.note = make('p', {class: 'changes-note', role: 'status'});
    this.words = make('div', {class: 'changes-words'});
    this.more = make('input', {type: 'checkbox', id: 'changes-more'});
    this.more.addEventListener('change', () => this.show());
    this.body = make('tbody');
    this.table = make('div', {class: 'changes-table', tabindex: 0, role: 'region', 'aria-label': 'Changes of the vehicle'},
      make('table', {}, this.body));
    this.rest = make('div', {class: 'changes-rest'},
      make('label', {}, this.more, ' also force, added mass and stability'), make('p', {class: 'muted'}, EXPLAINED));
    element.replaceChildren(this.note, this.words, this.table, this.rest);
    this.show();
  }

  show() {
    const {rows = [], note = 'Comes with the vehicle.', against, vehicle, causes = [], doubts = [], watched} = message ?? {};
    this.note.textContent = note;
    this.words.replaceChildren(
      ...doubts.map(text => make('p', {class: 'doubt'}, `Not to be relied on: ${text}.`)),
      ...causes.map(text => make('p', {class: 'cause'}, text)),
      ...(watched && !against ? [make('p', {class: 'muted'}, `Against the description of ${vehicle}, which was not identified: `
        + 'differences may be its own errors, and none is called a change.')] : []),
      ...(watched && against ? [make('p', {class: 'muted'}, `Since ${against}.`)] : []));
    this.table.hidden = this.rest.hidden = !rows.length;
    const reach = spans(rows);
    const shown = rows.filter(row => this.more.checked || row.changed || !row.seldom);
    this.body.replaceChildren(...[...grouped(shown)].flatMap(([title, own]) => [
      make('tr', {}, make('th', {class: 'group', colspan: 4, scope: 'colgroup'}, title)), ...own.map(row => line(row, reach[row.unit]))]));
  }
}

/** The tab tells that there is something to see in it. */
function mark(element) {
  const panel = element.closest('[role=tabpanel]');
  const tab = panel && document.querySelector(`[aria-controls="${panel.id}"]`);
  tab?.classList.toggle('has-changes', (message?.rows ?? []).some(row => row.changed));
}

mount('changes', element => {
  view = new View(element);
  view.element = element;
  mark(element);
  return () => { view = null; };
});

live.on('watch', now => {
  // Once a second, mostly the same: the table is made anew where something of it is another.
  const same = message && JSON.stringify({...now, seconds: 0, note: ''}) === JSON.stringify({...message, seconds: 0, note: ''});
  message = now;
  if (!view) return;
  if (same) view.note.textContent = now.note;
  else view.show();
  mark(view.element);
});
