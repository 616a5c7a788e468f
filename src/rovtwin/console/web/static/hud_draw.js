/** Draws the head-up display. Angles in radians as they come, on screen in degrees. */
import {FONT, colour, edgedText} from '/static/canvas.js';
import {depthUnder, hudLines} from '/static/hud_words.js';

const DEGREE = Math.PI / 180;
const TAPE = 45; // degrees to either side on the heading tape
const LADDER = 5.5; // pixels per degree of pitch, at full size
const REACH = 22; // rungs farther from the vehicle's pitch are left out [degrees]

/** How large everything is, from the room there is: 1 at 800 x 450. */
const sizeOf = ({width, height}) => Math.min(Math.max(Math.min(width / 800, height / 450), 0.62), 1.5);

/** One picture: `size` {width, height} in CSS pixels, `model` {state, setup}, `stale` as of hud.js. */
export function drawHud(context, size, model, stale) {
  const {state} = model;
  if (!state) return;
  const pen = new Pen(context, sizeOf(size));
  if (state.markers?.length && state.picture) drawMarkers(pen, size, state);
  if (state.eta) {
    drawLadder(pen, size, state.eta);
    drawTape(pen, size, state);
    drawValues(pen, size, model);
  }
  drawWords(pen, size, model);
  if (stale) drawStale(pen, size, stale);
}

/** Lines and words with a dark edge, legible over any picture; lengths in units of the display's size. */
class Pen {
  constructor(context, unit) {
    Object.assign(this, {context, unit});
    context.lineCap = context.lineJoin = 'round';
  }

  lines(segments, style = colour('hud'), width = 2, dash = []) {
    const {context, unit} = this;
    context.beginPath();
    for (const [first, ...rest] of segments) {
      context.moveTo(...first);
      rest.forEach(point => context.lineTo(...point));
    }
    context.setLineDash(dash);
    for (const [ink, wide] of [[colour('hud-edge'), width + 2.5], [style, width]]) {
      context.strokeStyle = ink;
      context.lineWidth = wide * unit;
      context.stroke();
    }
    context.setLineDash([]);
  }

  text(text, u, v, {style = colour('hud'), size = 15, align = 'center', bold = false} = {}) {
    const {context, unit} = this;
    context.font = `${bold ? '700' : '500'} ${Math.max(size * unit, 11)}px ${FONT}`;
    context.textAlign = align;
    context.textBaseline = 'middle';
    edgedText(context, text, u, v, style, colour('hud-edge'));
  }

  box(u, v, width, height, style = colour('hud-edge')) {
    this.context.fillStyle = style;
    this.context.beginPath();
    this.context.roundRect(u, v, width, height, 4 * this.unit);
    this.context.fill();
  }
}

/** Angle in (-180, 180], from radians. */
const difference = angle => {
  const turn = (angle / DEGREE) % 360;
  return turn > 180 ? turn - 360 : turn <= -180 ? turn + 360 : turn;
};

function drawTape(pen, {width}, {eta, reference}) {
  const heading = ((eta[5] / DEGREE) % 360 + 360) % 360;
  const s = pen.unit;
  const half = Math.min(width * 0.36, 330 * s);
  const [middle, base] = [width / 2, 44 * s];
  const at = degrees => middle + (degrees / TAPE) * half;
  const ticks = [];
  for (let mark = Math.ceil((heading - TAPE) / 5) * 5; mark <= heading + TAPE; mark += 5) {
    const u = at(mark - heading);
    ticks.push([[u, base], [u, base - (mark % 15 ? 5 : 10) * s]]);
    const name = {0: 'N', 45: 'NE', 90: 'E', 135: 'SE', 180: 'S', 225: 'SW', 270: 'W', 315: 'NW'}[(mark + 360) % 360];
    const covered = Math.abs(u - middle) < 48 * s;
    const text = name ?? (mark % 15 ? '' : String((mark + 360) % 360));
    if (!covered && text) pen.text(text, u, base - 20 * s, {size: name ? 16 : 13, bold: Boolean(name)});
  }
  pen.lines([[[middle - half, base], [middle + half, base]], ...ticks], colour('hud'), 1.5);
  if (reference) {
    const u = at(Math.max(-TAPE, Math.min(TAPE, difference(reference[5] - eta[5]))));
    const foot = base + 12 * s;
    pen.lines([[[u - 7 * s, foot], [u, base + 3 * s], [u + 7 * s, foot]]], colour('hud-reference'), 2.5);
  }
  pen.box(middle - 31 * s, 6 * s, 62 * s, 28 * s);
  pen.text(`${String(Math.round(heading) % 360).padStart(3, '0')}°`, middle, 20.5 * s, {size: 21, bold: true});
}

/** Horizon and ladder turn with roll and shift with pitch; the vehicle's own mark stays. */
function drawLadder(pen, {width, height}, [, , , roll, pitch]) {
  const {context, unit: s} = pen;
  const [u, v] = [width / 2, height / 2 + 10 * s];
  context.save();
  context.translate(u, v);
  context.rotate(-roll);
  context.translate(0, (pitch / DEGREE) * LADDER * s);
  for (let mark = -90; mark <= 90; mark += 10) {
    if (Math.abs(mark - pitch / DEGREE) > REACH) continue;
    const line = -mark * LADDER * s;
    const [inner, outer] = mark ? [55 * s, 95 * s] : [55 * s, 190 * s];
    const foot = Math.sign(mark) * 7 * s;
    const rungs = [-1, 1].map(side => [[side * inner, line + foot], [side * inner, line], [side * outer, line]]);
    pen.lines(rungs, colour('hud'), mark ? 1.5 : 2, mark < 0 ? [7 * s, 5 * s] : []);
    if (mark) [-1, 1].forEach(side => pen.text(String(Math.abs(mark)), side * (outer + 14 * s), line, {size: 12}));
  }
  context.restore();
  const wings = [[-34, 0], [-12, 0], [0, 9], [12, 0], [34, 0]];
  pen.lines([wings.map(([a, b]) => [u + a * s, v + b * s])], colour('hud-warn'), 3);
}

/** Speed at the left; depth and altitude at the right. */
function drawValues(pen, {width, height}, {state, setup}) {
  const s = pen.unit;
  const value = (name, text, unit, u, v, {align, style, bold = true}) => {
    pen.text(name, u, v - 25 * s, {align, size: 12, style: colour('hud-muted')});
    pen.text(text, u, v, {align, size: 27, bold, style});
    pen.text(unit, u, v + 22 * s, {align, size: 12, style: colour('hud-muted')});
  };
  const [left, right, middle] = [18 * s, width - 18 * s, height / 2];
  value('SURGE', (state.nu?.[0] ?? 0).toFixed(2), 'm/s', left, middle, {align: 'left'});
  const altitude = depthUnder(state, setup);
  const shift = altitude ? 42 * s : 0;
  value('DEPTH', state.eta[2].toFixed(2), 'm', right, middle - shift, {align: 'right'});
  if (!altitude) return;
  const style = colour(altitude.old ? 'hud-muted' : 'hud');
  const unit = altitude.old ? `m, ${altitude.old}` : 'm';
  value('ALTITUDE', altitude.text, unit, right, middle + shift, {align: 'right', style});
}

/** Mode at the lower left, the way along the plan at the lower right. */
function drawWords(pen, {width, height}, {state}) {
  const s = pen.unit;
  const {left, right} = hudLines(state);
  left.forEach(({text, level, small}, i) => {
    const v = height - (22 + 25 * (left.length - 1 - i)) * s;
    pen.text(text, 18 * s, v, {align: 'left', size: small ? 15 : 19, bold: !small, style: colour(level)});
  });
  right.forEach(({text, small}, i) => {
    const v = height - (22 + 27 * (right.length - 1 - i)) * s;
    pen.text(text, width - 18 * s, v, {align: 'right', size: small ? 15 : 22, bold: !small});
  });
}

/** Where a picture of so many pixels lies in the element that shows all of it, as `object-fit: contain` puts it. */
export function pictureBox({width, height}, [wide, high]) {
  const scale = Math.min(width / wide, height / high);
  return {scale, u: (width - wide * scale) / 2, v: (height - high * scale) / 2};
}

function drawMarkers(pen, size, {markers, picture}) {
  const {scale, u, v} = pictureBox(size, picture);
  for (const {id, corners} of markers) {
    const outline = corners.map(([a, b]) => [u + a * scale, v + b * scale]);
    pen.lines([[...outline, outline[0]]], colour('hud-ok'), 2);
    const [top, right] = [Math.min(...outline.map(p => p[1])), Math.max(...outline.map(p => p[0]))];
    pen.text(String(id), right + 4, top - 4, {align: 'left', size: 13, bold: true, style: colour('hud-ok')});
  }
}

function drawStale(pen, {width, height}, {what, age}) {
  const s = pen.unit;
  const text = `${what} ${age < 100 ? age.toFixed(1) : Math.round(age)} s`;
  pen.context.strokeStyle = colour('hud-danger');
  pen.context.lineWidth = 6;
  pen.context.strokeRect(3, 3, width - 6, height - 6);
  pen.context.font = `700 ${Math.max(30 * s, 11)}px ${FONT}`;
  const wide = pen.context.measureText(text).width + 36 * s;
  const v = height * 0.27;
  pen.box((width - wide) / 2, v - 26 * s, wide, 52 * s, colour('hud-danger'));
  pen.context.fillStyle = colour('video');
  pen.context.textAlign = 'center';
  pen.context.textBaseline = 'middle';
  pen.context.fillText(text, width / 2, v + s);
}
