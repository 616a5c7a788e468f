/** The tool that measures on the chart: legs between clicks, all of them together, and the area that they enclose. */
import {colour} from '/static/canvas.js';
import {area} from '/static/geometry.js';

const DOT = 4; // [px]

/** A length in words. */
export const lengthText = metres => (metres >= 1000 ? `${(metres / 1000).toFixed(3)} km` : `${metres.toFixed(metres < 10 ? 2 : 1)} m`);

/** The direction from one point to another, clockwise from north [deg], in three digits. */
export function bearingText(from, to) {
  const degrees = Math.round(Math.atan2(to.y - from.y, to.x - from.x) * 180 / Math.PI);
  return `${String((degrees + 360) % 360).padStart(3, '0')}°`;
}

export class Ruler {
  points = [];

  add(point) {
    this.points.push(point);
  }

  clear() {
    this.points = [];
  }

  /** The newest leg, up to where the pointer is; beyond the first also the length of all and, as if closed, the area. */
  text(cursor) {
    const all = cursor ? [...this.points, cursor] : this.points;
    if (!this.points.length) return 'Click where to measure from';
    const legs = all.slice(1).map((point, i) => Math.hypot(point.x - all[i].x, point.y - all[i].y));
    if (!legs.length) return 'Click where to measure to';
    const newest = `${lengthText(legs.at(-1))}, ${bearingText(all.at(-2), all.at(-1))}`;
    if (legs.length === 1) return newest;
    const size = area(all);
    return `${newest} · all ${lengthText(legs.reduce((sum, leg) => sum + leg, 0))} · area ${size.toFixed(size < 10 ? 2 : 1)} m²`;
  }
}

export function drawRuler(context, view, {points}, cursor) {
  if (!points.length) return;
  const pixels = (cursor ? [...points, cursor] : points).map(point => view.toScreen(point));
  context.beginPath();
  pixels.forEach(({u, v}, i) => (i ? context.lineTo(u, v) : context.moveTo(u, v)));
  for (const [style, width] of [[colour('bg'), 5], [colour('text'), 2]]) {
    context.strokeStyle = style;
    context.lineWidth = width;
    context.stroke();
  }
  context.fillStyle = colour('text');
  for (const {u, v} of pixels) {
    context.beginPath();
    context.arc(u, v, DOT, 0, 2 * Math.PI);
    context.fill();
  }
}
