/** What a rehearsal says, in words. */
import {clock, lasting} from '/static/clock.js';

export const percent = share => `${Math.round(100 * share)} %`;

/** A figure with the interval of drawn flights. */
function between({value, low, high}, words) {
  return low === undefined ? words(value) : `${words(value)} (${words(low)} to ${words(high)})`;
}

const wattHours = value => `${value.toFixed(value < 10 ? 2 : 1)} Wh`;

/** What was flown, and how sure the corridor is. */
export function basis({vehicle, identified, drawn_from: from, draws, alike, level, whole, water}) {
  const model = `${vehicle}, ${identified ? 'as it was identified' : 'as described: it was not identified'}; ${water}`;
  if (!whole) return [model];
  if (level === null) return [model, `No corridor: only ${alike} of ${draws} drawn vehicles come as far as the vehicle as it is known.`];
  const few = alike < draws ? `the ${alike} of ${draws} that come as far` : `all ${draws}`;
  return [model, `${draws} vehicles drawn from ${from}. Bands and intervals are the least and the largest of ${few}: `
    + `one more lies between them with ${percent(level)}.`];
}

/** Pairs of a name and a figure. */
export function figures(message) {
  const {time_s: time, energy_wh: energy, charge, charge_by: by, margin, nearest_m: nearest, floor_by: floorBy} = message;
  const rows = [['Time', `${between(time, clock)} min`], ['Energy', between(energy, wattHours)]];
  rows.push(['Battery left', charge ? `${between(charge, percent)}; ${by}` : by]);
  if (margin !== null) rows.push(['Least thrust left', percent(Math.max(margin, 0))]);
  for (const [name, least] of Object.entries(nearest)) {
    const source = name === 'the floor' && floorBy ? `, by ${floorBy}` : '';
    rows.push([`Hull to ${name}`, least > 0 ? `${least.toFixed(2)} m or more${source}` : `touches it${source}`]);
  }
  return rows;
}

/** When a way-point is reached. */
export const arrival = ({reached, early, late}) => (early === undefined ? clock(reached) : `${clock(reached)} (${clock(early)} to ${clock(late)})`);

/** What is left of the most loaded thruster's force on the way there. */
export const thrustLeft = ({margin, least_margin: least}) => (least === undefined ? percent(margin) : `${percent(margin)} (${percent(least)})`);

const VERDICTS = {
  inside: 'The flight is one that was predicted.',
  near: 'The flight is beside what was predicted, by little.',
  outside: 'The model does not predict this flight: look for what has changed of vehicle or water, then identify anew.',
  unknown: 'There is nothing to compare: no corridor, or no way-point was reached.',
};
const WAITING = 'The corridor is still being computed: the flight is held against it when the log closes (Disarm).';
const LEVELS = {inside: 'ok', near: 'warning', outside: 'error', unknown: 'note'};

/** {level, what} of the flight as a whole. */
export const verdict = ({verdict: word}, whole = true) => ({level: LEVELS[word], what: word === 'unknown' && !whole ? WAITING : VERDICTS[word]});

const AXES = {across: 'Across the leg', depth: 'Depth', heading: 'Heading'};

function path({axis, unit, inside, least_usual: usual, beyond, verdict: word}) {
  const away = word === 'inside' ? '' : `, up to ${beyond.toPrecision(2)} ${unit} beyond`;
  return {level: LEVELS[word], name: AXES[axis], what: `${percent(inside)} inside (drawn flights ${percent(usual)} or more)${away}`};
}

const change = ratio => `${ratio >= 1 ? '+' : '\u2212'}${Math.round(Math.abs(100 * (ratio - 1)))} %`;

function force({axis, ratio, interval_95: [low, high], verdict: word}) {
  return {level: LEVELS[word], name: `Force, ${axis}`, what: `${change(ratio)} against the prediction (95 %: ${change(low)} to ${change(high)})`};
}

function beside(name, found, words) {
  if (!found) return [];
  const {predicted, flown, inside, by} = found;
  const source = by ? `, by ${by}` : '';
  return [{level: inside === false ? 'warning' : 'ok', name, what: `${words(flown)}, predicted ${words(predicted)}${source}`}];
}

/** Rows {level, name, what} of predicted against flown. */
export function compared(flown) {
  return [...flown.axes.map(path), ...flown.effort.map(force), ...beside('Time', flown.time_s, lasting), ...beside('Energy', flown.energy_wh, wattHours)];
}

/** What is going on, or why nothing is. */
export function going(message) {
  if (!message) return '';
  const {busy, doing, share, seconds, why, asked, stale, again} = message;
  if (busy) return `${doing}${share === null ? '' : `, ${percent(share)}`} · ${clock(seconds)}`;
  if (why) return why;
  if (stale) return again ? 'Plan or water have changed: rehearsed again in a moment.' : 'Plan or water have changed since: Rehearse again.';
  return asked ? '' : 'Not rehearsed yet.';
}
