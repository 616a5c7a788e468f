/** The camera's picture with a head-up display over it. */
import {live} from '/static/live.js';
import {make, mount, surface} from '/static/canvas.js';
import {drawHud} from '/static/hud_draw.js';

const OLD = 0.5; // a state older than this is marked [s]
const RETRY = 2000; // before a lost picture is asked for again [ms]
const STARTS = 30; // longest wait for the first picture, whose program is compiled [s]
const NEXT = 3; // and for the next one [s]

const model = {state: null, setup: null, camera: null, receivedAt: null};
let sighted = 0; // when the last live picture came
let shown = null;

/** What is older than it may be: {what, age} or null. A replay that is paused is not old. */
export function staleness({state, receivedAt}, now) {
  if (!state || state.replay) return null;
  const age = (now - receivedAt) / 1000;
  if (age > OLD) return {what: 'STALE', age};
  return state.link_age > OLD ? {what: 'VEHICLE SILENT', age: state.link_age} : null;
}

class Hud {
  #retry = 0;
  #needed = false;
  #shot = null; // of the recorded pictures the one that was asked for last
  #coming = false;

  constructor(element) {
    this.element = element;
    const handlers = {onerror: () => this.#lost(), onload: () => this.#came()};
    this.picture = make('img', {alt: 'Picture of the vehicle’s camera', hidden: true, ...handlers});
    this.words = make('p', {class: 'hud-words'});
    this.canvas = make('canvas', {role: 'img', 'aria-label': 'Head-up display'});
    element.replaceChildren(this.picture, this.words, this.canvas);
    this.surface = surface(this.canvas, (context, width, height) => {
      const stale = staleness(model, performance.now());
      element.dataset.stale = stale ? stale.what : '';
      drawHud(context, {width, height}, model, stale);
    });
    // A display nobody sees takes no pictures: they cost the server a render each.
    this.observer = new ResizeObserver(() => this.watch());
    this.observer.observe(element);
    this.clock = setInterval(() => this.#tick(), 100);
    this.watch();
  }

  /** Takes pictures where there is a camera and room to show them. */
  watch() {
    const {setup, camera} = model;
    const there = setup && (setup.replay ? setup.camera : camera?.live); // the camera is announced before the vehicle is
    const none = setup?.replay ? 'no pictures were recorded with this run' : camera?.why ?? '';
    const needed = Boolean(there) && this.element.clientWidth > 0;
    if (!there) this.words.textContent = none;
    if (needed === this.#needed) return;
    this.#needed = needed;
    clearTimeout(this.#retry);
    if (needed) this.#ask();
    else this.#drop();
  }

  /** In a replay: the recorded picture of the state that is shown, as soon as the one before has come. */
  turn() {
    const {setup, state} = model;
    if (!this.#needed || !setup?.pictures || this.#coming || (state?.shot ?? null) === this.#shot) return;
    this.#shot = state?.shot ?? null;
    this.#coming = this.#shot !== null;
    if (this.#coming) this.picture.src = `${setup.pictures}${this.#shot}`;
    else this.#drop();
  }

  #ask() {
    if (model.setup.pictures) {
      this.turn();
      return;
    }
    this.words.textContent = 'waiting for the camera';
    sighted = performance.now() + 1000 * (STARTS - NEXT);
    this.picture.src = `/camera.mjpg?${Date.now()}`;
  }

  /** Without its address the browser ends the stream; taking the element away would not. */
  #drop() {
    this.picture.removeAttribute('src');
    this.picture.hidden = true;
    this.#shot = null;
    this.#coming = false;
  }

  #came() {
    this.picture.hidden = false;
    this.words.textContent = '';
    this.#coming = false;
    this.turn();
  }

  #lost() {
    if (!this.#needed) return;
    if (model.setup?.pictures) {
      this.picture.hidden = true;
      this.words.textContent = 'this picture cannot be read';
      this.#coming = false;
      return;
    }
    this.#drop();
    this.words.textContent = `${model.camera?.why || 'no picture from the camera'}; trying again`;
    clearTimeout(this.#retry);
    this.#retry = setTimeout(() => this.#ask(), RETRY);
  }

  /** A stream that ends, or goes on without pictures, says nothing: the last one would stand there as if it were new. */
  #dry() {
    const live = this.#needed && this.picture.hasAttribute('src') && !model.setup?.pictures && model.state?.running;
    return live && !staleness(model, performance.now()) && performance.now() - sighted > 1000 * NEXT;
  }

  #tick() {
    const {dataset} = this.element;
    if (this.#dry()) this.#lost();
    if (staleness(model, performance.now()) || dataset.stale) this.surface.redraw();
  }

  release() {
    clearInterval(this.clock);
    clearTimeout(this.#retry);
    this.#needed = false;
    this.#drop();
    this.observer.disconnect();
    this.surface.release();
  }
}

mount('hud', element => {
  const hud = new Hud(element);
  shown = hud;
  return () => {
    hud.release();
    shown = null;
  };
});

live.on('state', state => {
  Object.assign(model, {state, receivedAt: performance.now()});
  if (!state.running) sighted = model.receivedAt; // time stands still, and so does the picture
  shown?.turn();
  shown?.surface.redraw();
});
live.on('camera', camera => {
  model.camera = camera;
  shown?.watch();
});
live.on('sight', () => { sighted = performance.now(); });
live.on('setup', setup => {
  model.setup = setup;
  shown?.watch();
  shown?.surface.redraw();
});
