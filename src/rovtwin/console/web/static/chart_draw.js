/** Draws the chart: what lies in the plane (`drawChart`). Everything here only reads. */
import {FONT, colour} from '/static/canvas.js';
import {drawRuler} from '/static/chart_measure.js';
import {faultsOf} from '/static/faults.js';
import {drawAxes, drawRoses, drawScaleBar, label} from '/static/chart_rulers.js';
import {layer as rehearsal} from '/static/rehearsal_layer.js';
import {ellipseAxes, placed, thinned} from '/static/geometry.js';

const SMALLEST = 28; // a vehicle that would be shorter than this is drawn as an arrow of this length [px]
const POINT = 11; // radius of a way-point's disc [px]
const DOT = 4; // and of its dot, where discs would lie on each other [px]

/** One picture. `chart` holds view, model (last messages), track and what is being edited (see chart.js). */
export function drawChart(context, chart) {
  const {view, model} = chart;
  const state = model.state;
  context.fillStyle = colour('bg');
  context.fillRect(0, 0, view.width, view.height);
  context.lineJoin = context.lineCap = 'round';
  chart.layers.maps.draw(context, view);
  drawAxes(context, view);
  chart.swath.draw(context, view, state?.t ?? 0);
  drawRoom(context, view, model.setup);
  chart.layers.dives.draw(context, view);
  rehearsal.draw(context, view);
  drawLegs(context, chart);
  drawTrack(context, view, chart.track.points);
  drawWaypoints(context, chart);
  if (chart.outline) drawArea(context, view, chart.outline);
  if (chart.mode === 'measure') drawRuler(context, view, chart.ruler, chart.cursor);
  // Above all that was planned: nothing hides where the vehicle is.
  if (state?.eta) drawVehicle(context, view, state, model.setup?.size ?? [0.5, 0.4, 0.3]);
  drawScaleBar(context, view);
  drawRoses(context, view, state?.current, model.setup?.waves);
}

function trace(context, pixels, closed = false) {
  context.beginPath();
  pixels.forEach(({u, v}, i) => (i ? context.lineTo(u, v) : context.moveTo(u, v)));
  if (closed) context.closePath();
}

function stroke(context, style, width, dash = []) {
  context.strokeStyle = style;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.stroke();
  context.setLineDash([]);
}


function rectangle(context, view, [south, north], [west, east]) {
  const [p, q] = [view.toScreen({x: north, y: west}), view.toScreen({x: south, y: east})];
  context.beginPath();
  context.rect(p.u, p.v, q.u - p.u, q.v - p.v);
  return p;
}

function drawRoom(context, view, setup) {
  if (setup?.room?.kind === 'tank') {
    const corner = rectangle(context, view, setup.room.x, setup.room.y);
    stroke(context, colour('text'), 3);
    label(context, 'tank', corner.u + 6, corner.v + 12, 'left');
  }
  for (const outline of setup?.fence?.outlines ?? []) {
    const corners = outline.map(([x, y]) => view.toScreen({x, y}));
    trace(context, corners, true);
    stroke(context, colour('danger'), 1.5, [10, 5]);
    label(context, 'fence', corners[0].u + 6, corners[0].v - 10, 'left', colour('danger'));
  }
  if (setup?.home) drawHome(context, view.toScreen({x: setup.home[0], y: setup.home[1]}));
}

function drawHome(context, {u, v}) {
  const house = [[-8, 0], [0, -8], [8, 0], [6, 0], [6, 7], [-6, 7], [-6, 0]];
  trace(context, house.map(([a, b]) => ({u: u + a, v: v + b})), true);
  context.fillStyle = colour('bg');
  context.fill();
  stroke(context, colour('text'), 1.5);
}

/** The flown plan solid, its current leg in the accent's colour, the draft dashed where it differs. */
function drawLegs(context, {view, model, draft}) {
  const flown = (model.plan?.flown ?? []).map(p => view.toScreen(p));
  const drafted = draft().map(p => view.toScreen(p));
  trace(context, flown);
  stroke(context, colour('plan'), 2);
  for (const {u, v} of flown) {
    context.fillStyle = colour('plan');
    context.fillRect(u - 3, v - 3, 6, 6);
  }
  if (model.state?.on_leg && model.state.leg) {
    trace(context, model.state.leg.map(([x, y]) => view.toScreen({x, y})));
    stroke(context, colour('accent'), 4);
  }
  if (drafted.some((p, i) => p.u !== flown[i]?.u || p.v !== flown[i]?.v)) {
    trace(context, drafted);
    stroke(context, colour('plan'), 1.5, [7, 6]);
  }
}

/** Discs with numbers; where they would lie on each other dots, and discs of those that matter now. */
function drawWaypoints(context, chart) {
  const pixels = chart.draft().map(p => chart.view.toScreen(p));
  const gaps = pixels.slice(1).map((p, i) => Math.hypot(p.u - pixels[i].u, p.v - pixels[i].v));
  const crowded = gaps.some(gap => gap > 0 && gap < 2 * POINT);
  const last = pixels.length - 1;
  const faults = faultsOf(chart.model.plan?.checks);
  const matters = i => i === 0 || i === last || i === chart.selected || i === chart.hover || faults.has(i);
  pixels.forEach((p, i) => crowded && !matters(i) && drawDot(context, p));
  pixels.forEach((p, i) => (!crowded || matters(i)) && drawWaypoint(context, p, i, chart, faults.get(i)?.level));
}

function drawDot(context, {u, v}) {
  context.beginPath();
  context.arc(u, v, DOT, 0, 2 * Math.PI);
  context.fillStyle = colour('bg');
  context.fill();
  stroke(context, colour('plan'), 1.5);
}

const RINGS = {error: 'danger', warning: 'warn'};

function drawWaypoint(context, {u, v}, i, {selected, hover}, fault) {
  const [chosen, near] = [i === selected, i === hover];
  if (fault) {
    context.beginPath();
    context.arc(u, v, POINT + 5, 0, 2 * Math.PI);
    stroke(context, colour(RINGS[fault]), 4);
  }
  context.beginPath();
  context.arc(u, v, POINT + (chosen || near ? 2 : 0), 0, 2 * Math.PI);
  context.fillStyle = chosen ? colour('accent') : colour('bg');
  context.fill();
  stroke(context, chosen ? colour('accent') : colour('plan'), near ? 3 : 2);
  context.font = `600 12px ${FONT}`;
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  context.fillStyle = chosen ? colour('on-accent') : colour('text');
  context.fillText(String(i + 1), u, v + 1);
}

function drawTrack(context, view, points) {
  const pixels = thinned(points.map(p => ({...view.toScreen(p), gap: p.gap})));
  context.beginPath();
  pixels.forEach(({u, v, gap}) => (gap ? context.moveTo(u, v) : context.lineTo(u, v)));
  stroke(context, colour('track'), 2);
}

/** A hull seen from above, bow ahead; an arrow where that would be too small to see. */
export function hull([length, beam], scale) {
  if (Math.max(length, beam) * scale < SMALLEST) {
    const l = SMALLEST / 2 / scale;
    return [[l, 0], [-l, 0.75 * l], [-0.5 * l, 0], [-l, -0.75 * l]];
  }
  const [l, b] = [length / 2, beam / 2];
  return [[l, 0], [0.45 * l, b], [-l, b], [-0.8 * l, 0], [-l, -b], [0.45 * l, -b]];
}

function drawVehicle(context, view, state, size) {
  const at = ([x, y, , , , heading]) => placed(hull(size, view.scale), {x, y}, heading).map(p => view.toScreen(p));
  if (state.ellipse) drawEllipse(context, view, state);
  if (state.reference) drawReference(context, view.toScreen({x: state.reference[0], y: state.reference[1]}));
  if (state.truth) {
    trace(context, at(state.truth), true);
    stroke(context, colour('truth'), 1, [3, 2]);
  }
  const small = Math.max(...size.slice(0, 2)) * view.scale < SMALLEST;
  trace(context, at(state.eta), true);
  stroke(context, colour('bg'), 5);
  context.globalAlpha = small ? 1 : 0.35; // a hull lets what lies below it be read
  context.fillStyle = colour('track');
  context.fill();
  context.globalAlpha = 1;
  stroke(context, colour('text'), 1.5);
}

function drawEllipse(context, view, {eta, ellipse}) {
  const {long, short, angle} = ellipseAxes(ellipse);
  const {u, v} = view.toScreen({x: eta[0], y: eta[1]});
  context.beginPath();
  // The long axis lies `angle` from north over east; on screen angles grow from right over down.
  context.ellipse(u, v, long * view.scale, short * view.scale, angle - Math.PI / 2, 0, 2 * Math.PI);
  context.fillStyle = colour('track');
  context.globalAlpha = 0.2;
  context.fill();
  context.globalAlpha = 1;
  stroke(context, colour('track'), 1, [4, 3]);
}

function drawReference(context, {u, v}) {
  context.beginPath();
  for (const [a, b] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    context.moveTo(u + 4 * a, v + 4 * b);
    context.lineTo(u + 11 * a, v + 11 * b);
  }
  stroke(context, colour('bg'), 5);
  stroke(context, colour('reference'), 2.5);
}

function drawArea(context, view, outline) {
  const {points, toward, closed} = outline;
  const pixels = points.map(p => view.toScreen(p));
  trace(context, toward && !closed ? [...pixels, view.toScreen(toward)] : pixels, closed);
  context.globalAlpha = 0.2;
  context.fillStyle = colour('accent');
  context.fill();
  context.globalAlpha = 1;
  stroke(context, colour('accent'), 2, [6, 4]);
  for (const {u, v} of pixels) {
    context.fillStyle = colour('accent');
    context.fillRect(u - 4, v - 4, 8, 8);
  }
}
