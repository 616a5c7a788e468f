/** In place of /static/live.js: plays a lawn-mower by itself, or what a test emits. `window.fake` is the test's hand on it. */
const handlers = new Map();
export const live = {
  last: {},
  on(kind, take) {
    if (!handlers.has(kind)) handlers.set(kind, []);
    handlers.get(kind).push(take);
    if (live.last[kind]) take(live.last[kind]);
  },
  send: message => { fake.sent.push(message); return Promise.resolve(); },
  css: name => getComputedStyle(document.body).getPropertyValue(name),
};

const POINTS = [[-8, -6], [8, -6], [8, -2], [-8, -2], [-8, 2], [8, 2], [8, 6]].map(([x, y], i) =>
  ({x, y, depth: 2 + 0.5 * i, speed: 0.4, hold_time: 0, heading: null}));
const SPEED = 0.4;
const noise = (t, k) => Math.sin(1.7 * t + k) * Math.sin(0.61 * t + 2 * k);

/** Where a vehicle is that follows the way-points at SPEED: [x, y, z, heading, leg]. */
function along(s) {
  for (let i = 0; i < POINTS.length - 1; i++) {
    const [a, b] = [POINTS[i], POINTS[i + 1]];
    const [dx, dy, dz] = [b.x - a.x, b.y - a.y, b.depth - a.depth];
    const length = Math.hypot(dx, dy, dz);
    if (s < length) {
      const p = s / length;
      const corner = Math.min(1, s / 1.2);
      const before = i ? Math.atan2(a.y - POINTS[i - 1].y, a.x - POINTS[i - 1].x) : Math.atan2(dy, dx);
      const turn = Math.atan2(Math.sin(Math.atan2(dy, dx) - before), Math.cos(Math.atan2(dy, dx) - before));
      return [a.x + p * dx, a.y + p * dy, a.depth + p * dz, before + corner * turn, i];
    }
    s -= length;
  }
  const end = POINTS.at(-1);
  return [end.x, end.y, end.depth, 0, POINTS.length - 2];
}

const wrapped = a => Math.atan2(Math.sin(a), Math.cos(a));

export function stateAt(t) {
  const [x, y, z, psi, i] = along(SPEED * t);
  const [xx, yy] = [0.05 + 0.04 * (1 + Math.sin(t / 20)), 0.06];
  const near = [x + 0.05 * noise(t, 1), y + 0.07 * noise(t, 2), z + 0.02 * noise(t, 3)];
  const eta = [...near, 0.03 * noise(3 * t, 4), 0.02 * noise(3 * t, 5), wrapped(psi + 0.03 * noise(t, 6))];
  const u = [0.45, 0.42, 0.1, -0.15, 0.3, 0.32].map((level, k) => level + 0.2 * noise(4 * t, k));
  return {kind: 'state', sent: t, stage: 'ready', note: '', t, speed: 1, running: true, armed: true, phase: 'go', reason: '',
    eta, nu: [SPEED + 0.03 * noise(t, 7), 0.03 * noise(t, 8), 0.03, 0.01 * noise(t, 9), 0.01, 0.02 * noise(t, 10)],
    sd: [xx, yy, 0.01, 0.005, 0.005, 0.02], ellipse: [[xx ** 2, 0.4 * xx * yy], [0.4 * xx * yy, yy ** 2]],
    reference: [x, y, z, 0, 0, wrapped(psi)], setpoint: [...['x', 'y', 'depth'].map(k => POINTS[i + 1][k]), 0, 0, wrapped(psi)],
    reference_rate: [SPEED * Math.cos(psi), SPEED * Math.sin(psi), 0.03, 0, 0, 0],
    leg: [i, i + 1].map(k => [POINTS[k].x, POINTS[k].y, POINTS[k].depth]), on_leg: true, waypoint: i + 1, count: POINTS.length, progress: 0.4, to_go: 30,
    u, health: u.map(() => 1), tau: [12 + 3 * noise(t, 1), 2 * noise(t, 2), 4, 0.1, 0.2, noise(t, 3)],
    nis: {position: [2.9 + noise(t, 4), 3, 1.9, 4.3], pressure: [1 + 0.3 * noise(t, 5), 1, 0.5, 1.6]},
    sensors: {position: {age: 0.1, value: near.map((v, k) => v + 0.1 * noise(9 * t, k))}, battery: {age: 0.4, value: [16.2 - t / 900, 4.1]}},
    link_age: 0.01, operator_age: 0.1, late_ms: 0.4 + 0.2 * Math.abs(noise(7 * t, 1)),
    truth: eta.map((v, k) => v + [xx, yy, 0.01, 0.004, 0.004, 0.015][k] * noise(0.7 * t, k + 20)), current: [0.05, 0.18, 0], wave: [0, 0, 0, 0, 0, 0],
    folder: '', alerts: []};
}

export const SETUP = {kind: 'setup', thrusters: ['port_surge', 'starboard_surge', 'sway', 'yaw', 'port_heave', 'starboard_heave'],
  sensors: ['position', 'pressure', 'battery'], twin: true, camera: true, room: {kind: 'open', floor: 8}, fence: null, home: [-8, -6, 2],
  mesh: '/mesh/vehicle.glb', size: [0.5, 0.9, 0.35], waves: {height: 0.3, direction: 2.2}};
export const PLAN = {kind: 'plan', draft: [], flown: POINTS, submitted: true, checks: [], undo: false, redo: false};
const TEXTS = [['info', 'way-point reached'], ['info', 'leg begun'], ['warning', 'positions lost for 2.1 s: dead reckoning'],
  ['info', 'positions are back'], ['danger', 'thruster port_surge gives 40 % of what it is told']];

function emit(kind, message) {
  live.last[kind] = message;
  for (const take of handlers.get(kind) ?? []) take(message);
}

let timer = 0;
const fake = {
  sent: [], emit, stateAt, SETUP, PLAN,
  /** From a time on, `seconds` of it already gone by, `speed` times as fast as the clock. */
  play(from = 0, seconds = 60, speed = 1) {
    clearInterval(timer);
    for (let t = from; t < from + seconds; t += 0.05) emit('state', stateAt(t));
    const begun = performance.now();
    timer = setInterval(() => emit('state', stateAt(from + seconds + speed * (performance.now() - begun) / 1000)), 50);
  },
  stop: () => clearInterval(timer),
};
window.fake = fake;
const query = new URLSearchParams(location.search);
if (query.has('play')) {
  setTimeout(() => {
    emit('setup', SETUP);
    emit('plan', PLAN);
    for (let i = 0; i < 24; i++) {
      const [level, text] = TEXTS[i % TEXTS.length];
      emit('event', {kind: 'event', t: 5 * i, clock: `14:0${Math.floor(i / 12)}:${String((5 * i) % 60).padStart(2, '0')}`, level, text: `${text} (${i})`});
    }
    fake.play(0, 90, Number(query.get('play')) || 1);
  }, 300);
}
