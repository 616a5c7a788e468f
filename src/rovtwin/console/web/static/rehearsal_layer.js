/** The rehearsed track and its corridor on the chart, and over them the track as flown. */
import {colour} from '/static/canvas.js';
import {live} from '/static/live.js';

export const layer = {
  message: null,
  stale: false,
  shown: true,
  changed: () => {}, // the chart's

  /** Draws what was rehearsed; fainter where plan or water have changed since. */
  draw(context, view) {
    const {track, flown} = this.message ?? {};
    if (!this.shown || !track?.place.length) return;
    const at = places => places.map(([x, y]) => view.toScreen({x, y}));
    const faint = this.stale ? 0.4 : 1;
    if (track.port) corridor(context, at(track.port), at(track.starboard), 0.28 * faint);
    context.globalAlpha = faint;
    path(context, at(track.place), 'predicted', 2, []);
    if (flown) path(context, at(flown.track.place), 'track', 2, []);
    context.globalAlpha = 1;
  },
};

/** All in one path, so that pieces which overlap at corners are not darker. */
function corridor(context, port, starboard, alpha) {
  context.beginPath();
  for (let i = 1; i < port.length; i++) {
    const piece = [port[i - 1], port[i], starboard[i], starboard[i - 1]];
    const twice = piece.reduce((sum, p, k) => sum + p.u * piece[(k + 1) % 4].v - piece[(k + 1) % 4].u * p.v, 0);
    (twice < 0 ? piece.reverse() : piece).forEach(({u, v}, k) => (k ? context.lineTo(u, v) : context.moveTo(u, v)));
    context.closePath();
  }
  context.fillStyle = colour('predicted');
  context.globalAlpha = alpha;
  context.fill('nonzero');
  context.globalAlpha = 1;
}

function path(context, pixels, name, width, dash) {
  context.beginPath();
  pixels.forEach(({u, v}) => context.lineTo(u, v));
  context.strokeStyle = colour(name);
  context.lineWidth = width;
  context.setLineDash(dash);
  context.stroke();
  context.setLineDash([]);
}

live.on('rehearsal', message => { layer.message = message; });
live.on('rehearsing', message => { layer.stale = message.stale; });
