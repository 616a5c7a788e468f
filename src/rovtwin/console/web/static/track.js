/** Where a vehicle was: points in the order of its time, thinned as they come. */

const GAP = 5; // without a reading for so long, the line is broken [s]

export class Track {
  /** Keeps the last `span` seconds, points `step` metres apart, `most` of them (then the step doubles). */
  constructor({span = 600, step = 0.05, most = 3000} = {}) {
    Object.assign(this, {span, step, most, points: []});
  }

  /** Takes all of a run, [{t, x, y}]: from now on `add` shows what lies before its time. */
  know(readings) {
    const all = new Track({span: Infinity, step: this.step, most: this.most});
    readings.forEach(reading => all.add(reading));
    this.known = all.points;
  }

  /**
   * Adds where the vehicle is, {t, x, y}. Time that goes back (a replay rewound, a twin started anew) takes away what
   * had come after. The newest reading is always the last point, whether it will be kept or not.
   */
  add({t, x, y}) {
    if (this.known) {
      this.points = this.known.slice(0, later(this.known, t));
      this.points.push({t, x, y, gap: !this.points.length});
      return;
    }
    const points = this.points;
    while (points.length && points.at(-1).t > t) points.pop();
    const [last, before] = [points.at(-1), points.at(-2)];
    const gap = !last || t - last.t > GAP;
    const near = last && before && !last.gap && Math.hypot(last.x - before.x, last.y - before.y) < this.step;
    if (near && !gap) points.pop();
    points.push({t, x, y, gap});
    const old = points.findIndex(p => p.t >= t - this.span);
    if (old > 0) points.splice(0, old);
    if (points.length > this.most) this.#coarsen();
  }

  #coarsen() {
    this.step *= 2;
    let kept = null;
    this.points = this.points.filter((p, i, all) => {
      const stays = !kept || p.gap || i === all.length - 1 || Math.hypot(p.x - kept.x, p.y - kept.y) >= this.step;
      if (stays) kept = p;
      return stays;
    });
  }
}

/** Number of the first of things {t} in the order of time that is later than a time. */
function later(things, t) {
  let [low, high] = [0, things.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (things[middle].t <= t) low = middle + 1;
    else high = middle;
  }
  return low;
}
