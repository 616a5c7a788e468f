/** The plan on the table: way-points as rows, templates, files, checks, submit and start. */
import {make, mount} from '/static/canvas.js';
import {clock, lasting} from '/static/clock.js';
import {faultsOf, pointsOf} from '/static/faults.js';
import {live} from '/static/live.js';
import {showReply, toast} from '/static/page.js';
import {angleOf, angleText, geodetic, onPlaces, placesAs, placesChoice} from '/static/places.js';
import {files} from '/static/plan_files.js';
import {arrival, going, thrustLeft} from '/static/rehearsal_words.js';

const COLUMNS = [
  ['x', 'North [m]', 0.1], ['y', 'East [m]', 0.1], ['depth', 'Depth [m]', 0.1], ['speed', 'Speed [m/s]', 0.05],
  ['hold_time', 'Hold [s]', 1], ['heading_deg', 'Heading [deg]', 5],
];
/** Of a place on the map: what a cell shows, and what is ordered when something is typed; null where it is no angle. */
const angle = key => ({
  text: row => angleText(geodetic(row)[key], key, 7),
  order: typed => (angleOf(typed, key) === null ? null : {[key]: angleOf(typed, key)}),
});
const ON_MAP = [['latitude', 'Latitude', null, angle('latitude')], ['longitude', 'Longitude', null, angle('longitude')]];
const columns = () => (placesAs() === 'm' ? COLUMNS : [...ON_MAP, ...COLUMNS.slice(2)]);
const EXAMPLE = 'found no angle; expected such as 63.45004, 63° 27.0027′ N or 63 27 00.2 N';
const STARTS = 'Start the submitted mission';
const RESUMES = 'Go on with the mission';
const NOT_PAUSED = 'No mission is paused';
const STALE = 'The plan was changed since it was submitted: Submit it, or Undo';
const BLANK = new Set(['heading_deg']);
const AT_ONCE = 30; // rows that have their fields from the beginning
const plan = order => showReply(live.send({do: 'plan', ...order}));
const rounded = value => (Number.isFinite(value) ? Number(value.toFixed(2)) : '');

function button(text, label, onclick, id) {
  return make('button', {class: 'action', 'aria-label': label, title: label, id, onclick}, text);
}

/** What typed text orders of a column; null where it is nothing. */
function ordered(text, [key, , , way]) {
  const empty = text.trim() === '';
  if (way && !empty && !way.order(text)) toast(EXAMPLE, 'danger');
  if (way) return empty ? null : way.order(text);
  return empty && !BLANK.has(key) ? null : {[key]: empty ? null : Number(text)};
}

function cell(row, i, column) {
  const [key, label, step, way] = column;
  const value = way ? way.text(row) : rounded(row[key]);
  const input = make('input', {type: way ? 'text' : 'number', step, value, 'aria-label': `${label} of way-point ${i + 1}`,
    placeholder: BLANK.has(key) ? 'leg' : '', class: way ? 'cell-input is-angle' : 'cell-input'});
  input.addEventListener('change', async () => {
    const order = ordered(input.value, column);
    const taken = order && await plan({op: 'edit', i, ...order});
    if (!taken) input.value = value; // what the plan has
  });
  return make('td', {}, input);
}

/**
 * Rows of way-points. The first ones have their fields at once, the others when they are about to be seen: five thousand
 * fields of a long plan took the browser 1.6 s, in which nothing could be pressed.
 */
class Rows {
  constructor(body) {
    this.body = body;
    this.watch = new IntersectionObserver(seen => this.#fill(seen.filter(one => one.isIntersecting).map(one => one.target)),
      {root: body.closest('.table'), rootMargin: '300px 0px'});
  }

  show(points) {
    this.watch.disconnect();
    this.points = points;
    this.body.replaceChildren(...points.map((point, i) => bare(point, i)));
    this.#fill([...this.body.children].slice(0, AT_ONCE));
    [...this.body.children].slice(AT_ONCE).forEach(line => this.watch.observe(line));
  }

  /** Scrolls to a way-point and puts the cursor there. */
  enter(i) {
    const line = this.body.children[i];
    this.#fill([line]);
    line.scrollIntoView({block: 'center'});
    line.querySelector('input').focus();
  }

  #fill(lines) {
    const may = editable();
    for (const line of lines.filter(one => one.children.length === 2)) {
      const i = Number(line.dataset.i);
      this.watch.unobserve(line);
      line.lastElementChild.replaceWith(...fields(this.points[i], i, this.points.length));
      line.querySelectorAll('button, input').forEach(one => { one.disabled = !may; });
    }
  }
}

const editable = () => Boolean(live.last.rights?.may) && !live.last.state?.replay;

/** A row without fields, as high as one with them. */
function bare({x, y, depth, speed}, i) {
  const text = `${rounded(x)}, ${rounded(y)}, ${rounded(depth)} m; ${rounded(speed)} m/s`;
  return make('tr', {'data-i': i}, make('th', {scope: 'row'}, String(i + 1)), make('td', {class: 'bare', colspan: COLUMNS.length + 1}, text));
}

function fields(point, i, count) {
  return [
    ...columns().map(column => cell(point, i, column)),
    make('td', {class: 'row-actions'},
      button('↑', `Move way-point ${i + 1} up`, () => i > 0 && plan({op: 'reorder', i, to: i - 1})),
      button('↓', `Move way-point ${i + 1} down`, () => i + 1 < count && plan({op: 'reorder', i, to: i + 1})),
      button('+', `Insert a way-point before ${i + 1}`, () => plan({op: 'insert', i, x: point.x, y: point.y})),
      button('×', `Delete way-point ${i + 1}`, () => plan({op: 'delete', i})))];
}

/** A row for a new way-point: what is typed is added at the end. */
function adding() {
  const asked = columns().slice(0, 3);
  const fields = asked.map(([key, label, step, way]) =>
    make('input', {type: way ? 'text' : 'number', step, id: `new-${key}`, 'aria-label': `New way-point: ${label}`, placeholder: label}));
  const add = async () => {
    const values = fields.map(field => field.value.trim());
    if (values[0] === '' || values[1] === '') {
      toast(`a way-point needs ${placesAs() === 'm' ? 'north and east' : 'latitude and longitude'}`, 'danger');
      return;
    }
    const orders = asked.map((column, k) => (values[k] === '' ? {} : ordered(values[k], column)));
    if (orders.includes(null) || !await plan(Object.assign({op: 'add'}, ...orders))) return;
    // What has been typed since the click is the next way-point's.
    if (fields.some((field, i) => field.value.trim() !== values[i])) return;
    fields[0].value = fields[1].value = '';
    fields[0].focus();
  };
  fields.forEach(field => field.addEventListener('keydown', event => { if (event.key === 'Enter') add(); }));
  return make('div', {class: 'line'}, ...fields, button('Add', 'Add this way-point', add, 'add'));
}

function summary(message) {
  const many = message.draft.length;
  const time = lasting(message.seconds);
  const along = many > 1 ? `, from the first to the last ${message.length.toFixed(1)} m, ${time} at these speeds` : '';
  const text = `${many} way-point${many === 1 ? '' : 's'}${along}`;
  const state = !message.submitted ? 'not submitted' : message.changed ? 'changed since it was submitted' : 'submitted';
  return `${text}; ${state}`;
}

/** What the checks say: a fault is a button that leads to its row. */
function checked(message, rows) {
  if (!message.draft.length) return [make('li', {class: 'note'}, 'Nothing to check: the plan is empty.')];
  if (live.last.state && !live.last.state.eta) return [make('li', {class: 'note'}, 'Not checked yet: no vehicle is connected.')];
  const wrong = message.checks.some(one => one.level === 'error'); // then nothing is right beside it
  return message.checks.filter(one => !wrong || !['ok', 'note'].includes(one.level)).map(one => {
    const [first] = pointsOf(one);
    const item = make('li', {class: one.level}, one.what);
    if (first === undefined || first >= message.draft.length) return item;
    const label = `Go to way-point ${first + 1}`;
    item.append(' ', make('button', {class: 'action to-row', 'aria-label': label, onclick: () => rows.enter(first)}, `→ ${first + 1}`));
    return item;
  });
}

/** When each way-point is reached by the rehearsal, under its number. */
function showArrivals(body) {
  const points = live.last.rehearsing?.stale ? [] : live.last.rehearsal?.points ?? [];
  for (const line of body.children) {
    const point = points[Number(line.dataset.i)];
    const head = line.firstElementChild;
    head.querySelector('small')?.remove();
    if (!point) continue;
    const title = `rehearsed: reached at ${arrival(point)}, thrust left ${thrustLeft(point)}`;
    head.append(make('small', {title}, clock(point.reached)));
  }
}

/** Rehearse, whether it is repeated, and how far it is. */
function rehearsing() {
  const begin = button('Rehearse', 'Fly the plan on the twin, before it is flown', () => showReply(live.send({do: 'rehearse', op: 'now'})), 'rehearse');
  const again = make('input', {type: 'checkbox', id: 'rehearse-again', checked: true});
  again.addEventListener('change', () => showReply(live.send({do: 'rehearse', op: 'again', on: again.checked})));
  const say = make('span', {class: 'muted rehearsing', role: 'status'});
  const show = message => {
    again.checked = message.again;
    const text = going(message);
    if (say.textContent !== text) say.textContent = text;
  };
  const repeated = make('label', {title: 'Again whenever plan, current or sea change'}, again, ' repeat');
  return {element: make('div', {class: 'line'}, begin, repeated, say), show};
}

/** Marks the rows of way-points that have faults. */
function markRows(body, checks) {
  const faults = faultsOf(checks);
  for (const line of body.children) {
    const fault = faults.get(Number(line.dataset.i));
    line.className = fault?.level ?? '';
    line.title = fault?.what ?? '';
    const head = line.firstElementChild;
    head.setAttribute('aria-label', fault ? `${line.dataset.i * 1 + 1}: ${fault.what}` : String(line.dataset.i * 1 + 1));
  }
}

mount('plan', section => {
  const body = make('tbody');
  const head = make('tr');
  const table = make('div', {class: 'table', tabindex: 0, role: 'region', 'aria-label': 'Way-points'},
    make('table', {}, make('thead', {}, head), body));
  const titled = () => {
    table.classList.toggle('is-on-map', placesAs() !== 'm');
    head.replaceChildren(make('th', {scope: 'col'}, '#'),
      ...columns().map(([, label]) => make('th', {scope: 'col'}, label)), make('th', {scope: 'col'}, make('span', {class: 'unseen'}, 'Actions')));
  };
  titled();
  const lines = new Rows(body);
  const undo = button('Undo', 'Undo the last change', () => plan({op: 'undo'}));
  const redo = button('Redo', 'Redo what was undone', () => plan({op: 'redo'}));
  const cancel = button('Cancel last', 'Take the last way-point away', () => plan({op: 'cancel_last'}), 'cancel-last');
  const clear = button('Clear', 'Take all way-points away', () => plan({op: 'clear'}), 'clear');
  const square = button('Square', 'A square from where the vehicle is', () => plan({op: 'template', name: 'square',
    depth: rounded(Math.max(0, live.last.state?.eta?.[2] ?? 1)), side: 4}));
  const say = make('p', {class: 'muted', id: 'plan-summary', role: 'status'});
  const checks = make('ul', {class: 'checks', 'aria-label': 'Checks of the plan'});
  const submit = button('Submit', 'Submit the plan to the autopilot', () => plan({op: 'submit'}), 'submit');
  const order = (text, label, what, id) => button(text, label, () => showReply(live.send({do: what})), id);
  const start = order('Start', STARTS, 'start', 'start');
  const pause = order('Pause', 'Pause the mission and stay', 'pause', 'pause');
  const resume = order('Resume', RESUMES, 'resume', 'resume');
  const hold = order('Hold', 'Stay here', 'hold', 'hold');
  const abort = order('Abort', 'Abort: thrusters off', 'abort', 'abort');
  let newest = adding();
  const places = placesChoice();
  const rehearsal = rehearsing();
  section.append(newest, make('div', {class: 'line'}, cancel, undo, redo, clear, square, ...files(plan), places.element), table, say, checks, rehearsal.element,
    make('div', {class: 'line'}, submit, start, pause, resume, hold, abort));

  table.addEventListener('keydown', event => { // on a row, not in what is typed there
    const line = event.target.closest('tr[data-i]');
    if (event.key !== 'Delete' || !line || event.target.matches('input') || !live.last.rights?.may) return;
    event.preventDefault();
    plan({op: 'delete', i: Number(line.dataset.i)});
  });

  const able = () => {
    const {state} = live.last;
    const may = editable();
    section.querySelectorAll('button:not(.to-row, .is-open), input').forEach(one => { one.disabled = !may; });
    const message = live.last.plan;
    undo.disabled ||= !message?.undo;
    redo.disabled ||= !message?.redo;
    cancel.disabled ||= !message?.draft.length;
    const stale = message?.submitted && message.changed;
    start.disabled ||= !state?.armed || !message?.submitted || stale;
    start.title = stale ? STALE : STARTS;
    [pause, resume, hold, abort].forEach(one => { one.disabled ||= !state?.armed; });
    resume.disabled ||= !state?.resumable;
    resume.title = state?.resumable ? RESUMES : NOT_PAUSED;
  };
  let shown = '';
  const release = [
    live.on('plan', message => {
      const rows = JSON.stringify(message.draft);
      if (rows !== shown) {
        shown = rows;
        lines.show(message.draft);
      }
      say.textContent = summary(message);
      checks.replaceChildren(...checked(message, lines));
      markRows(body, message.checks);
      showArrivals(body);
      able();
    }),
    live.on('rehearsal', () => showArrivals(body)),
    live.on('rehearsing', message => { rehearsal.show(message); showArrivals(body); }),
    live.on('rights', able),
    places.release,
    onPlaces(() => { // written in another way: everything that holds a place
      const line = adding();
      newest.replaceWith(line);
      newest = line;
      titled();
      if (live.last.plan) lines.show(live.last.plan.draft);
      if (live.last.plan) markRows(body, live.last.plan.checks);
      showArrivals(body);
      able();
    }),
  ];
  let before = '';
  let hasEta = Boolean(live.last.state?.eta);
  release.push(live.on('state', state => {
    if (Boolean(state.eta) !== hasEta) {
      hasEta = Boolean(state.eta);
      if (live.last.plan) checks.replaceChildren(...checked(live.last.plan, lines));
    }
    const now = `${state.armed}${state.phase}${state.submitted}${state.resumable}`;
    if (now !== before) { before = now; able(); }
  }));
  return () => { lines.watch.disconnect(); release.forEach(one => one()); };
});
