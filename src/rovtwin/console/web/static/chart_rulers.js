/** What helps to read the chart: grid with coordinates, scale bar, arrows of current and waves. */
import {FONT, colour, edgedText} from '/static/canvas.js';
import {roundLength} from '/static/geometry.js';

const CELL = 70; // lines of the grid are at least so far apart [px]
const EDGE = 8;

/** Words on the chart, legible over its lines. */
export function label(context, text, u, v, align, style = colour('muted')) {
  context.font = `12px ${FONT}`;
  context.textAlign = align;
  context.textBaseline = 'middle';
  edgedText(context, text, u, v, style, colour('bg'));
}

const multiples = (low, high, step) => {
  const first = Math.ceil(low / step);
  return Array.from({length: Math.max(Math.floor(high / step) - first + 1, 0)}, (_, i) => (first + i) * step);
};

/** A number of metres with as many digits as steps of this length need. */
const metres = (value, step) => {
  const text = Math.abs(value).toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
  return value < -step / 2 ? `\u2212${text}` : text;
};

/** The grid's lines, their coordinates along the left and the lower edge. */
export function drawAxes(context, view) {
  const step = roundLength(CELL / view.scale, true);
  const [low, high] = [view.toWorld({u: 0, v: view.height}), view.toWorld({u: view.width, v: 0})];
  const north = multiples(low.x, high.x, step);
  const east = multiples(low.y, high.y, step);
  context.beginPath();
  for (const x of north) {
    const {v} = view.toScreen({x, y: 0});
    context.moveTo(0, v);
    context.lineTo(view.width, v);
  }
  for (const y of east) {
    const {u} = view.toScreen({x: 0, y});
    context.moveTo(u, 0);
    context.lineTo(u, view.height);
  }
  context.globalAlpha = 0.35;
  context.strokeStyle = colour('line');
  context.lineWidth = 1;
  context.stroke();
  context.globalAlpha = 1;
  for (const x of north) {
    const {v} = view.toScreen({x, y: 0});
    if (v > 70 && v < view.height - 90) label(context, `N ${metres(x, step)}`, EDGE, v, 'left');
  }
  for (const y of east) {
    const {u} = view.toScreen({x: 0, y});
    if (u > 60 && u < view.width - 180) label(context, `E ${metres(y, step)}`, u, view.height - 12, 'center');
  }
}

/** A bar of a round length, at the lower right. */
export function drawScaleBar(context, view) {
  const length = roundLength(130 / view.scale);
  const wide = length * view.scale;
  const [u, v] = [view.width - 16 - wide, view.height - 16];
  const bar = (style, width) => {
    context.beginPath();
    context.moveTo(u, v - 6);
    context.lineTo(u, v);
    context.lineTo(u + wide, v);
    context.lineTo(u + wide, v - 6);
    context.strokeStyle = style;
    context.lineWidth = width;
    context.stroke();
  };
  bar(colour('bg'), 5);
  bar(colour('text'), 2);
  const text = length >= 1000 ? `${length / 1000} km` : length >= 1 ? `${length} m` : `${Math.round(length * 100)} cm`;
  label(context, text, u + wide / 2, v - 9, 'center', colour('text'));
}

/** Current (where the water goes) and waves (where they run to) as arrows with values, at the upper right. */
export function drawRoses(context, view, current, waves) {
  const roses = [];
  if (current) {
    const speed = Math.hypot(current[0], current[1]);
    const to = Math.atan2(current[1], current[0]);
    roses.push({name: 'current', value: `${speed.toFixed(2)} m/s`, to, still: speed < 0.005});
  }
  if (waves) roses.push({name: 'waves', value: `${waves.height.toFixed(2)} m`, to: waves.direction, crests: true});
  roses.forEach((rose, i) => drawRose(context, {u: view.width - 146, v: 46 + 92 * i}, rose));
}

function drawRose(context, {u, v}, {name, value, to, still, crests}) {
  context.beginPath();
  context.arc(u, v, 24, 0, 2 * Math.PI);
  context.fillStyle = colour('bg');
  context.fill();
  context.strokeStyle = colour('line');
  context.lineWidth = 1;
  context.stroke();
  label(context, 'N', u, v - 31, 'center');
  if (!still) {
    context.save();
    context.translate(u, v);
    context.rotate(to);
    context.beginPath();
    context.moveTo(0, 19);
    context.lineTo(0, -18);
    context.moveTo(-6, -11);
    context.lineTo(0, -19);
    context.lineTo(6, -11);
    for (const at of crests ? [2, 8, 14] : []) {
      context.moveTo(-8, at);
      context.quadraticCurveTo(0, at - 5, 8, at);
    }
    context.strokeStyle = colour('water');
    context.lineWidth = 2.5;
    context.stroke();
    context.restore();
  }
  label(context, `${name} ${value}`, u, v + 34, 'center', colour('text'));
}
