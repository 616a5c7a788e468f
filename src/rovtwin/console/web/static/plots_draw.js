/** Draws one channel over time: band, lines, axes, what is under the cursor. */
import {colour, FONT} from '/static/canvas.js';
import {LINES} from '/static/plots_channels.js';
import {ROOM} from '/static/plots_store.js';

const LEFT = 52; // room for the numbers of the axis [px]
const BELOW = 18; // room for the times [px]
export const COLOURS = {value: 'track', reference: 'reference', truth: 'truth'};

/** Ticks at round numbers, about `many` of them. */
export function ticks(low, high, many) {
  const raw = (high - low) / Math.max(many, 1);
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find(m => m * power >= raw * 0.999);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return {step, found};
}

export const clock = t => `${t < 0 ? '-' : ''}${Math.floor(Math.abs(t) / 60)}:${String(Math.floor(Math.abs(t) % 60)).padStart(2, '0')}`;

/** A number with as many digits as a reader can use. */
export function digits(value) {
  if (!Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  return value.toFixed(size >= 1000 ? 0 : size >= 100 ? 1 : size >= 1 ? 2 : 3);
}

/**
 * Lines of a channel as functions of a reading's number. Headings go on beyond 0 and 360, so that none breaks; what goes
 * with them goes along.
 */
function readers(store, channel, first, last) {
  const made = {};
  for (const line of LINES) {
    const column = store.column(channel.id, line);
    if (column) made[line] = i => column[i % ROOM];
  }
  if (!channel.turns || !made.value) return made;
  const base = new Float32Array(Math.max(last - first, 0));
  let before = NaN;
  for (let i = first; i < last; i++) {
    const value = made.value(i);
    base[i - first] = Number.isFinite(before) ? near(value, before, channel.turns) : value;
    if (Number.isFinite(value)) before = base[i - first];
  }
  for (const [line, read] of Object.entries(made)) {
    made[line] = line === 'value' ? i => base[i - first] : i => near(read(i), base[i - first], channel.turns);
  }
  return made;
}

const near = (value, to, turns) => value - turns * Math.round((value - to) / turns);

/** Low and high of what is shown between two readings: all of the lines, and of the band as much again. */
function limits(channel, read, first, last) {
  let [low, high] = channel.least ?? [Infinity, -Infinity];
  const widen = (line, from, to) => {
    for (let i = first; read[line] && i < last; i++) {
      const value = read[line](i);
      if (value >= from && value <= to) { // false of what is not there
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
  };
  for (const line of Object.keys(COLOURS)) widen(line, -Infinity, Infinity);
  if (low <= high) {
    const more = Math.max(high - low, 0.02);
    const [from, to] = [low - more, high + more];
    widen('low', from, to);
    widen('high', from, to);
  }
  if (!(low <= high)) return [-1, 1];
  const half = Math.max(0.55 * (high - low), 1e-4 * Math.abs(high + low), 1e-3);
  return [(low + high) / 2 - half, (low + high) / 2 + half];
}

/**
 * Draws a channel in a window of time.
 *
 * `span`: {from, to, cursor: time under the pointer or null} [s]. Returns from a place on the canvas to a time.
 */
export function drawPlot(context, width, height, store, channel, span) {
  // In a replay the store has what comes after, too.
  const past = store.known ? 0 : 1;
  const [first, last] = [Math.max(store.from(span.from) - 1, store.first), Math.min(store.from(span.to + 1e-6) + past, store.count)];
  const read = readers(store, channel, first, last);
  const [low, high] = limits(channel, read, first, last);
  const [w, h] = [width - LEFT - 8, height - BELOW - 6];
  const x = t => LEFT + (t - span.from) / (span.to - span.from) * w;
  const y = channel.down ? v => 6 + (v - low) / (high - low) * h : v => 6 + (high - v) / (high - low) * h;
  axes(context, {x, y, w, h, low, high, span, channel});
  context.save();
  context.beginPath();
  context.rect(LEFT, 4, w, h + 4);
  context.clip();
  const shape = {store, channel, read, first, last, x, y, w};
  band(context, shape);
  for (const [line, name] of Object.entries(COLOURS).reverse()) stroke(context, shape, line, name);
  context.restore();
  if (span.cursor !== null) cursor(context, shape, span, h);
  return at => span.from + (at - LEFT) / w * (span.to - span.from);
}

function axes(context, {x, y, w, h, low, high, span, channel}) {
  context.font = `11px ${FONT}`;
  context.lineWidth = 1;
  context.strokeStyle = colour('line');
  context.fillStyle = colour('muted');
  const values = ticks(low, high, Math.max(2, h / 34));
  const shown = Math.max(0, -Math.floor(Math.log10(values.step) + 1e-9));
  context.textAlign = 'right';
  context.textBaseline = 'middle';
  for (const v of values.found) {
    rule(context, LEFT, y(v), LEFT + w, y(v));
    const label = channel.turns ? (v % channel.turns + channel.turns) % channel.turns : v;
    context.fillText(label.toFixed(shown), LEFT - 6, y(v));
  }
  const step = [5, 10, 15, 30, 60, 120, 300].find(s => (span.to - span.from) / s <= Math.max(w / 70, 1)) ?? 600;
  context.textAlign = 'center';
  context.textBaseline = 'top';
  for (let t = step * Math.ceil(span.from / step); t <= span.to; t += step) {
    rule(context, x(t), 6, x(t), 6 + h);
    if (t >= 0 && x(t) < LEFT + w - 10) context.fillText(clock(t), x(t), h + 10);
  }
}

function rule(context, ...[x1, y1, x2, y2]) {
  context.globalAlpha = 0.35;
  context.beginPath();
  context.moveTo(Math.round(x1) + 0.5, Math.round(y1) + 0.5);
  context.lineTo(Math.round(x2) + 0.5, Math.round(y2) + 0.5);
  context.stroke();
  context.globalAlpha = 1;
}

/** Of readings that share a pixel only those are drawn that are less or larger than before. */
function stroke(context, {store, read, first, last, x, y, w}, line, name) {
  if (!read[line]) return;
  const dense = last - first > 2 * w;
  context.strokeStyle = colour(name);
  context.lineWidth = line === 'value' ? 1.8 : 1.4;
  context.setLineDash(line === 'reference' ? [6, 4] : []);
  context.lineJoin = 'round';
  context.beginPath();
  let [drawn, pixel, low, high] = [false, NaN, NaN, NaN];
  for (let i = first; i < last; i++) {
    const value = read[line](i);
    if (!Number.isFinite(value)) {
      drawn = false;
      continue;
    }
    const at = x(store.at(i));
    if (drawn && dense && Math.floor(at) === pixel && value >= low && value <= high) continue;
    if (drawn) context.lineTo(at, y(value));
    else context.moveTo(at, y(value));
    const same = drawn && Math.floor(at) === pixel;
    [low, high] = same ? [Math.min(low, value), Math.max(high, value)] : [value, value];
    [drawn, pixel] = [true, Math.floor(at)];
  }
  context.stroke();
  context.setLineDash([]);
}

function band(context, {store, channel, read, first, last, x, y, w}) {
  if (!read.low || !read.high) return;
  const every = Math.max(1, Math.floor((last - first) / (2 * w)));
  context.fillStyle = colour(channel.expected ? 'ok' : 'track');
  context.globalAlpha = 0.22;
  let run = [];
  const fill = () => {
    context.beginPath();
    run.forEach(i => context.lineTo(x(store.at(i)), y(read.high(i))));
    run.reverse().forEach(i => context.lineTo(x(store.at(i)), y(read.low(i))));
    if (run.length > 1) context.fill();
    run = [];
  };
  for (let i = first; i < last; i += every) {
    if (Number.isFinite(read.high(i))) run.push(i);
    else fill();
  }
  fill();
  context.globalAlpha = 1;
}

function cursor(context, {store, read, x, y}, span, h) {
  const i = nearest(store, span.cursor);
  if (i === null) return;
  const at = x(store.at(i));
  context.strokeStyle = colour('text');
  context.lineWidth = 1;
  rule(context, at, 6, at, 6 + h);
  for (const [line, name] of Object.entries(COLOURS)) {
    const value = read[line]?.(i);
    if (!Number.isFinite(value)) continue;
    context.beginPath();
    context.arc(at, y(value), 3.5, 0, 2 * Math.PI);
    context.fillStyle = colour(name);
    context.fill();
  }
}

/** Number of the reading nearest to a time; null where there is none. */
export function nearest(store, t) {
  if (store.count <= store.first) return null;
  const i = Math.min(store.from(t), store.count - 1);
  return i > store.first && t - store.at(i - 1) < store.at(i) - t ? i - 1 : i;
}
