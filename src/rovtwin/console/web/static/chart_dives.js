/** Tracks of earlier dives, as thin lines with their names; none is shown until somebody picks it. */
import {colour} from '/static/canvas.js';
import {label} from '/static/chart_rulers.js';

const DASHES = [[], [8, 4], [2, 4], [10, 4, 2, 4]]; // one after the other, to tell lines apart

export class Dives {
  runs = null; // of the shelf, once they were asked for
  folder = '';
  #shown = new Map(); // by run: {name, date, lines}

  constructor(changed) {
    this.changed = changed;
  }

  has = run => this.#shown.has(run);
  get count() { return this.#shown.size; }

  async look() {
    const {folder, runs} = await (await fetch('/replay/runs')).json();
    Object.assign(this, {folder, runs});
  }

  /** Shows the track of a run, or takes it away; rejects with the reason where there is none. */
  async show({run, name, date}, on) {
    if (!on) this.#shown.delete(run);
    else {
      const found = await (await fetch(`/chart/track?run=${encodeURIComponent(run)}`)).json();
      if (found.error) throw new Error(found.error);
      this.#shown.set(run, {name, date, lines: found.lines});
    }
    this.changed();
  }

  draw(context, view) {
    [...this.#shown.values()].forEach(({name, date, lines}, i) => {
      context.beginPath();
      for (const line of lines) {
        line.forEach(([x, y], k) => {
          const {u, v} = view.toScreen({x, y});
          if (k) context.lineTo(u, v);
          else context.moveTo(u, v);
        });
      }
      for (const [style, width, dash] of [[colour('bg'), 3.5, []], [colour('muted'), 1.5, DASHES[i % DASHES.length]]]) {
        context.strokeStyle = style; // an edge below, for any map
        context.lineWidth = width;
        context.setLineDash(dash);
        context.stroke();
      }
      context.setLineDash([]);
      const [x, y] = lines.at(-1)?.at(-1) ?? [];
      if (x === undefined) return;
      const {u, v} = view.toScreen({x, y});
      label(context, `${name}, ${date}`, u + 6, v, 'left');
    });
  }
}
