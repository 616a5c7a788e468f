/** What stands and moves in the 3-D scene, from the console's messages. */
import {GLTFLoader, THREE} from 'nicegui-scene';
import {Arrow, Trail, clear, ellipse, line, segments, tint, veil} from '/static/scene3d_parts.js';

const SURE = Math.sqrt(7.815); // standard deviations within which three numbers are with 95 %
const BELOW = 2; // metres below the deepest way-point where the grid lies when the floor is not known
const NUMBERED = 60; // way-points that get a number, and the last one
const NICE = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500];

export class World {
  /** Children of `root` are in n; three.js has y up, so that x is shown to -z, y to x and z to -y. */
  root = new THREE.Group();
  room = new THREE.Group();
  plan = new THREE.Group();
  vehicle = new THREE.Group();
  ghost = new THREE.Group();
  looks = new THREE.Group(); // of the vehicle; kept apart from what else goes along with it
  trail = new Trail();
  current = new Arrow('water');
  waves = new Arrow('water');
  setup = {};
  points = []; // of the plan
  state = null;
  floor = null; // depth of the grid; `known` says whether that is the floor [m]
  known = false;
  cell = 1; // side of the grid's squares [m]
  size = [0.5, 0.5, 0.3];

  constructor(changed) {
    this.changed = changed;
    this.root.matrixAutoUpdate = false;
    this.root.matrix.set(0, 1, 0, 0, 0, 0, -1, 0, -1, 0, 0, 0, 0, 0, 0, 1);
    this.drop = segments([[0, 0, 0], [0, 0, 0]], line('track', 0.7));
    this.drop.frustumCulled = false;
    this.leg = segments([[0, 0, 0], [0, 0, 0]], line('accent'));
    this.leg.frustumCulled = false;
    this.sure = new THREE.Mesh(new THREE.SphereGeometry(1, 24, 16), veil('track', 0.25, {depthTest: false}));
    this.sure.renderOrder = 5;
    this.reference = this.#cross();
    this.vehicle.add(this.looks, this.#nose());
    this.root.add(this.room, this.plan, this.vehicle, this.ghost, this.trail.line, this.drop, this.leg, this.sure,
      this.reference, this.current.group, this.waves.group);
    for (const one of [this.vehicle, this.ghost, this.sure, this.reference, this.leg, this.drop]) one.visible = false;
  }

  #cross() {
    const r = 0.25;
    const made = segments([[-r, 0, 0], [r, 0, 0], [0, -r, 0], [0, r, 0], [0, 0, -r], [0, 0, r]], line('reference', 0.95, {depthTest: false}));
    made.renderOrder = 6;
    return made;
  }

  /** Where the bow is, whatever the vehicle looks like. */
  #nose() {
    this.bow = new THREE.Mesh(new THREE.ConeGeometry(0.5, 1, 12), tint(new THREE.MeshBasicMaterial(), 'accent'));
    this.bow.rotation.z = -Math.PI / 2; // cones point along y
    return this.bow;
  }

  setSetup(setup) {
    const before = this.setup;
    this.setup = setup;
    if (setup.size) this.size = setup.size;
    if (setup.mesh !== before.mesh || String(setup.size) !== String(before.size)) this.#setVehicle();
    this.#setRoom();
    this.setPlan(this.message);
  }

  #setVehicle() {
    const [l, b, h] = this.size;
    this.bow.scale.setScalar(0.16 * Math.min(l, b));
    this.bow.position.set(0.5 * l + 0.12 * Math.min(l, b), 0, 0);
    this.#show(new THREE.Mesh(new THREE.BoxGeometry(l, b, h), tint(new THREE.MeshLambertMaterial(), 'muted')));
    if (!this.setup.mesh) return;
    new GLTFLoader().loadAsync(this.setup.mesh).then(({scene}) => {
      scene.traverse(part => {
        if (!part.isMesh) return;
        const material = new THREE.MeshLambertMaterial({color: part.material.color, side: THREE.DoubleSide});
        part.material.dispose();
        part.material = material; // a third of the work of glTF's own
      });
      this.#show(scene);
    }, () => {}); // the box stays: nothing that an operator could do about it
  }

  #show(thing) {
    clear(this.looks);
    clear(this.ghost);
    this.looks.add(thing);
    const edges = line('truth', 0.6);
    thing.updateMatrixWorld(true);
    thing.traverse(part => {
      if (!part.isMesh) return;
      const made = new THREE.LineSegments(new THREE.EdgesGeometry(part.geometry, 35), edges);
      made.applyMatrix4(part.matrixWorld.clone().premultiply(this.looks.matrixWorld.clone().invert()));
      this.ghost.add(made);
    });
    this.changed();
  }

  /** North and east limits of what there is to see [[lo, hi], [lo, hi]]: the room, or plan, fence and vehicle. */
  get extent() {
    const {room, fence, home} = this.setup;
    if (room?.kind === 'tank') return [room.x, room.y];
    const places = this.points.map(p => [p.x, p.y]);
    if (home) places.push(home);
    if (this.state?.eta) places.push(this.state.eta);
    if (fence && places.length < 2) places.push([fence.north[0], fence.east[0]], [fence.north[1], fence.east[1]]);
    if (!places.length) places.push([0, 0]);
    return [0, 1].map(i => {
      const values = places.map(p => p[i]).filter(Number.isFinite);
      const [low, high] = [Math.min(...values), Math.max(...values)];
      const more = Math.max(0.15 * (high - low), 5 - 0.5 * (high - low), 1);
      return [low - more, high + more];
    });
  }

  /** Corners of it, from the surface to the floor. */
  get corners() {
    const [x, y] = this.extent;
    return x.flatMap(a => y.flatMap(b => [[a, b, 0], [a, b, this.floor ?? 0]]));
  }

  #setRoom() {
    clear(this.room);
    const {room} = this.setup;
    const deepest = Math.max(0, this.state?.eta?.[2] ?? 0, ...this.points.map(p => p.depth));
    this.known = Number.isFinite(room?.floor);
    this.floor = this.known ? room.floor : Math.ceil(deepest + BELOW);
    const [[south, north], [west, east]] = this.extent;
    this.cell = NICE.find(step => Math.max(north - south, east - west) / step <= 24) ?? 1000;
    this.shown = [[south, north], [west, east]];
    this.#grid(room?.kind === 'tank');
    if (room?.kind === 'tank') this.#walls(south, north, west, east);
    this.changed();
  }

  #grid(tank) {
    const c = this.cell;
    const [x, y] = this.shown.map(([low, high]) => tank ? [low, high] : [c * Math.floor(low / c), c * Math.ceil(high / c)]);
    const z = this.floor;
    const [fine, rim] = [[], [[x[0], y[0], z], [x[0], y[1], z], [x[1], y[0], z], [x[1], y[1], z],
      [x[0], y[0], z], [x[1], y[0], z], [x[0], y[1], z], [x[1], y[1], z]]];
    for (let at = c * Math.ceil(x[0] / c); at <= x[1] + 1e-9; at += c) fine.push([at, y[0], z], [at, y[1], z]);
    for (let at = c * Math.ceil(y[0] / c); at <= y[1] + 1e-9; at += c) fine.push([x[0], at, z], [x[1], at, z]);
    this.room.add(segments(fine, line('line', 0.45)), segments(rim, line('line')));
    const flat = new THREE.PlaneGeometry(x[1] - x[0], y[1] - y[0]);
    const surface = new THREE.Mesh(flat, veil('water', 0.1));
    const bottom = new THREE.Mesh(flat.clone(), veil('panel', 0.8));
    const middle = [(x[0] + x[1]) / 2, (y[0] + y[1]) / 2];
    surface.position.set(...middle, 0);
    bottom.position.set(...middle, z + 0.01);
    const edge = rim.map(([a, b]) => [a, b, 0]);
    this.north = {at: [x[1] + 0.06 * (x[1] - x[0]), middle[1], z], text: 'N', name: 'text'};
    this.room.add(bottom, surface, segments(edge, line('water', 0.6)));
  }

  #walls(south, north, west, east) {
    const box = new THREE.BoxGeometry(north - south, east - west, this.floor);
    const inside = new THREE.Mesh(box, veil('muted', 0.12, {side: THREE.BackSide})); // those in front do not hide it
    inside.position.set((north + south) / 2, (east + west) / 2, this.floor / 2);
    const corners = [[south, west], [south, east], [north, west], [north, east]];
    this.room.add(inside, segments(corners.flatMap(([x, y]) => [[x, y, 0], [x, y, this.floor]]), line('line')));
  }

  setPlan(message) {
    this.message = message;
    const {flown = [], draft = [], submitted} = message ?? {};
    this.points = submitted ? flown : draft;
    clear(this.plan);
    const outside = this.#beyond();
    if (outside) this.#setRoom();
    const at = this.points.map(p => [p.x, p.y, p.depth]);
    if (!at.length) return this.changed();
    const way = at.slice(1).flatMap((p, i) => [at[i], p]);
    const drops = at.flatMap(p => [p, [p[0], p[1], this.floor]]);
    const lines = submitted ? line('plan', 0.7) : tint(new THREE.LineDashedMaterial({dashSize: 0.4, gapSize: 0.25}), 'plan');
    const legs = segments(way, lines);
    legs.computeLineDistances();
    this.plan.add(legs, segments(drops, line('plan', 0.4)));
    this.changed();
  }

  /** Whether the plan or the vehicle has left what the grid shows. */
  #beyond() {
    if (!this.shown || this.setup.room?.kind === 'tank') return false;
    const deep = !this.known && this.points.some(p => p.depth > this.floor - 0.5 * BELOW);
    const [x, y] = this.extent;
    const out = ([low, high], [a, b]) => low < a - this.cell || high > b + this.cell;
    return deep || out(x, this.shown[0]) || out(y, this.shown[1]);
  }

  /** Takes a state; whether there is anything else to see than before. */
  setState(state) {
    if (!Array.isArray(state.eta) || !state.eta.every(Number.isFinite)) return false;
    const moved = !this.state || differs(this.state, state);
    this.state = state;
    this.trail.add(state.t, state.eta);
    if (!moved) return false;
    if (this.#beyond()) { this.#setRoom(); this.setPlan(this.message); }
    place(this.vehicle, state.eta);
    place(this.ghost, state.truth);
    this.#line(this.drop, state.eta, [state.eta[0], state.eta[1], this.floor ?? state.eta[2]]);
    this.#line(this.leg, ...(state.on_leg && state.leg ? state.leg : [null, null]));
    this.reference.visible = Array.isArray(state.reference);
    if (this.reference.visible) this.reference.position.set(...state.reference);
    this.#setSure(state);
    return true;
  }

  #line(thing, from, to) {
    thing.visible = Boolean(from && to);
    if (!thing.visible) return;
    const at = thing.geometry.attributes.position;
    at.setXYZ(0, ...from.slice(0, 3));
    at.setXYZ(1, ...to.slice(0, 3));
    at.needsUpdate = true;
  }

  #setSure({eta, sd, ellipse: covariance}) {
    this.sure.visible = Boolean(covariance && sd);
    if (!this.sure.visible) return;
    const {axes, angle} = ellipse(covariance, SURE);
    this.half = [...axes, SURE * sd[2]];
    this.sure.position.set(...eta);
    this.sure.scale.set(...this.half.map(a => Math.max(a, 1e-3)));
    this.sure.rotation.set(0, 0, angle);
  }

  /** Arrows and marks have a size on the screen: from the distance at which the vehicle is seen [m]. */
  setScale(distance) {
    const {state, setup} = this;
    if (!state) return;
    this.small = distance > 12 * Math.max(...this.size);
    this.reference.scale.setScalar(Math.max(0.06 * distance, 0.4));
    const [x, y, z] = state.eta;
    const current = state.current ?? [0, 0, 0];
    const speed = Math.hypot(...current);
    this.current.set([x, y, z], current, 0.22 * distance * Math.min(0.4 + speed, 1), speed > 0.005 ? `${speed.toFixed(2)} m/s` : '');
    const {direction = 0, height = 0} = setup.waves ?? {};
    const run = [Math.cos(direction), Math.sin(direction), 0];
    this.waves.set([x, y, 0], run, 0.16 * distance, height > 0 ? `waves ${height.toFixed(2)} m` : '');
  }

  /** Texts and discs that are drawn over the picture: {at: [x, y, z], text, name: of a colour, disc: its radius [px]}. */
  get labels() {
    const made = this.points.map((p, i) => {
      const numbered = i < NUMBERED || i === this.points.length - 1;
      return {at: [p.x, p.y, p.depth], text: numbered ? String(i + 1) : '', name: 'plan', disc: numbered ? 10 : 4};
    });
    if (this.north) made.push(this.north);
    if (this.state && this.small) made.push({at: this.state.eta, text: '', name: 'track', disc: 6});
    return [...made, ...[this.current, this.waves].filter(arrow => arrow.group.visible).map(arrow => arrow.label)];
  }

  /** What is worth reading about it. */
  get words() {
    const parts = [`Grid ${this.cell} m`, this.known ? `floor ${this.floor.toFixed(1)} m` : `grid at ${this.floor} m, floor unknown`];
    if (this.half) parts.push(`95 % within ±${this.half.map(a => a.toFixed(2)).join(' × ±')} m`);
    return parts.join(' · ');
  }
}

/** Puts a group at eta; attitudes are zyx Euler angles. */
function place(group, eta) {
  group.visible = Array.isArray(eta);
  if (!group.visible) return;
  group.position.set(...eta.slice(0, 3));
  group.rotation.set(eta[3], eta[4], eta[5], 'ZYX');
}

/** Whether two states look different: by more than a millimetre or milliradian. */
function differs(a, b) {
  const far = (p, q) => !p !== !q || (p && q && p.some((value, i) => Math.abs(value - q[i]) > 1e-3));
  return far(a.eta, b.eta) || far(a.truth, b.truth) || far(a.current, b.current) || far(a.reference, b.reference)
    || far(a.sd, b.sd) || far(a.leg?.flat(), b.leg?.flat());
}
