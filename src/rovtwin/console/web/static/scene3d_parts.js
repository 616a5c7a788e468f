/** Small things that the 3-D scene is made of. All are in n: x north, y east, z down [m]. */
import {THREE} from 'nicegui-scene';
import {colour} from '/static/canvas.js';

const tinted = []; // [WeakRef of a material, name of its colour]
const MOST = 4096; // points of a track

/** A material whose colour is one of the theme's and follows it. */
export function tint(material, name) {
  material.color.set(colour(name));
  tinted.push([new WeakRef(material), name]);
  return material;
}

/** Takes the theme's colours again. */
export function retint() {
  for (let i = tinted.length - 1; i >= 0; i--) {
    const material = tinted[i][0].deref();
    if (material) material.color.set(colour(tinted[i][1]));
    else tinted.splice(i, 1);
  }
}

export const line = (name, opacity = 1, more = {}) =>
  tint(new THREE.LineBasicMaterial({transparent: opacity < 1, opacity, depthWrite: opacity === 1, ...more}), name);

export const veil = (name, opacity, more = {}) =>
  tint(new THREE.MeshBasicMaterial({transparent: true, opacity, depthWrite: false, side: THREE.DoubleSide, ...more}), name);

/** Segments from pairs of points [[x, y, z], [x, y, z], ...]. */
export function segments(points, material) {
  const made = new THREE.LineSegments(new THREE.BufferGeometry(), material);
  made.geometry.setAttribute('position', new THREE.Float32BufferAttribute(points.flat(), 3));
  return made;
}

/** Takes things away from a group and frees what they hold on the graphics card. */
export function clear(group) {
  group.traverse(thing => {
    if (thing === group) return;
    thing.geometry?.dispose();
    thing.material?.dispose();
  });
  group.clear();
}

/** An arrow from the origin of its group along a direction, with a text at its head: see `label`. */
export class Arrow {
  constructor(name) {
    this.group = new THREE.Group();
    this.name = name;
    const material = tint(new THREE.MeshBasicMaterial(), name);
    const shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.014, 0.014, 0.8, 8), material);
    const head = new THREE.Mesh(new THREE.ConeGeometry(0.055, 0.2, 12), material);
    shaft.position.y = 0.4; // three.js has them along y
    head.position.y = 0.9;
    this.group.add(shaft, head);
    this.group.visible = false;
  }

  /** From a place [x, y, z] along a vector in n, so many metres long; no text: no arrow. */
  set(place, along, length, text) {
    this.group.visible = text !== '';
    if (!text) return;
    const direction = new THREE.Vector3(...along).normalize();
    this.group.position.set(...place);
    this.group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), direction);
    this.group.scale.setScalar(length);
    this.label = {at: direction.multiplyScalar(length).add(this.group.position).toArray(), from: place, text, name: this.name};
  }
}

/** Where the vehicle was: a line of at most MOST points, thinned as it grows, cut back when time goes back. */
export class Trail {
  constructor(step = 0.05) {
    Object.assign(this, {step, count: 0, t: new Float64Array(MOST)});
    this.at = new THREE.BufferAttribute(new Float32Array(3 * MOST), 3);
    const geometry = new THREE.BufferGeometry().setAttribute('position', this.at);
    this.line = new THREE.Line(geometry, line('track'));
    this.line.frustumCulled = false;
    this.line.renderOrder = 3;
  }

  /** Takes all of a run, [[t, [x, y, z]], ...]: from now on `add` shows what lies before its time. */
  know(points) {
    this.known = null;
    this.count = 0;
    for (const [t, place] of points) this.add(t, place);
    this.known = {t: this.t.slice(0, this.count), at: this.at.array.slice(0, 3 * this.count)};
    this.tip = 0;
  }

  #show(t, place) {
    const {known, tip} = this;
    this.at.array.set(known.at.subarray(3 * tip, 3 * tip + 3), 3 * tip); // where the vehicle stood in for it
    const later = known.t.findIndex(at => at > t);
    this.tip = Math.min(later < 0 ? known.t.length : later, MOST - 1);
    this.at.setXYZ(this.tip, ...place);
    this.at.needsUpdate = true;
    this.count = this.tip + 1;
    this.line.geometry.setDrawRange(0, this.count);
  }

  add(t, [x, y, z]) {
    if (this.known) {
      this.#show(t, [x, y, z]);
      return;
    }
    while (this.count && this.t[this.count - 1] > t) this.count--;
    const tip = this.count - 1;
    // The newest point follows the vehicle; it stays where it is far enough from the one before it.
    if (tip < 1 || this.#apart(tip - 1, tip) >= this.step) this.count++;
    if (this.count > MOST) this.#thin();
    this.t[this.count - 1] = t;
    this.at.setXYZ(this.count - 1, x, y, z);
    this.at.needsUpdate = true;
    this.line.geometry.setDrawRange(0, this.count);
  }

  #apart(i, j) {
    const p = this.at.array;
    return Math.hypot(p[3 * i] - p[3 * j], p[3 * i + 1] - p[3 * j + 1], p[3 * i + 2] - p[3 * j + 2]);
  }

  #thin() {
    const p = this.at.array;
    this.count = MOST / 2;
    for (let i = 0; i < this.count; i++) {
      p.copyWithin(3 * i, 6 * i, 6 * i + 3);
      this.t[i] = this.t[2 * i];
    }
    this.count++;
    this.step *= 2;
  }
}

/** Half axes of the ellipse in which a plane vector is with 95 %, and the angle of the first from north [rad]. */
export function ellipse([[xx, xy], [, yy]], scale) {
  const middle = (xx + yy) / 2;
  const off = Math.hypot((xx - yy) / 2, xy);
  const axes = [middle + off, Math.max(middle - off, 0)].map(v => scale * Math.sqrt(v));
  return {axes, angle: 0.5 * Math.atan2(2 * xy, xx - yy)};
}
