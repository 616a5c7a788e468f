/** Places on the map of places in the plane of n: WGS-84, as core/datum.py has them, which converts what is typed. */

const SEMI_MAJOR = 6378137; // [m]
const FLATTENING = 1 / 298.257223563;
const SQUARED = FLATTENING * (2 - FLATTENING); // of the first eccentricity
const SEMI_MINOR = SEMI_MAJOR * (1 - FLATTENING);
const SECOND = SQUARED / (1 - SQUARED); // squared, of the second eccentricity
const RADIAN = Math.PI / 180;

/** The origin of n on the map. */
export class Datum {
  constructor({latitude, longitude, height = 0}) {
    const [sb, cb, sl, cl] = [latitude, longitude].flatMap(angle => [Math.sin(angle * RADIAN), Math.cos(angle * RADIAN)]);
    const radius = SEMI_MAJOR / Math.sqrt(1 - SQUARED * sb * sb);
    this.origin = [(radius + height) * cb * cl, (radius + height) * cb * sl, (radius * (1 - SQUARED) + height) * sb];
    this.axes = [[-sb * cl, -sb * sl, cb], [-sl, cl, 0], [-cb * cl, -cb * sl, -sb]]; // north, east, down
  }

  /** Latitude and longitude [deg] of a place north, east and down [m]; by Bowring's formula, exact to some micrometres. */
  geodetic({x, y, depth = 0}) {
    const [u, v, w] = this.origin.map((value, k) => value + x * this.axes[0][k] + y * this.axes[1][k] + depth * this.axes[2][k]);
    const out = Math.hypot(u, v);
    const reduced = Math.atan2(w * SEMI_MAJOR, out * SEMI_MINOR);
    const up = w + SECOND * SEMI_MINOR * Math.sin(reduced) ** 3;
    const latitude = Math.atan2(up, out - SQUARED * SEMI_MAJOR * Math.cos(reduced) ** 3);
    return {latitude: latitude / RADIAN, longitude: Math.atan2(v, u) / RADIAN};
  }
}
