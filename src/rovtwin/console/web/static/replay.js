/** The time line of a replay: a slider with what happened on it, play, pace and steps; keys do the same. */
import {make, mount} from '/static/canvas.js';
import {live} from '/static/live.js';
import {toast} from '/static/page.js';

const PACES = [0.5, 1, 2, 5, 10, 20];
const STEP = 1; // of an arrow key [s]
const LEAP = 10; // of an arrow key with shift [s]
const NEAR = 0.05; // a mark that is no farther away than this is where we are [s]

let target = null; // time that was asked for last and is not on its way yet [s]
let asking = false;

const clock = t => `${Math.floor(t / 60)}:${(t % 60).toFixed(1).padStart(4, '0')}`;
const order = message => live.send(message).catch(error => toast(error.message, 'danger'));
const range = () => live.last.setup?.range ?? [0, 0];
const now = () => target ?? live.last.state?.t ?? range()[0];

/** Goes to a time; while one is on its way only the newest target counts. */
async function seek(t) {
  const [start, end] = range();
  target = Math.min(Math.max(t, start), end);
  if (asking) return;
  asking = true;
  while (target !== null) {
    const to = target;
    await order({do: 'seek', t: to});
    if (target === to) target = null;
  }
  asking = false;
}

const play = () => order({do: 'play', running: !live.last.state?.running});
const sample = by => order({do: 'step', by});

/** To the next thing that happened, or the one before. */
function hop(way) {
  const times = (live.last.marks?.marks ?? []).map(mark => mark.t);
  const found = way > 0 ? times.find(t => t > now() + NEAR) : times.findLast(t => t < now() - NEAR);
  seek(found ?? range()[way > 0 ? 1 : 0]);
}

function tools() {
  const button = (text, label, onclick, id) => make('button', {class: 'action', type: 'button', 'aria-label': label, title: label, onclick, id}, text);
  const pace = make('select', {id: 'pace', 'aria-label': 'Pace of the replay'}, ...PACES.map(value => make('option', {value}, `×${value}`)));
  pace.value = '1';
  pace.addEventListener('change', () => { order({do: 'play', speed: Number(pace.value)}); pace.blur(); });
  const run = button('Play', 'Play or pause (space)', play, 'play');
  const timeLabel = make('output', {id: 'replay-time', 'aria-label': 'Time in the run'});
  return {run, pace, timeLabel, all: [
    button('|◂', 'To what happened before', () => hop(-1), 'hop-back'), button('◂', 'One sample back (comma)', () => sample(-1), 'step-back'), run,
    button('▸', 'One sample on (full stop)', () => sample(1), 'step-on'), button('▸|', 'To what happened next', () => hop(1), 'hop-on'), pace, timeLabel,
  ]};
}

function marked(mark, [start, end]) {
  const label = `${clock(mark.t)} ${mark.text}`;
  return make('button', {class: `mark ${mark.mark} ${mark.level}`, type: 'button', tabindex: -1, title: label, 'aria-label': label,
    style: `left: ${100 * (mark.t - start) / Math.max(end - start, 1e-9)}%`, onclick: () => seek(mark.t)});
}

mount('timeline', element => {
  const {run, pace, timeLabel, all} = tools();
  const slider = make('input', {type: 'range', id: 'scrub', step: 'any', min: 0, max: 1, value: 0, 'aria-label': 'Time in the run'});
  const marks = make('div', {class: 'marks', role: 'group', 'aria-label': 'What happened'});
  slider.addEventListener('input', () => seek(Number(slider.value)));
  element.append(make('div', {class: 'line'}, ...all), make('div', {class: 'scale'}, slider, marks));
  const release = [
    live.on('setup', ({range: [start, end]}) => Object.assign(slider, {min: start, max: end})),
    live.on('marks', message => marks.replaceChildren(...message.marks.map(mark => marked(mark, range())))),
    live.on('state', state => {
      if (target === null) slider.value = state.t;
      slider.setAttribute('aria-valuetext', clock(state.t));
      timeLabel.textContent = `${clock(state.t)} of ${clock(range()[1])}`;
      run.textContent = state.running ? 'Pause' : 'Play';
      if (document.activeElement !== pace) pace.value = String(state.speed);
    }),
  ];
  return () => release.forEach(one => one());
});

/** Whether keys belong to what has the focus. */
const busy = element => element.closest?.('input:not([type=range]), select, textarea, [role=tab], [role=menu], canvas:focus-visible, summary');

document.addEventListener('keydown', event => {
  if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || busy(event.target)) return;
  const by = event.shiftKey ? LEAP : STEP;
  const act = {
    ArrowLeft: () => seek(now() - by), ArrowRight: () => seek(now() + by), ',': () => sample(-1), '.': () => sample(1),
    Home: () => seek(range()[0]), End: () => seek(range()[1]), ' ': event.target.closest('button, a') ? null : play,
  }[event.key];
  if (!act) return;
  event.preventDefault();
  act();
});

document.addEventListener('click', event => {
  if (event.detail) event.target.closest?.('button')?.blur(); // what a hand has clicked does not keep the keys
  const row = event.target.closest?.('#events li');
  if (row) seek(Number(row.dataset.t));
});
