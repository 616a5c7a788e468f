/** The floor that the vehicle's eyes have seen, as a layer of the chart: message `swath`; of a replay all of it at once. */
import {FONT, colour, edgedText} from '/static/canvas.js';
import {live} from '/static/live.js';

const ONCE = 0.34; // how strongly a cell is painted that was seen once, and more often
const MORE = 0.66;
const NEVER = 65535;
const LARGE = 200000; // cells of a picture that is not painted anew for every step of a replay
const COARSE = 0.5; // [s]
const WORDS = 46; // a gap that is smaller on the screen has no figure [px]
const HATCH = 7; // from line to line in a gap [px]

/** Bytes of a block in base64 that zlib has packed. */
async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Response(stream).arrayBuffer();
}

/** The cells of one eye as a picture, north up, painted anew when time, cells or theme are others. */
class Picture {
  constructor(cells, numbers) {
    Object.assign(this, {cells, numbers, canvas: document.createElement('canvas'), key: ''});
    this.canvas.width = cells.columns;
    this.canvas.height = cells.rows;
  }

  /** How often cell i was seen by a time: 0, 1, or 2 for more often. */
  #passes(i, now) {
    const {numbers, cells} = this;
    if (cells.step === undefined) return numbers[i];
    const by = when => when !== NEVER && when <= now;
    return by(numbers[i]) + by(numbers[i + cells.rows * cells.columns]);
  }

  /** The step of a time; of a large picture, which takes the browser a while, one every COARSE. */
  #now(t) {
    const {begin, step, rows, columns} = this.cells;
    if (step === undefined) return 0;
    const every = rows * columns > LARGE ? Math.max(1, Math.round(COARSE / step)) : 1;
    return every * Math.floor((t - begin) / step / every);
  }

  /** Area seen by a time [m2]. */
  seen(t) {
    const now = this.#now(t);
    if (this.counted?.now !== now) {
      let count = 0;
      for (let i = 0; i < this.cells.rows * this.cells.columns; i++) count += this.#passes(i, now) > 0;
      this.counted = {now, area: count * this.cells.cell ** 2};
    }
    return this.counted.area;
  }

  at(t) {
    const now = this.#now(t);
    const shade = colour('seen');
    if (this.key !== `${shade}${now}`) {
      this.key = `${shade}${now}`;
      this.#paint(now, [1, 3, 5].map(k => parseInt(shade.slice(k, k + 2), 16)));
    }
    return this.canvas;
  }

  #paint(now, [red, green, blue]) {
    const {rows, columns} = this.cells;
    const image = new ImageData(columns, rows);
    const alpha = [0, Math.round(255 * ONCE), Math.round(255 * MORE)];
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        const passes = this.#passes(row * columns + column, now);
        if (!passes) continue;
        image.data.set([red, green, blue, alpha[passes]], 4 * ((rows - 1 - row) * columns + column));
      }
    }
    this.canvas.getContext('2d').putImageData(image, 0, 0);
  }
}

export class Swath {
  message = null;
  shown = true;
  name = null; // of the eye that was picked; null: the first
  #pictures = new Map(); // by eye
  #turn = 0;

  constructor(changed) {
    this.changed = changed;
    live.on('swath', message => this.#take(message));
    live.on('setup', ({swath}) => swath && this.#fetch(swath));
  }

  get eye() {
    const eyes = this.message?.eyes ?? [];
    return eyes.find(one => one.name === this.name) ?? eyes[0] ?? null;
  }

  get picture() {
    return this.eye && this.#pictures.get(this.eye.name);
  }

  /** Why nothing is painted at a time, "" where something is. */
  why(t) {
    const {eye} = this;
    return eye?.course ? eye.course.findLast(([since]) => since <= t)?.[1] ?? '' : eye?.why ?? '';
  }

  async #fetch(address) {
    if (address === this.asked) return;
    this.asked = address;
    const answer = await fetch(address);
    if (answer.ok) live.emit('swath', await answer.json());
  }

  async #take(message) {
    const turn = ++this.#turn;
    const pictures = await Promise.all(message.eyes.map(async ({name, cells}) => {
      if (!cells) return [name, null];
      const old = this.#pictures.get(name);
      if (old && old.cells.data === cells.data) return [name, Object.assign(old, {cells})];
      const block = await unpacked(cells.data);
      return [name, new Picture(cells, cells.step === undefined ? new Uint8Array(block) : new Uint16Array(block))];
    }));
    if (turn !== this.#turn) return; // a newer one came meanwhile
    this.message = message;
    this.#pictures = new Map(pictures);
    this.changed();
  }

  draw(context, view, t) {
    if (!this.message?.eyes.length || !this.shown) return;
    const {picture, eye, message} = this;
    if (picture) {
      const {cell, north, east, rows, columns} = picture.cells;
      const {u, v} = view.toScreen({x: north + rows * cell, y: east});
      context.imageSmoothingEnabled = false;
      context.drawImage(picture.at(t), u, v, columns * cell * view.scale, rows * cell * view.scale);
    }
    if (message.area) outline(context, message.area.map(([x, y]) => view.toScreen({x, y})));
    if (eye.began !== null) (eye.found?.gaps ?? []).forEach(gap => drawGap(context, view, gap));
  }
}

function trace(context, pixels) {
  pixels.forEach(({u, v}, i) => (i ? context.lineTo(u, v) : context.moveTo(u, v)));
  context.closePath();
}

function outline(context, pixels) {
  context.beginPath();
  trace(context, pixels);
  context.strokeStyle = colour('seen');
  context.lineWidth = 1.5;
  context.stroke();
}

let hatch = {shade: '', pattern: null};
function hatching(context, shade) {
  if (hatch.shade === shade) return hatch.pattern;
  const tile = Object.assign(document.createElement('canvas'), {width: HATCH, height: HATCH});
  const inside = tile.getContext('2d');
  inside.strokeStyle = shade;
  inside.lineWidth = 1;
  inside.beginPath();
  for (const at of [-HATCH, 0, HATCH]) {
    inside.moveTo(at, HATCH);
    inside.lineTo(at + HATCH, 0);
  }
  inside.stroke();
  hatch = {shade, pattern: context.createPattern(tile, 'repeat')};
  return hatch.pattern;
}

function drawGap(context, view, {rings, area_m2: area}) {
  const pixels = rings.map(ring => ring.map(([x, y]) => view.toScreen({x, y})));
  context.beginPath();
  pixels.forEach(ring => trace(context, ring));
  context.globalAlpha = 0.55;
  context.fillStyle = hatching(context, colour('warn'));
  context.fill('evenodd');
  context.globalAlpha = 1;
  context.strokeStyle = colour('warn');
  context.lineWidth = 1.5;
  context.setLineDash([5, 3]);
  context.stroke();
  context.setLineDash([]);
  const [across, down] = ['u', 'v'].map(key => pixels[0].map(one => one[key]));
  const [left, right, top, bottom] = [Math.min(...across), Math.max(...across), Math.min(...down), Math.max(...down)];
  if (Math.max(right - left, bottom - top) < WORDS) return;
  context.font = `12px ${FONT}`;
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  edgedText(context, squareMetres(area), (left + right) / 2, (top + bottom) / 2, colour('text'), colour('bg'));
}

/** An area in words. */
export const squareMetres = area => `${area.toFixed(area < 10 ? 1 : 0)} m²`;
