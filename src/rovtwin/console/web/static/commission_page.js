/** A stage's page: what it is for, its attempts, their lines with the fixes, pictures, files. */
import {make} from '/static/canvas.js';
import {lasting} from '/static/clock.js';

const MARKS = {ok: 'ok', note: 'note', warning: 'warning', stop: 'NO-GO'};
const RANK = {stop: 0, warning: 1, ok: 2, note: 2};
const MAIN = {'certificate.html': 'Certificate', 'certificate.pdf': 'Certificate, PDF', 'bundle.zip': 'Bundle of the evidence'};

export const LEVEL = {passed: 'ok', go: 'ok', 'no-go': 'danger', 'cut off': 'warn', 'out of date': 'warn', 'to do': '', now: 'now'};

const address = (name, path) => `/commission/file?name=${encodeURIComponent(name)}&path=${encodeURIComponent(path)}`;
const base = path => path.replace(/^.*\//, '');
const size = bytes => (bytes < 1e3 ? `${bytes} B` : bytes < 1e6 ? `${Math.round(bytes / 1e3)} kB` : `${(bytes / 1e6).toFixed(1)} MB`);

/** A state as a chip: its word, and a colour that tells the same. */
export const chip = (state, word = state) => make('span', {class: 'commission-chip', 'data-level': LEVEL[state] ?? ''}, word);

function lines(checks) {
  const sorted = [...checks].sort((a, b) => RANK[a.verdict] - RANK[b.verdict]);
  return make('ul', {class: 'commission-checks', 'aria-label': 'What was found'}, ...sorted.map(one => make('li', {'data-verdict': one.verdict},
    make('b', {}, MARKS[one.verdict]), make('div', {}, make('strong', {}, one.what), ` ${one.text} `,
      ...(one.fix ? [make('em', {}, one.fix)] : [])))));
}

const isMain = file => MAIN[base(file.path)] && !file.path.includes('/bundle/');

/** Certificate and bundle, where there are any. */
function main(name, found) {
  const links = found.filter(isMain).map(file => make('a', {href: address(name, file.path), target: '_blank', rel: 'noopener',
    class: 'action commission-main-file'}, MAIN[base(file.path)]));
  return links.length ? [make('div', {class: 'line'}, ...links)] : [];
}

/** A line that a stage says: the picture that it names is shown, where it lies in the commissioning's folder. */
export function lineOf(name, folder, text) {
  const path = /\S+\.png$/.exec(text)?.[0];
  if (!path || !folder || !path.startsWith(`${folder}/`)) return make('li', {}, text);
  const inside = path.slice(folder.length + 1);
  return make('li', {}, make('img', {class: 'commission-shown', src: address(name, inside), alt: `Picture ${base(inside)}`}));
}

function files(name, found) {
  const pictures = found.filter(file => file.picture);
  const rest = found.filter(file => !isMain(file));
  const link = (file, ...inner) => make('a', {href: address(name, file.path), target: '_blank', rel: 'noopener'}, ...inner);
  return [
    ...(pictures.length ? [make('div', {class: 'commission-pictures'}, ...pictures.map(file => link(file,
      make('img', {src: address(name, file.path), alt: `Picture ${base(file.path)}`, loading: 'lazy'}))))] : []),
    ...(rest.length ? [make('details', {}, make('summary', {}, `Files (${rest.length})`),
      make('ul', {class: 'commission-files'}, ...rest.map(file => make('li', {}, link(file, file.path), ` ${size(file.bytes)}`))))] : []),
  ];
}

function attemptOf(name, one) {
  const began = new Date(one.began);
  const when = Number.isNaN(began.getTime()) ? one.began : began.toLocaleString([], {dateStyle: 'medium', timeStyle: 'short'});
  const took = one.seconds ? `, ${lasting(one.seconds)} of vehicle time` : '';
  return [
    make('p', {class: 'muted'}, chip(one.state), ` begun ${when}${took}, kept in ${one.folder}`),
    ...main(name, one.files),
    ...(one.checks.length ? [lines(one.checks)] : [make('p', {}, 'It ended before it had a page: what it measured until then is kept.')]),
    ...(one.skipped ? [make('p', {class: 'commission-skipped'}, make('strong', {}, 'Without it: '), one.skipped)] : []),
    ...files(name, one.files),
  ];
}

/** The page of a stage; `again` are buttons to do it; `now` is what is being done of it, null where nothing is. */
export function pageOf(name, stage, again, now) {
  const attempts = stage.attempts.slice(0, now?.attempts).reverse(); // without the one that is being made
  const body = make('div', {class: 'commission-attempt'});
  const show = i => body.replaceChildren(...attemptOf(name, attempts[i]));
  const head = [make('h2', {}, `${stage.number} ${stage.title} `, chip(now ? 'now' : stage.state)), make('p', {}, `${stage.purpose[0].toUpperCase()}${stage.purpose.slice(1)}`),
    ...(stage.moves ? [make('p', {class: 'muted'}, 'Thrusters may turn in it. It asks first, each time.')] : [])];
  if (now && attempts.length) {
    const last = attempts[0]; // or its no-go would look like that of now
    body.append(make('p', {class: 'muted'}, 'Its page comes when it has ended.'));
    body.append(make('details', {id: 'commission-before'}, make('summary', {}, `The attempt before: ${last.state}`), ...attemptOf(name, last)));
  } else if (attempts.length) show(0);
  else body.append(make('p', {class: 'muted'}, now ? 'Its page comes when it has ended.' : 'Not done yet.'));
  const choose = attempts.length > 1 && !now ? [make('label', {class: 'line'}, 'Attempt ',
    make('select', {id: 'commission-attempt', onchange: event => show(Number(event.target.value))},
      ...attempts.map((one, i) => make('option', {value: i}, `${one.number} (${one.state})`))))] : [];
  return [...head, make('div', {class: 'line'}, ...choose, ...again), body];
}
