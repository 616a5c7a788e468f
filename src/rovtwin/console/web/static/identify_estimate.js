/** What a test tells of the vehicle so far: parameters with their 95 % intervals beside those known before. */
import {make} from '/static/canvas.js';
import {toast} from '/static/page.js';

const INFORMED = 0.9;  // of the prior's width, below which the test says something
const NOTE = 'Quick estimate: the balance of forces along the smoothed path. It starts from what was known before and shows '
  + 'what the test tells; its intervals, widened for that, held the truth in nine of ten cases in simulated flights of '
  + 'test_mixed, fewer in the first half minute. Lags of thrusters and '
  + 'linear damping in roll and pitch are left out: smoothing falsifies them. Do not fly with it: make the full estimate.';

const digits = value => (Math.abs(value) >= 1000 || (value && Math.abs(value) < 1e-3) ? value.toExponential(1)
  : String(Number(value.toPrecision(3))));

/** A line for what was known, a bar for what is known now, a tick for the value; both on one scale. */
function bar(row) {
  const low = Math.min(row.low, row.prior_low);
  const span = Math.max(row.high, row.prior_high) - low || 1;
  const at = value => `${(100 * (value - low) / span).toFixed(1)}%`;
  const piece = (kind, from, to) => make('span', {class: kind, style: `left:${at(from)};width:${(100 * (to - from) / span).toFixed(1)}%`});
  return make('div', {class: 'identify-bar', role: 'img',
    'aria-label': `${digits(row.low)} to ${digits(row.high)}, before ${digits(row.prior_low)} to ${digits(row.prior_high)}`},
  piece('before', row.prior_low, row.prior_high), piece('now', row.low, row.high),
  make('span', {class: 'value', style: `left:${at(row.value)}`}));
}

function line(row) {
  const [, ...rest] = row.name.split('.');
  return make('tr', {class: row.ratio < INFORMED ? '' : 'uninformed'},
    make('th', {scope: 'row', title: row.name}, rest.join(' ').replaceAll('_', ' '),
      make('span', {class: 'muted'}, row.unit === '1' ? '' : ` ${row.unit}`)),
    make('td', {class: 'number'}, digits(row.value)),
    make('td', {class: 'number'}, `${digits(row.low)} – ${digits(row.high)}`),
    make('td', {}, bar(row)),
    make('td', {class: 'number muted'}, digits(row.prior)));
}

/** `element`, and `show(message)` that fills it. */
export function estimateOf() {
  const couplings = make('input', {type: 'checkbox', id: 'couplings'});
  const all = make('input', {type: 'checkbox', id: 'uninformed'});
  const words = make('p', {class: 'muted', role: 'status', id: 'estimated'}, 'Comes while the test is logged.');
  const body = make('tbody');
  const head = make('tr', {}, ...['Parameter', 'Now', '95 %', 'Now on before', 'Before'].map(text => make('th', {scope: 'col'}, text)));
  const table = make('div', {class: 'table identify-table', tabindex: 0, role: 'region', 'aria-label': 'Estimates'},
    make('table', {}, make('thead', {}, head), body));
  const command = make('code', {id: 'command', tabindex: 0});
  const copy = make('button', {class: 'action', 'aria-label': 'Copy the command', onclick: async () => {
    try {
      await navigator.clipboard.writeText(command.textContent);
      toast('copied');
    } catch {
      getSelection().selectAllChildren(command);
      toast('selected: copy it with Ctrl-C');
    }
  }}, 'Copy');
  const full = make('div', {class: 'identify-full', hidden: true},
    make('p', {class: 'muted'}, 'The full estimate, with all its remarks, takes minutes:'), command, copy);
  const element = make('div', {},
    make('h2', {}, 'Estimate so far'), make('p', {class: 'identify-note'}, NOTE), words,
    make('div', {class: 'line'}, make('label', {}, all, ' also what the test does not tell'), make('label', {}, couplings, ' couplings')),
    table, full);

  let rows = [];
  const fill = () => {
    const chosen = rows.filter(row => (all.checked || row.ratio < INFORMED) && (couplings.checked || !row.coupling));
    let family = '';
    body.replaceChildren(...chosen.flatMap(row => {
      const own = row.name.split('.')[0];
      const title = own === family ? [] : [make('tr', {}, make('th', {class: 'family', colspan: 5, scope: 'colgroup'}, own.replaceAll('_', ' ')))];
      family = own;
      return [...title, line(row)];
    }));
  };
  [couplings, all].forEach(one => one.addEventListener('change', fill));
  const show = found => {
    command.textContent = found.command;
    full.hidden = !found.final || found.busy;
    if (!found.estimate) {
      rows = [];
      words.textContent = found.seconds === undefined ? 'Comes while the test is logged.' : 'Being made; the first of a test takes up to a minute.';
    } else {
      rows = found.estimate.rows;
      words.textContent = `From ${found.estimate.seconds?.toFixed(0) ?? found.seconds.toFixed(0)} s of log: ${found.estimate.informed} of `
        + `${rows.length} parameters are known better than before. Made in ${found.estimate.took.toFixed(0)} s, in the background.`;
    }
    table.hidden = !rows.length;
    fill();
  };
  return {element, show};
}
