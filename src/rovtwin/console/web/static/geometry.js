/** Plane geometry of the chart, without a page: points {x, y} north and east [m], pixels {u, v} right and down. */

const CHI_SQUARE_95 = 5.991; // of two degrees of freedom
const CLOSEST = 2000; // [px/m]
const FARTHEST = 0.02; // [px/m]

const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

/** Which part of the plane is seen, north up: the point in the middle, and pixels per metre. */
export class View {
  constructor(width = 1, height = 1, scale = 20, middle = {x: 0, y: 0}) {
    Object.assign(this, {width, height, scale, middle});
  }

  toScreen({x, y}) {
    const {width, height, scale, middle} = this;
    return {u: width / 2 + (y - middle.y) * scale, v: height / 2 - (x - middle.x) * scale};
  }

  toWorld({u, v}) {
    const {width, height, scale, middle} = this;
    return {x: middle.x - (v - height / 2) / scale, y: middle.y + (u - width / 2) / scale};
  }

  /** Moves the picture by pixels. */
  pan(du, dv) {
    this.middle = {x: this.middle.x + dv / this.scale, y: this.middle.y - du / this.scale};
  }

  /** Enlarges by a factor; what is under the pixel stays there. */
  zoom(factor, pixel = {u: this.width / 2, v: this.height / 2}) {
    const kept = this.toWorld(pixel);
    this.scale = clamp(this.scale * factor, FARTHEST, CLOSEST);
    const moved = this.toScreen(kept);
    this.pan(pixel.u - moved.u, pixel.v - moved.v);
  }

  /**
   * Shows all of a box {low, high} with room for a margin [px]; a lone point at 40 px/m. What lies over the upper and
   * the right edge, {top, right} [px], hides none of it where there is room. `closest` bounds the scale [px/m].
   */
  fit(box, margin = 60, {top = 0, right = 0} = {}, closest = CLOSEST) {
    const [north, east] = [box.high.x - box.low.x, box.high.y - box.low.y];
    const room = (size, covered) => Math.max(size - covered - 2 * margin, size / 4);
    const scale = Math.min(room(this.height, top) / (north || 1e-9), room(this.width, right) / (east || 1e-9));
    this.scale = clamp(north || east ? scale : 40, FARTHEST, closest);
    const [x, y] = [(box.low.x + box.high.x) / 2, (box.low.y + box.high.y) / 2];
    this.middle = {x: x + top / 2 / this.scale, y: y + right / 2 / this.scale};
  }
}

/** The smallest box around points, or null where there is none. */
export function boxOf(points) {
  if (!points.length) return null;
  const [north, east] = [points.map(p => p.x), points.map(p => p.y)];
  return {low: {x: Math.min(...north), y: Math.min(...east)}, high: {x: Math.max(...north), y: Math.max(...east)}};
}

/** The largest of 1, 2, 5 times a power of ten that is at most `value` (rounding up: at least). */
export function roundLength(value, up = false) {
  const power = 10 ** Math.floor(Math.log10(value) + 1e-9);
  const steps = [1, 2, 5, 10].map(step => step * power);
  return up ? steps.find(step => step >= value * (1 - 1e-9)) : steps.findLast(step => step <= value * (1 + 1e-9));
}

/** Half axes [m] of the 95 % ellipse of a covariance [[xx, xy], [xy, yy]] [m2] and the long one's angle from north. */
export function ellipseAxes([[xx, xy], [, yy]]) {
  const mean = (xx + yy) / 2;
  const half = Math.hypot((xx - yy) / 2, xy);
  const axis = variance => Math.sqrt(CHI_SQUARE_95 * Math.max(variance, 0));
  return {long: axis(mean + half), short: axis(mean - half), angle: Math.atan2(2 * xy, xx - yy) / 2};
}

/** Points of an outline in the body's frame (x ahead, y starboard), as a vehicle at x, y with this heading has them. */
export function placed(outline, {x, y}, heading) {
  const [c, s] = [Math.cos(heading), Math.sin(heading)];
  return outline.map(([ahead, starboard]) => ({x: x + c * ahead - s * starboard, y: y + s * ahead + c * starboard}));
}

/** Area of a polygon of points [m2]. */
export function area(points) {
  const parts = points.map((p, i) => {
    const q = points[(i + 1) % points.length];
    return p.x * q.y - q.x * p.y;
  });
  return Math.abs(parts.reduce((sum, part) => sum + part, 0)) / 2;
}

/** The four corners of a box between two points, in order around it. */
export const corners = (p, q) => [{x: p.x, y: p.y}, {x: p.x, y: q.y}, {x: q.x, y: q.y}, {x: q.x, y: p.y}];

/** The leg of a path a point is nearest to: i of the leg from points[i] to points[i + 1]; null with fewer than two. */
export function nearestLeg(points, at) {
  let best = null;
  let least = Infinity;
  for (let i = 0; i + 1 < points.length; i++) {
    const [p, q] = [points[i], points[i + 1]];
    const [dx, dy] = [q.x - p.x, q.y - p.y];
    const share = clamp(((at.x - p.x) * dx + (at.y - p.y) * dy) / (dx * dx + dy * dy || 1), 0, 1);
    const distance = Math.hypot(at.x - p.x - share * dx, at.y - p.y - share * dy);
    if (distance < least) [least, best] = [distance, i];
  }
  return best;
}

/**
 * Where to insert a way-point before (side = -1) or after (side = 1) number i: midway to its neighbour; beyond an end
 * half of the last leg further on; beside a lone one `aside` [m] to the east.
 */
export function beside(points, i, side, aside = 1) {
  const here = points[i];
  const next = points[i + side];
  if (next) return {x: (here.x + next.x) / 2, y: (here.y + next.y) / 2};
  const back = points[i - side];
  if (!back) return {x: here.x, y: here.y + side * aside};
  return {x: here.x + (here.x - back.x) / 2, y: here.y + (here.y - back.y) / 2};
}

/** Leaves out pixels closer than `least` to the last one kept; first and last stay, so does one after a gap. */
export function thinned(pixels, least = 1.5) {
  const kept = [];
  pixels.forEach((p, i) => {
    const last = kept.at(-1);
    const stays = !last || p.gap || i === pixels.length - 1;
    if (stays || Math.hypot(p.u - last.u, p.v - last.v) >= least) kept.push(p);
  });
  return kept;
}
