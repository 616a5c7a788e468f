/** Manual piloting: keys, gamepad and touch sticks give velocities; what is not asked for (depth, heading) is held. */
import {make, mount} from '/static/canvas.js';
import {live} from '/static/live.js';
import {showReply} from '/static/page.js';

const EVERY = 50;  // between two commands [ms]
const SETTLED = 1000;  // until the autopilot tells that it is piloted [ms]
const DEAD = 0.12;  // of a gamepad's stick that counts as released
const KEYS = {
  KeyW: ['surge', 1], KeyS: ['surge', -1], KeyD: ['sway', 1], KeyA: ['sway', -1],
  KeyF: ['heave', 1], KeyR: ['heave', -1], KeyE: ['yaw', 1], KeyQ: ['yaw', -1],
};
const AXES = ['surge', 'sway', 'heave', 'yaw'];
const down = new Set();
const touch = {surge: 0, sway: 0, heave: 0, yaw: 0};
let on = false;
let gain = 0.5;

const clip = value => Math.max(-1, Math.min(1, value));

/** The command of keys, sticks on the screen and gamepad together. */
function command() {
  const found = {...touch};
  for (const code of down) found[KEYS[code][0]] += KEYS[code][1];
  const pad = [...(navigator.getGamepads?.() || [])].find(one => one?.connected);
  if (pad) {
    const axis = i => (Math.abs(pad.axes[i] || 0) > DEAD ? pad.axes[i] : 0);
    found.sway += axis(0); found.surge -= axis(1); found.yaw += axis(2); found.heave += axis(3);
  }
  return Object.fromEntries(AXES.map(name => [name, clip(gain * clip(found[name]))]));
}

/** A square to be dragged in: two axes of touch or mouse. */
function stick(label, across, upward, sign) {
  const knob = make('div', {class: 'knob'});
  const pad = make('div', {class: 'stick', role: 'application', 'aria-label': label, tabindex: 0},
    make('span', {class: 'stick-label'}, label), knob);
  const set = (x, y) => {
    [touch[across], touch[upward]] = [x, sign * y];
    knob.style.transform = `translate(${x * 45}px, ${y * 45}px)`;
  };
  pad.addEventListener('pointerdown', event => pad.setPointerCapture(event.pointerId));
  pad.addEventListener('pointermove', event => {
    if (!pad.hasPointerCapture(event.pointerId)) return;
    const box = pad.getBoundingClientRect();
    set(clip(2 * (event.clientX - box.left) / box.width - 1), clip(2 * (event.clientY - box.top) / box.height - 1));
  });
  for (const kind of ['pointerup', 'pointercancel', 'lostpointercapture']) pad.addEventListener(kind, () => set(0, 0));
  return pad;
}

function typing(event) { return event.target.closest?.('input, textarea, select, [contenteditable=true]'); }

addEventListener('keydown', event => {
  if (on && event.code in KEYS && !typing(event) && !event.ctrlKey && !event.metaKey) down.add(event.code);
});
addEventListener('keyup', event => down.delete(event.code));
addEventListener('blur', () => down.clear());
document.addEventListener('visibilitychange', () => down.clear());

mount('pilot', section => {
  const toggle = make('button', {class: 'action wide', id: 'piloting', 'aria-pressed': 'false'}, 'Start piloting');
  const shown = make('p', {class: 'muted', role: 'status'});
  const slider = make('input', {type: 'range', min: 0.1, max: 1, step: 0.1, value: gain, 'aria-label': 'Share of full speed'});
  slider.addEventListener('input', () => { gain = Number(slider.value); });
  let since = 0; // when piloting began
  const set = value => {
    on = value;
    since = performance.now();
    down.clear();
    toggle.textContent = on ? 'Stop piloting (hold)' : 'Start piloting';
    toggle.setAttribute('aria-pressed', on);
  };
  toggle.addEventListener('click', async () => {
    if (on) { set(false); showReply(live.send({do: 'hold'})); } else if (await showReply(live.send({do: 'pilot', begin: true}))) set(true);
  });
  section.append(toggle, make('div', {class: 'sticks'},
    stick('Ahead, sideways', 'sway', 'surge', -1), stick('Turn, up and down', 'yaw', 'heave', 1)),
  make('label', {class: 'line'}, 'Speed', slider), shown,
  make('p', {class: 'muted'}, 'Keys: W S ahead, A D sideways, R F up and down, Q E turn. Gamepad: left stick ahead and '
    + 'sideways, right stick turn and depth. Released, depth and heading are held. Esc is STOP.'));
  const timer = setInterval(() => {
    if (!on) return;
    const asked = command();
    live.tell({do: 'pilot', ...asked});
    shown.textContent = AXES.map(name => `${name} ${(100 * asked[name]).toFixed(0)} %`).join(', ');
  }, EVERY);
  const release = live.on('state', state => {
    const may = state.armed && live.last.rights?.may && !state.replay;
    toggle.disabled = !may;
    const ended = state.phase !== 'piloted' && performance.now() - since > SETTLED; // by another order, or a fail-safe
    if (on && (!may || ended)) set(false);
  });
  return () => { clearInterval(timer); release(); };
});
