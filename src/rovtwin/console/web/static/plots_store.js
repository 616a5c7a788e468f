/** The newest ten minutes of what is plotted, in arrays of fixed length. */
import {LINES} from '/static/plots_channels.js';

export const SPAN = 600; // longest window [s]
const STEP = 0.05; // between two readings that are kept, at least [s]
export const ROOM = Math.ceil(1.2 * SPAN / STEP); // more than a window, so that one that is held stays a while

export class Store {
  count = 0; // readings ever kept; the i-th lies at i % ROOM
  t = new Float64Array(ROOM);
  columns = new Map(); // of a channel: {value: Float32Array, ...}, only lines that have ever been there

  known = false; // all of a run, as a replay has it; `now` is the time that is shown [s]
  now = 0;

  /** Takes all of a run: from now on `add` says which of its times is shown. */
  know(states, channels) {
    Object.assign(this, {known: false, count: 0, end: 0});
    for (const state of states) this.add(state, channels);
    Object.assign(this, {known: true, now: this.count ? this.at(0) : 0});
  }

  /** Keeps a state's channels; time that goes back (a replay rewound, a twin started anew) takes away what came after. */
  add(state, channels) {
    if (!Number.isFinite(state.t) || !Array.isArray(state.eta)) return false;
    if (this.known) {
      this.now = state.t;
      return true;
    }
    while (this.count && this.at(this.count - 1) > state.t) this.count--;
    if (this.count < this.first) this.count = 0;
    if (this.count && state.t < this.at(this.count - 1) + 0.98 * STEP) return false;
    const slot = this.count % ROOM;
    this.t[slot] = state.t;
    for (const channel of channels) this.#put(channel, slot, channel.lines(state));
    this.count++;
    this.end = Math.max(this.end ?? 0, this.count);
    return true;
  }

  #put({id}, slot, lines) {
    let column = this.columns.get(id);
    if (!column) this.columns.set(id, column = {});
    for (const line of LINES) {
      const value = lines[line];
      if (!column[line]) {
        if (!Number.isFinite(value)) continue;
        column[line] = new Float32Array(ROOM).fill(NaN);
      }
      column[line][slot] = Number.isFinite(value) ? value : NaN;
    }
  }

  /** Oldest reading that is still there. */
  get first() {
    return Math.max(0, (this.end ?? 0) - ROOM);
  }

  at(i) {
    return this.t[i % ROOM];
  }

  get newest() {
    if (this.known) return this.now;
    return this.count ? this.at(this.count - 1) : 0;
  }

  /** A line's readings, the i-th at i % ROOM; undefined where there never was one. */
  column(id, line) {
    return this.columns.get(id)?.[line];
  }

  /** Number of the first reading at or after a time. */
  from(t) {
    let [low, high] = [this.first, this.count];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.at(middle) < t) low = middle + 1;
      else high = middle;
    }
    return low;
  }
}
