/** Hands on the chart: pan, zoom and pinch; way-points laid, moved, chosen; areas drawn. Mouse, pen and touch alike. */
import {corners} from '/static/geometry.js';

const LONG_PRESS = 550; // [ms]
const REACH = {mouse: 14, touch: 24}; // how near a way-point counts as on it [px]
const STILL = {mouse: 4, touch: 10}; // how far a click may wander [px]

const rounded = ({x, y}) => ({x: Math.round(x * 100) / 100, y: Math.round(y * 100) / 100});
const apart = (p, q) => Math.hypot(p.u - q.u, p.v - q.v);

/**
 * Listens on the canvas of a chart (see chart.js) and calls its `add`, `move`, `menu`, `areaDrawn`, `changed`.
 * Nothing is edited while `chart.may()` is false; the view can always be moved.
 */
export class Hands {
  #pointers = new Map();
  #drag = null;
  #timer = 0;

  constructor(canvas, chart) {
    Object.assign(this, {canvas, chart});
    const on = (name, act) => canvas.addEventListener(name, act, {passive: false});
    on('pointerdown', e => this.#down(e));
    on('pointermove', e => this.#move(e));
    on('pointerup', e => this.#up(e));
    on('pointercancel', e => this.#drop(e));
    on('pointerleave', () => chart.changed({hover: null, cursor: null}));
    on('wheel', e => this.#wheel(e));
    on('contextmenu', e => this.#menu(e));
    on('keydown', e => this.#key(e));
  }

  #pixel(event) {
    const box = this.canvas.getBoundingClientRect();
    return {u: event.clientX - box.left, v: event.clientY - box.top};
  }

  #hit(pixel, kind) {
    const reach = REACH[kind] ?? REACH.touch;
    const distances = this.chart.draft().map(p => apart(this.chart.view.toScreen(p), pixel));
    const least = Math.min(...distances);
    return least <= reach ? distances.indexOf(least) : null;
  }

  #down(event) {
    const {chart} = this;
    chart.closeMenu();
    if (event.button !== 0 || event.ctrlKey) return; // Ctrl and a click is a right click on a Mac
    this.canvas.focus({preventScroll: true});
    this.canvas.setPointerCapture(event.pointerId);
    const pixel = this.#pixel(event);
    this.#pointers.set(event.pointerId, pixel);
    clearTimeout(this.#timer);
    if (this.#pointers.size > 1) return this.#abandon('pinch');
    const i = chart.may() && !chart.drawing() && chart.mode !== 'measure' ? this.#hit(pixel, event.pointerType) : null;
    const kind = i !== null ? 'waypoint' : chart.drawing() ? 'area' : 'pan';
    this.#drag = {kind, i, from: pixel, last: pixel, moved: false, still: STILL[event.pointerType] ?? STILL.touch};
    if (event.pointerType !== 'mouse') this.#timer = setTimeout(() => this.#pressed(pixel), LONG_PRESS);
  }

  #move(event) {
    const {chart} = this;
    const pixel = this.#pixel(event);
    if (!this.#pointers.has(event.pointerId)) {
      const toward = chart.drawing() ? chart.view.toWorld(pixel) : null;
      return chart.changed({cursor: chart.view.toWorld(pixel), hover: this.#hit(pixel, event.pointerType), toward});
    }
    const drag = this.#drag;
    if (drag?.kind === 'pinch') this.#pinch(event.pointerId, pixel);
    this.#pointers.set(event.pointerId, pixel);
    if (!drag || drag.kind === 'pinch' || (!drag.moved && apart(pixel, drag.from) < drag.still)) return;
    drag.moved = true;
    clearTimeout(this.#timer);
    const world = chart.view.toWorld(pixel);
    if (drag.kind === 'waypoint') chart.changed({pending: {i: drag.i, ...rounded(world)}, selected: drag.i});
    else if (drag.kind === 'area') chart.changed({area: corners(chart.view.toWorld(drag.from), world), toward: null});
    else chart.panned(pixel.u - drag.last.u, pixel.v - drag.last.v);
    drag.last = pixel;
  }

  #up(event) {
    if (!this.#pointers.delete(event.pointerId)) return;
    clearTimeout(this.#timer);
    const drag = this.#drag;
    // The finger left over from a pinch does nothing until it is lifted, too.
    if (!this.#pointers.size) this.#drag = null;
    if (!drag || drag.kind === 'pinch' || drag.kind === 'menu') return;
    if (!drag.moved) this.#click(drag);
    else if (drag.kind === 'waypoint') this.chart.move();
    else if (drag.kind === 'area') this.chart.areaDrawn();
  }

  #drop(event) {
    this.#pointers.delete(event.pointerId);
    this.#abandon(this.#pointers.size ? 'pinch' : null);
  }

  #abandon(kind) {
    clearTimeout(this.#timer);
    if (this.#drag?.kind === 'waypoint') this.chart.changed({pending: null});
    if (this.#drag?.kind === 'area' && this.#drag.moved) this.chart.changed({area: null});
    this.#drag = kind && {kind};
  }

  #click({kind, i, from}) {
    const {chart} = this;
    const world = rounded(chart.view.toWorld(from));
    if (kind === 'area') this.#vertex(from, world);
    else if (kind === 'waypoint') chart.changed({selected: i});
    else if (chart.mode === 'measure') chart.measure(world);
    else if (chart.mode === 'add' && chart.may()) chart.add(world);
    else chart.changed({selected: null});
  }

  /** A click while an area is drawn: one more corner; on the first or again on the last one: the area is complete. */
  #vertex(pixel, world) {
    const {chart} = this;
    const points = chart.area ?? [];
    const on = p => p && apart(chart.view.toScreen(p), pixel) < REACH.mouse;
    if (points.length >= 3 && (on(points[0]) || on(points.at(-1)))) chart.areaDrawn();
    else if (!on(points.at(-1))) chart.changed({area: [...points, world]});
  }

  #pinch(id, pixel) {
    const old = [...this.#pointers.values()];
    const now = [...this.#pointers].map(([key, p]) => (key === id ? pixel : p));
    if (now.length !== 2) return;
    const middle = ([p, q]) => ({u: (p.u + q.u) / 2, v: (p.v + q.v) / 2});
    const [from, to] = [middle(old), middle(now)];
    if (!this.chart.follow) this.chart.panned(to.u - from.u, to.v - from.v);
    this.chart.zoomed(apart(...now) / Math.max(apart(...old), 1), to);
  }

  #wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
    // Browsers report a pinch on a touch pad as a wheel with Ctrl, in small steps.
    const gain = event.ctrlKey ? 0.01 : 0.0015;
    this.chart.zoomed(Math.exp(-event.deltaY * lines * gain), this.#pixel(event));
  }

  #pressed(pixel) {
    this.#abandon('menu');
    this.chart.menu(pixel, this.#hit(pixel, 'touch'));
  }

  #menu(event) {
    event.preventDefault();
    if (this.#drag) return; // a long press, seen to by our own timer
    const pixel = this.#pixel(event);
    this.chart.menu(pixel, this.#hit(pixel, event.pointerType));
  }

  /** Escape is not among the keys: everywhere in the console it means STOP. */
  #key(event) {
    const acts = {
      Delete: () => this.chart.remove(),
      Backspace: () => this.chart.remove(),
      '+': () => this.chart.zoomed(1.4),
      '=': () => this.chart.zoomed(1.4),
      '-': () => this.chart.zoomed(1 / 1.4),
      Enter: () => this.chart.drawing() && this.chart.areaDrawn(),
    };
    const act = acts[event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    act();
  }
}
