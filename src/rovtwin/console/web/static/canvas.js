/** What the drawn views share: finding their element, a canvas that follows its size, the theme's colours. */
import {live} from '/static/live.js';

export const FONT = 'Roboto, system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';
const surfaces = new Set();
let palette = new Map();

/** A colour of the theme by its name, e.g. `colour('track')`; read from the page once per theme. */
export function colour(name) {
  if (!palette.has(name)) palette.set(name, live.css(`--${name}`).trim());
  return palette.get(name);
}

new MutationObserver(() => {
  palette = new Map();
  surfaces.forEach(redraw => redraw());
}).observe(document.body, {attributes: true, attributeFilter: ['class']});

/**
 * Builds a view in the element with this id as soon as it is there, and again when the page replaces it: NiceGUI
 * mounts its elements after modules have run, and takes them away when a tab is changed.
 *
 * `build(element)` returns a function that lets go of what it started.
 */
export function mount(id, build) {
  let element = null;
  let release = null;
  const look = () => {
    const found = document.getElementById(id);
    if (found === element) return;
    release?.();
    element = found;
    release = found ? build(found) : null;
  };
  new MutationObserver(look).observe(document.body, {childList: true, subtree: true});
  look();
}

/**
 * Keeps `draw(context, width, height)`, in CSS pixels, up to date on a canvas: when its size, the screen's pixel ratio or
 * the theme changes, and when asked by `redraw()`; at most once per frame, never while hidden.
 */
export function surface(canvas, draw) {
  const context = canvas.getContext('2d');
  let asked = 0;
  const frame = () => {
    asked = 0;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !height) return;
    const [wide, high] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (canvas.width !== wide || canvas.height !== high) Object.assign(canvas, {width: wide, height: high});
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    draw(context, width, height);
  };
  const redraw = () => { asked ||= requestAnimationFrame(frame); };
  const observer = new ResizeObserver(redraw);
  observer.observe(canvas);
  surfaces.add(redraw);
  redraw();
  return {
    redraw,
    release() {
      observer.disconnect();
      surfaces.delete(redraw);
      cancelAnimationFrame(asked);
    },
  };
}

/** An element with attributes and children: `make('button', {class: 'wide', onclick}, 'Text', other)`. */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith('on')) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, '');
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}
