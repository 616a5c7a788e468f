/** Draws the depth over the time of a rehearsed flight: planned, predicted with its band, flown, hull and floor. */
import {colour, FONT} from '/static/canvas.js';
import {clock, ticks} from '/static/plots_draw.js';

const LEFT = 40; // room for depths [px]
const BELOW = 18; // room for times [px]
const SPARE = 0.08; // of the depths, above and below

/** Least and largest depth that is drawn; a floor far below is not. */
function span({depth, low, high, hull, floor, planned}, flown) {
  const shown = [...depth, ...(low ?? []), ...(high ?? []), ...planned.map(([, d]) => d), ...(flown ?? []), ...(hull ?? [])];
  const [least, most] = [Math.min(...shown), Math.max(...shown)];
  const lowest = floor?.length ? Math.max(...floor) : most;
  const end = lowest < most + 1.5 * Math.max(most - least, 1) ? lowest : most;
  const room = SPARE * Math.max(end - least, 0.5);
  return [least - room, end + room];
}

export function drawProfile(context, width, height, message) {
  const {profile} = message;
  context.fillStyle = colour('bg');
  context.fillRect(0, 0, width, height);
  if (!profile?.t.length) return;
  const flown = message.flown?.track.depth;
  const [least, most] = span(profile, flown);
  const end = profile.t.at(-1);
  const x = t => LEFT + t / end * (width - LEFT - 8);
  const y = depth => 6 + (depth - least) / (most - least) * (height - BELOW - 6);
  axes(context, {x, y, least, most, end, width, height});
  context.save();
  context.beginPath();
  context.rect(LEFT, 6, width - LEFT - 8, height - BELOW - 6);
  context.clip();
  const along = values => values.map((value, i) => [x(profile.t[i]), y(value)]);
  if (profile.floor) fill(context, [...along(profile.floor), [x(end), height], [x(0), height]], 'truth', 0.35);
  if (profile.low) fill(context, [...along(profile.high), ...along(profile.low).reverse()], 'predicted', 0.3);
  if (profile.hull) line(context, along(profile.hull), 'warn', 1.4, [2, 3]);
  line(context, profile.planned.map(([t, depth]) => [x(t), y(depth)]), 'plan', 1.4, [6, 4]);
  line(context, along(profile.depth), 'predicted', 2);
  if (flown) line(context, along(flown.slice(0, profile.t.length)), 'track', 2);
  context.restore();
}

function axes(context, {x, y, least, most, end, width, height}) {
  context.font = `11px ${FONT}`;
  context.strokeStyle = colour('line');
  context.fillStyle = colour('muted');
  context.lineWidth = 1;
  const depths = ticks(least, most, Math.max(2, height / 40));
  const digits = Math.max(0, -Math.floor(Math.log10(depths.step) + 1e-9));
  context.textAlign = 'right';
  context.textBaseline = 'middle';
  for (const depth of depths.found) {
    rule(context, LEFT, y(depth), width - 8, y(depth));
    context.fillText(depth.toFixed(digits), LEFT - 6, y(depth));
  }
  context.textAlign = 'center';
  context.textBaseline = 'top';
  const step = [5, 10, 15, 30, 60, 120, 300, 600, 1200, 3600].find(s => end / s <= Math.max(width / 80, 1)) ?? 7200;
  for (let t = 0; t <= end; t += step) {
    rule(context, x(t), 6, x(t), height - BELOW);
    context.fillText(clock(t), Math.min(x(t), width - 18), height - BELOW + 4);
  }
}

function rule(context, ...[x1, y1, x2, y2]) {
  context.globalAlpha = 0.35;
  line(context, [[x1, y1], [x2, y2]], 'line', 1);
  context.globalAlpha = 1;
}

function line(context, points, name, width, dash = []) {
  context.beginPath();
  points.forEach(([a, b]) => context.lineTo(a, b));
  context.strokeStyle = colour(name);
  context.lineWidth = width;
  context.setLineDash(dash);
  context.stroke();
  context.setLineDash([]);
}

function fill(context, points, name, alpha) {
  context.beginPath();
  points.forEach(([a, b]) => context.lineTo(a, b));
  context.fillStyle = colour(name);
  context.globalAlpha = alpha;
  context.fill();
  context.globalAlpha = 1;
}
