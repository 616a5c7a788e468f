/** What is always visible: STOP, and whether, how and where the vehicle flies. */
import {make, mount} from '/static/canvas.js';
import {clock} from '/static/clock.js';
import {showAlerts} from '/static/alerts.js';
import {live} from '/static/live.js';
import {ofKind, onMission} from '/static/hud_words.js';
import {help, pressStop, showReply, theme} from '/static/page.js';

const STALE = 500;  // a state older than this is no news [ms]
const chi = 2.4477;  // radius of 95 % of a round Gaussian, over its sigma
const LOUD = {aborted: 'danger', surfacing: 'danger', held: 'warn', returning: 'warn', surfaced: 'warn', paused: 'warn'};
const STAGES = {lent: 'in use'}; // by a commissioning
const WINDOW = 4;  // over which the speed that is reached is looked at [s]
const past = []; // {now [ms], t [s], speed} of states in that window
let question = null; // {who, box}: who asks for control
const number = (value, digits) => (Number.isFinite(value) ? value.toFixed(digits) : '–');

function fact(label, id) {
  const value = make('span', {class: 'value', id: `fact-${id}`}, '–');
  const box = make('div', {class: 'fact', title: label}, make('span', {class: 'label'}, label), value);
  return [box, (text, level = '') => {
    if (value.textContent !== text) {
      value.textContent = text;
      box.title = `${label}: ${text}`; // where the line has no room for all of it
    }
    if (value.dataset.level !== level) value.dataset.level = level;
  }];
}

/** What the innovations say of the filter. A value now and then beyond the 95 % band is chance: 1.3 times it is not. */
function worst(nis) {
  let level = '';
  let text = 'consistent';
  for (const [name, found] of Object.entries(nis || {})) {
    const [value, , low, high] = found;
    if (value > 1.3 * high && !level) [level, text] = ['warn', `${name} off ${value.toFixed(1)}×`];
    if (value > 3 * high) [level, text] = ['danger', `${name} off ${value.toFixed(1)}×`];
    if (value < low && !level && name === 'position') text = 'cautious';
  }
  return [text, level];
}

/** Of the values that are known; `of` is Math.min or Math.max. NaN where none was. */
function most(of, values) {
  const finite = values.filter(Number.isFinite);
  return finite.length ? of(...finite) : NaN;
}

mount('stop', button => {
  button.textContent = 'STOP';
  const press = pressStop;
  button.addEventListener('pointerdown', press);
  button.addEventListener('click', event => { if (event.detail === 0) press(); });  // by speech or a screen reader
  button.addEventListener('keydown', event => { if (event.key === 'Enter' || event.key === ' ') press(); });
  return () => {};
});

mount('bar', bar => {
  const facts = {};
  for (const [id, label] of [
    ['link', 'Link'], ['arm', 'Thrusters'], ['phase', 'Mode'], ['age', 'Link age'], ['battery', 'Battery'],
    ['leak', 'Leak'], ['position', 'Position ±'], ['nis', 'Filter'], ['progress', 'Mission'], ['time', 'Time'],
    ['control', 'Control'],
  ]) {
    const [box, set] = fact(label, id);
    facts[id] = set;
    bar.append(box);
  }
  const arm = make('button', {id: 'arm', class: 'action', disabled: true, onclick: () => showReply(live.send({do: armOrder()}))}, 'Arm');
  const control = make('button', {id: 'take', class: 'action', onclick: takeControl}, 'Take control');
  const sun = make('button', {class: 'action', 'aria-label': 'Dark or daylight colours', title: 'Dark or daylight colours',
    onclick: () => theme(!document.body.classList.contains('daylight'))}, '◐');
  const keys = make('button', {class: 'action', 'aria-label': 'Keys', title: 'Keys (?)', onclick: help}, '?');
  bar.append(make('div', {class: 'actions'}, arm, control, keys, sun));

  const release = [
    live.on('state', state => show(facts, state, arm)),
    live.on('rights', rights => {
      const who = rights.may ? 'you' : rights.in_control || 'nobody';
      facts.control(rights.watchers > 1 ? `${who}, ${rights.watchers} watch` : who, rights.may ? 'ok' : 'warn');
      control.textContent = rights.may ? 'Give control' : rights.in_control ? 'Ask for control' : 'Take control';
      control.hidden = rights.may && !rights.asked && rights.watchers < 2;
      asked(rights.may ? rights.asked : null);
    }),
  ];
  const timer = setInterval(() => connection(facts), 200);
  return () => { release.forEach(one => one()); clearInterval(timer); asked(null); };
});

function armOrder() {
  const state = live.last.state;
  if (state?.stage === 'lost') return 'reconnect';
  return state?.armed ? 'disarm' : 'arm';
}

/** Asks whether `who` may have control, for as long as they want it; null takes the question away. */
function asked(who) {
  if (who === (question?.who ?? null)) return;
  question?.box.remove();
  question = null;
  if (who === null) return;
  const answer = order => showReply(live.send({do: order}));
  const box = make('div', {class: 'toast', role: 'alertdialog', 'aria-label': `${who} asks for control`},
    `${who} asks for control `,
    make('button', {class: 'action', onclick: () => answer('give')}, 'Give'),
    make('button', {class: 'action', onclick: () => answer('refuse')}, 'Keep'));
  document.body.append(box);
  question = {who, box};
}

function takeControl() { showReply(live.send({do: live.last.rights?.may ? 'give' : 'take'})); }

function connection(facts) {
  const old = performance.now() - live.receivedAt > STALE && !live.last.state?.replay; // which may be paused
  if (!live.connected) facts.link(live.why || 'no server', 'danger');
  else if (!live.last.state) facts.link('starting', 'warn');
  else if (live.hung) facts.link('autopilot silent', 'danger');
  else if (old) facts.link('stale', 'danger');
  document.body.classList.toggle('stale', old || !live.connected);
}

function show(facts, state, arm) {
  const ready = state.stage === 'ready' || state.stage === 'replay';
  facts.link(ready ? state.link : STAGES[state.stage] ?? state.stage, ready ? 'ok' : 'warn'); // what is done until then stands below the bar
  facts.arm(state.stopped ? 'STOPPED' : state.armed ? 'armed' : state.arming ? 'arming …' : 'off',
    state.stopped ? 'danger' : state.armed ? 'warn' : '');
  const lost = state.stage === 'lost';
  arm.textContent = lost ? 'Reconnect' : state.armed ? 'Disarm' : 'Arm';
  arm.disabled = !live.last.rights?.may || !(ready || lost) || state.arming || !!state.replay;
  showAlerts(state.alerts);
  const asked = state.running ? (state.speed === 1 ? '' : ` ×${state.speed}`) : ' paused';
  const slow = reached(state);
  facts.time(`${clock(state.t)}${asked}${slow ? `, reached ×${slow}` : ''}`, state.running && !slow ? '' : 'warn');
  const stage = state.stage === 'lent' ? live.last.commission?.now : null;
  if (stage?.phase === 'turning') facts.arm('may turn', 'warn');
  if (state.stage === 'lent') ['phase', 'age', 'battery', 'leak', 'position', 'nis', 'progress'].forEach(id => facts[id]('–'));
  if (!state.eta) return;
  const loud = state.reason === 'operator' ? 'warn' : LOUD[state.phase] || '';  // what you asked for is no alarm
  facts.phase((state.reason ? `${state.phase}: ${state.reason}` : state.phase) ?? 'no data', loud);
  facts.age(`${number(state.link_age, 2)} s`, state.link_age > 1 ? 'danger' : state.link_age > 0.3 ? 'warn' : '');
  const firsts = kind => ofKind(state, kind).map(reading => reading.value?.[0]);
  const charge = most(Math.min, firsts('battery'));
  facts.battery(Number.isFinite(charge) ? `${Math.round(100 * charge)} %` : 'no data',
    charge < 0.1 ? 'danger' : charge < 0.25 ? 'warn' : '');
  const leak = most(Math.max, firsts('leak'));
  facts.leak(leak > 0.5 ? 'LEAK' : Number.isFinite(leak) ? 'dry' : 'no data', leak > 0.5 ? 'danger' : '');
  const [[a, b], [, c]] = state.ellipse ?? [[NaN, NaN], [NaN, NaN]];
  const radius = chi * Math.sqrt(0.5 * (a + c) + Math.hypot(0.5 * (a - c), b));
  const age = most(Math.min, ofKind(state, 'position').map(reading => reading.age));
  if (state.experiment) facts.position('no data');
  else facts.position(`${number(radius, 2)} m`, radius > 2 || age > 5 ? 'danger' : radius > 1 || age > 3 ? 'warn' : '');
  facts.nis(...(state.experiment ? ['none in a test', ''] : worst(state.nis)));
  facts.progress(onMission(state) ? `${Math.min(state.waypoint + 1, state.count)}/${state.count} · `
    + `${Math.round(100 * state.progress)} %` : 'none', state.phase === 'finished' ? 'ok' : '');
}

/** How many times as fast as ours its time goes, as text, where that is less than was asked for; '' before and after. */
function reached(state) {
  const now = performance.now();
  const before = past.at(-1) ?? {};
  const goes = state.running && state.stage === 'ready';
  if (!goes || before.speed !== state.speed || state.t < before.t) past.length = 0;
  past.push({now, t: state.t, speed: state.speed});
  while (past[1] && past[1].now < now - 1e3 * WINDOW) past.shift();
  const span = (now - past[0].now) / 1e3;
  if (!goes || span < WINDOW / 2) return '';
  const speed = (state.t - past[0].t) / span;
  return speed < 0.9 * state.speed ? speed.toPrecision(2) : '';
}
