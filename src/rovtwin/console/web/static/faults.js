/** Which way-points the checks of a plan are of, and how grave: for the table's rows and the chart's marks. */

const GRAVE = {warning: 1, error: 2};
const NAMED = /way-points? (\d+(?: to \d+)?(?:, \d+(?: to \d+)?)*)/g;

/** Numbers from 0 of the way-points that a text names: "way-point 3", "way-points 2 to 4, 9". */
export function named(text) {
  const found = new Set();
  for (const [, numbers] of text.matchAll(NAMED)) {
    for (const span of numbers.split(', ')) {
      const [first, last = first] = span.split(' to ').map(Number);
      for (let i = first; i <= last; i++) found.add(i - 1);
    }
  }
  return [...found].sort((a, b) => a - b);
}

/** Way-points that a check is of, numbers from 0. */
export const pointsOf = check => (check.points?.length ? check.points : named(check.what));

/** By number from 0: {level, what} of way-points with a warning or an error, all that is known of each. */
export function faultsOf(checks) {
  const faults = new Map();
  for (const check of (checks ?? []).filter(one => one.level in GRAVE)) {
    for (const i of pointsOf(check)) {
      const before = faults.get(i);
      const level = before && GRAVE[before.level] > GRAVE[check.level] ? before.level : check.level;
      faults.set(i, {level, what: before ? `${before.what}\n${check.what}` : check.what});
    }
  }
  return faults;
}
