/** The 3-D scene: a canvas, its camera and buttons; draws when something has changed, at most 15 times a second. */
import {OrbitControls, THREE} from 'nicegui-scene';
import {live} from '/static/live.js';
import {colour, make, mount} from '/static/canvas.js';
import {drawLabels} from '/static/scene3d_labels.js';
import {retint} from '/static/scene3d_parts.js';
import {World} from '/static/scene3d_world.js';

const PERIOD = 1000 / 15; // between two pictures at least [ms]
const CALM = 1000 / 10; // the same where a processor draws and no hand turns the camera [ms]
const SLOW = 40; // a picture that takes a processor longer is drawn with fewer pixels [ms]
const FILLED = 1.6; // of the picture's 2 x 2 that all there is takes after `fit`
const ABOVE = 0.08; // the middle of it above the middle of the picture: below are the words
const LEGEND = [['track', 'estimate'], ['plan', 'plan'], ['reference', 'reference'], ['truth', 'truth'], ['water', 'water']];
let view = null;
const world = new World(() => view?.ask()); // outlives the element: a change of tab loses no track
live.on('setup', setup => { world.setSetup(setup); view?.begin(); });
live.on('plan', plan => { world.setPlan(plan); view?.begin(); });
live.on('track', states => {
  world.trail.know(states.filter(s => s.eta).map(s => [s.t, s.eta]));
  view?.ask();
});
live.on('state', state => { if (world.setState(state)) view?.moved(); });

class View {
  follow = false;
  fitted = false; // to a plan or room, once; from then on the camera is the operator's
  visible = false;
  waiting = 0;
  last = -Infinity; // when the last picture was drawn [ms]

  constructor(element) {
    this.element = element;
    this.canvas = make('canvas', {tabindex: 0, role: 'img',
      'aria-label': '3-D scene of vehicle, track and plan. Drag to turn, wheel or pinch to zoom; arrow keys, plus and minus.'});
    this.words = make('p', {class: 'scene3d-words'});
    this.over = make('canvas', {class: 'scene3d-over', 'aria-hidden': 'true'});
    element.replaceChildren(this.canvas, this.over, this.#tools(), this.#legend());
    if (!this.#start()) return;
    this.watched = new IntersectionObserver(([entry]) => { this.visible = entry.isIntersecting; this.ask(); });
    this.watched.observe(this.canvas);
    this.sized = new ResizeObserver(() => this.#resize());
    this.sized.observe(element);
    this.themed = new MutationObserver(() => { this.#theme(); });
    this.themed.observe(document.body, {attributes: true, attributeFilter: ['class']});
    this.shown = () => this.ask();
    document.addEventListener('visibilitychange', this.shown);
    this.#resize();
    this.#theme();
    this.begin();
  }

  #tools() {
    const button = (text, says, onclick, pressed) =>
      make('button', {type: 'button', 'aria-label': says, title: says, 'aria-pressed': pressed, onclick}, text);
    this.orbiting = button('Orbit', 'Turn about a fixed place', () => this.setFollow(false), 'true');
    this.following = button('Follow', 'Follow the vehicle', () => this.setFollow(true), 'false');
    return make('div', {class: 'scene3d-tools', role: 'group', 'aria-label': 'Camera of the 3-D scene'},
      this.orbiting, this.following, button('Fit', 'Show everything', () => this.fit()));
  }

  #legend() {
    const keys = LEGEND.map(([name, text]) => make('li', {style: `--key: var(--${name})`}, text));
    return make('div', {class: 'scene3d-legend'}, make('ul', {}, ...keys), this.words);
  }

  /** WebGL, camera and light; false where there is none. */
  #start() {
    const refused = () => this.element.append(make('p', {class: 'scene3d-none', role: 'status'},
      'This browser has no WebGL: the 3-D scene cannot be drawn. The chart shows the same from above.'));
    try {
      const probe = this.canvas.getContext('webgl2', {antialias: false, powerPreference: 'low-power'});
      if (!probe) return refused(), false;
      this.renderer = new THREE.WebGLRenderer({canvas: this.canvas, context: probe});
    } catch {
      return refused(), false;
    }
    const gl = this.renderer.getContext();
    this.software = /swiftshader|llvmpipe|software/i.test(gl.getParameter(gl.getExtension('WEBGL_debug_renderer_info')?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
    this.ratio = this.software ? 1 : Math.min(devicePixelRatio, 2);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(45, 1, 0.05, 5000);
    this.camera.position.set(6, 8, 12);
    const sun = new THREE.DirectionalLight('#ffffff', 1.6);
    sun.position.set(0.4, 1, 0.3);
    this.scene.add(world.root, new THREE.HemisphereLight('#ffffff', '#aabbcc', 2.4), sun);
    this.controls = new OrbitControls(this.camera, this.canvas);
    Object.assign(this.controls, {minDistance: 0.5, maxDistance: 2000, zoomSpeed: 1.2});
    this.controls.addEventListener('change', () => this.ask());
    this.controls.addEventListener('start', () => { this.fitted = this.held = true; });
    this.controls.addEventListener('end', () => { this.held = false; });
    this.canvas.addEventListener('keydown', event => this.#key(event));
    this.canvas.addEventListener('webglcontextrestored', () => this.ask());
    return true;
  }

  #theme() {
    retint();
    this.scene.background = new THREE.Color(colour('bg'));
    this.ask();
  }

  #resize() {
    const {clientWidth: width, clientHeight: height} = this.element;
    if (!width || !height) return;
    this.renderer.setPixelRatio(this.ratio);
    this.renderer.setSize(width, height, false);
    Object.assign(this.over, {width: Math.round(width * devicePixelRatio), height: Math.round(height * devicePixelRatio)});
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.ask();
  }

  /** Arrow keys turn, + and - zoom, where the keyboard brought the focus here: elsewhere they may pilot the vehicle. */
  #key(event) {
    const act = {ArrowLeft: [-0.1, 0, 1], ArrowRight: [0.1, 0, 1], ArrowUp: [0, -0.08, 1], ArrowDown: [0, 0.08, 1],
      '+': [0, 0, 0.87], '-': [0, 0, 1.15]}[event.key];
    if (!act || !this.canvas.matches(':focus-visible')) return;
    event.preventDefault();
    event.stopPropagation();
    const offset = new THREE.Spherical().setFromVector3(this.camera.position.clone().sub(this.controls.target));
    offset.theta += act[0];
    offset.phi = Math.min(Math.max(offset.phi + act[1], 0.02), Math.PI - 0.02);
    offset.radius *= act[2];
    this.camera.position.setFromSpherical(offset).add(this.controls.target);
    this.fitted = true;
    this.controls.update();
  }

  /** Where the vehicle is, in three.js's axes; null before it is known. */
  get vehicle() {
    if (!world.state) return null;
    const [x, y, z] = world.state.eta;
    return new THREE.Vector3(y, -z, -x);
  }

  setFollow(follow) {
    this.follow = follow;
    this.fitted = true;
    this.orbiting.setAttribute('aria-pressed', String(!follow));
    this.following.setAttribute('aria-pressed', String(follow));
    const at = this.vehicle;
    if (!follow || !at) return;
    const away = this.camera.position.clone().sub(this.controls.target).setLength(Math.max(7 * Math.max(...world.size), 3));
    this.#look(at, away);
  }

  /** Everything in the picture, seen from the south, aslant from above. */
  fit() {
    this.setFollow(false);
    const corners = world.corners.map(([x, y, z]) => new THREE.Vector3(y, -z, -x));
    const at = corners.reduce((sum, p) => sum.addScaledVector(p, 1 / corners.length), new THREE.Vector3());
    const away = new THREE.Vector3(0.35, 0.8, 1).setLength(2 * Math.max(...corners.map(p => p.distanceTo(at))));
    for (let i = 0; i < 6; i++) {
      this.#look(at, away);
      this.camera.updateMatrixWorld();
      const seen = corners.map(p => p.clone().project(this.camera));
      const [[left, right], [low, high]] = ['x', 'y'].map(k => [Math.min(...seen.map(p => p[k])), Math.max(...seen.map(p => p[k]))]);
      const half = Math.tan(THREE.MathUtils.degToRad(this.camera.fov / 2)) * away.length();
      const [across, up] = [0, 1].map(k => new THREE.Vector3().setFromMatrixColumn(this.camera.matrixWorld, k));
      at.addScaledVector(across, 0.5 * (left + right) * half * this.camera.aspect).addScaledVector(up, (0.5 * (low + high) - ABOVE) * half);
      away.multiplyScalar(Math.max(right - left, high - low) / FILLED);
    }
    this.#look(at, away);
  }

  #look(at, away) {
    this.controls.target.copy(at);
    this.camera.position.copy(at).add(away);
    this.controls.update();
    this.ask();
  }

  /** Fits the camera to what has come, until the operator has moved it. */
  begin() {
    if (this.fitted || !this.controls || !world.setup.room) return;
    this.fit();
    this.fitted = false;
  }

  moved() {
    const at = this.vehicle;
    if (this.follow && at && this.controls) {
      const by = at.clone().sub(this.before ?? at);
      this.controls.target.add(by);
      this.camera.position.add(by);
    }
    this.before = at;
    this.ask();
  }

  /** Draws soon: at the next frame, but not before PERIOD has gone by. */
  ask() {
    if (this.waiting || !this.renderer || !this.visible || document.hidden) return;
    const period = this.software && !this.held ? CALM : PERIOD;
    const rest = Math.max(0, period - (performance.now() - this.last));
    this.waiting = setTimeout(() => requestAnimationFrame(() => this.#draw()), rest);
  }

  #draw() {
    this.waiting = 0;
    if (!this.visible || document.hidden || this.released) return;
    this.last = performance.now();
    world.setScale(this.vehicle ? this.camera.position.distanceTo(this.vehicle) : 10);
    this.renderer.render(this.scene, this.camera);
    drawLabels(this.over, this.camera, world);
    this.words.textContent = world.words;
    this.element.classList.toggle('scene3d-real', !world.state?.truth);
    this.drawn = (this.drawn ?? 0) + 1;
    this.element.dataset.pictures = this.drawn;
    if (this.software && this.drawn % 30 === 5) this.#lighten();
  }

  /** A processor that draws may need fewer pixels, or more again: a fence says when a picture is done. */
  #lighten() {
    const gl = this.renderer.getContext();
    const begun = performance.now();
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const look = () => {
      if (this.released || gl.isContextLost()) return;
      const took = performance.now() - begun;
      if (gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED && took < 1000) return setTimeout(look, 4);
      gl.deleteSync(fence);
      const ratio = took > SLOW ? this.ratio - 0.25 : took < SLOW / 4 ? this.ratio + 0.25 : this.ratio;
      if (ratio === this.ratio || ratio < 0.5 || ratio > 1) return;
      this.ratio = ratio;
      this.#resize();
    };
    setTimeout(look, 4);
  }

  release() {
    this.released = true;
    clearTimeout(this.waiting);
    document.removeEventListener('visibilitychange', this.shown);
    for (const observer of [this.watched, this.sized, this.themed]) observer?.disconnect();
    this.controls?.dispose();
    this.scene?.remove(world.root);
    this.renderer?.dispose();
    this.renderer?.forceContextLoss();
    view = null;
  }
}

mount('scene3d', element => {
  view = new View(element);
  return () => view?.release();
});
