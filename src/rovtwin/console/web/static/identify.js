/** An identification test: what to do now, its manoeuvres, the quality of its log, and what it tells so far. */
import {make, mount} from '/static/canvas.js';
import {lasting} from '/static/clock.js';
import {estimateOf} from '/static/identify_estimate.js';
import {live} from '/static/live.js';
import {showReply} from '/static/page.js';

const VERDICTS = {
  early: ['muted', 'too short to judge: 10 s are needed'], good: ['ok', 'nothing wrong so far'],
  warning: ['warn', 'look at it'], error: ['danger', 'it cannot be what it says: do not use it so'],
};

function button(text, label, what, id) {
  return make('button', {class: 'action wide', id, 'aria-label': label, onclick: () => showReply(live.send({do: what}))}, text);
}

/** The manoeuvres, each with a bar that fills. */
function manoeuvres(test) {
  const rows = test.manoeuvres.map((one, i) => make('li', {},
    make('span', {class: 'identify-what'}, `${i + 1}. ${one.what}`),
    make('span', {class: 'muted'}, lasting(one.end - one.start)),
    make('progress', {max: one.end - one.start, value: 0, 'aria-label': `Progress of ${one.what}`})));
  const show = experiment => test.manoeuvres.forEach((one, i) => {
    const now = experiment.running && experiment.manoeuvre === i;
    rows[i].querySelector('progress').value = Math.max(0, Math.min(experiment.t - one.start, one.end - one.start));
    if (now) rows[i].setAttribute('aria-current', 'step');
    else rows[i].removeAttribute('aria-current');
  });
  return [make('ol', {class: 'identify-list', 'aria-label': 'Manoeuvres'}, ...rows), show];
}

/** Rates and gaps, and what the checks found. */
function quality(box, found) {
  const [level, words] = VERDICTS[found.verdict];
  const signals = found.signals.map(one => `${one.name} ${one.rate.toFixed(0)} Hz`
    + (one.longest > Math.max(0.5, 8 / one.rate) ? ` (gap of ${one.longest.toFixed(1)} s)` : ''));
  const lines = found.findings.map(one => make('li', {class: one.severity}, `${one.where}: ${one.message} ${one.fix}`));
  box.replaceChildren(
    make('p', {class: `identify-verdict ${level}`}, words),
    make('p', {class: 'muted'}, signals.join(', ')),
    make('ul', {class: 'checks', 'aria-label': 'What the checks found'}, ...lines));
  if (found.not_pushed.length) box.append(make('p', {class: 'muted'}, `Not pushed so far: ${found.not_pushed.join(', ')}.`));
}

mount('identify', section => {
  const cue = make('div', {class: 'identify-cue', role: 'status', 'aria-live': 'assertive', id: 'cue'}, '–');
  const left = make('p', {class: 'muted', id: 'cue-left'});
  const start = button('Start', 'Start the test from its beginning', 'start', 'start');
  const abort = button('Abort', 'Abort the test: thrusters off', 'abort', 'abort');
  const plan = make('div');
  const log = make('div', {id: 'quality'}, make('p', {class: 'muted'}, 'No test was flown yet.'));
  const head = make('p', {class: 'muted', role: 'status', id: 'assessed'});
  const estimate = estimateOf();
  section.append(cue, left, make('div', {class: 'identify-orders'}, start, abort), plan,
    make('h2', {}, 'Quality of the log'), head, log, estimate.element);

  let built = '';
  let show = null;
  const able = () => {
    const [state, rights] = [live.last.state, live.last.rights];
    const may = !!rights?.may && !state?.replay && !!state?.armed;
    start.disabled = !may || state.experiment?.running;
    abort.disabled = !may || !state.experiment?.running;
  };
  const release = [
    live.on('setup', setup => {
      const key = JSON.stringify(setup.test);
      if (!setup.test || key === built) return;
      built = key;
      const [list, shown] = manoeuvres(setup.test);
      show = shown;
      plan.replaceChildren(make('h2', {}, `${setup.test.name}, ${lasting(setup.test.duration)}`),
        make('p', {class: 'muted'}, setup.test.description), list,
        ...setup.test.by_hand.map(what => make('p', {class: 'identify-hand'}, what)));
    }),
    live.on('state', state => {
      const experiment = state.experiment;
      if (!experiment) return;
      if (cue.textContent !== experiment.cue) cue.textContent = experiment.cue;
      cue.classList.toggle('hand', experiment.hand);
      const text = experiment.running ? `${experiment.what}: ${lasting(experiment.remaining)} left, `
        + `${lasting(experiment.duration - experiment.t)} of the test` : '';
      if (left.textContent !== text) left.textContent = text;
      show?.(experiment);
      able();
    }),
    live.on('rights', able),
    live.on('identify', found => {
      head.textContent = found.error || (found.seconds === undefined ? 'looking at the log …'
        : `${lasting(found.seconds)} of ${found.folder}${found.busy ? ' … looking again' : found.final ? ', the whole log' : ''}`);
      if (found.quality) quality(log, found.quality);
      estimate.show(found);
    }),
  ];
  return () => release.forEach(one => one());
});
