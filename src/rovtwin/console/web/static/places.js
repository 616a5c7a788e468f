/** How places are written: metres, or latitude and longitude where the scenario gives a datum; chosen once for all views. */
import {make} from '/static/canvas.js';
import {Datum} from '/static/geodesy.js';
import {live} from '/static/live.js';

export const WAYS = [['m', 'metres'], ['deg', 'degrees'], ['min', 'degrees, minutes']];
const SIDES = {latitude: ['N', 'S', 90], longitude: ['E', 'W', 180]};
const KEPT = 'rovtwin-places';
const ANGLE = /^\s*([-+\u2212]?)(\d+(?:[.,]\d+)?)\s*[°d]?\s*(?:(\d+(?:[.,]\d+)?)\s*['\u2032m]?\s*)?(?:(\d+(?:[.,]\d+)?)\s*(?:["\u2033s]|'')?\s*)?([NSEW]?)\s*$/i;

const watching = new Set();
let datum = null;
let way = localStorage.getItem(KEPT) ?? 'm';

/** Calls `changed` whenever places are written in another way; gives a function that ends it. */
export function onPlaces(changed) {
  watching.add(changed);
  return () => watching.delete(changed);
}

/** Whether latitude and longitude are known. */
export const onMap = () => Boolean(datum);

/** The way that is chosen, one of WAYS; metres where nothing else is known. */
export const placesAs = () => (datum ? way : 'm');

export function writePlacesAs(chosen) {
  way = chosen;
  localStorage.setItem(KEPT, way);
  watching.forEach(changed => changed());
}

/** The next of the ways. */
export function turnPlaces() {
  const names = WAYS.map(([name]) => name);
  writePlacesAs(names[(names.indexOf(placesAs()) + 1) % names.length]);
}

/** An angle [deg] as people write it, `key` is latitude or longitude: 63.4500450° N, or 63° 27.00270′ N. */
export function angleText(value, key, digits = 6) {
  const [plus, minus] = SIDES[key];
  const side = value < 0 ? minus : plus;
  const size = Math.abs(value);
  if (placesAs() !== 'min') return `${size.toFixed(digits)}° ${side}`;
  const scale = 10 ** (digits - 2);
  const minutes = Math.round(size * 60 * scale) / scale; // first, or 59.99999 would become 60
  const whole = Math.floor(minutes / 60 + 1e-12);
  return `${whole}° ${(minutes - 60 * whole).toFixed(digits - 2).padStart(digits + 1, '0')}′ ${side}`;
}

/** Latitude and longitude of a place {x, y} and, where it is known, its depth [deg]; null without a datum. */
export const geodetic = place => datum?.geodetic(place) ?? null;

/** A place on the map in words, "" without a datum. */
export function mapText(place) {
  const at = geodetic(place);
  return at ? `${angleText(at.latitude, 'latitude')}, ${angleText(at.longitude, 'longitude')}` : '';
}

/** The angle [deg] that was typed: degrees, degrees and minutes, or also seconds; null where it is none. */
export function angleOf(text, key) {
  const parts = text.match(ANGLE);
  if (!parts) return null;
  const [, sign, ...rest] = parts;
  const side = rest.pop().toUpperCase();
  const [plus, minus, most] = SIDES[key];
  const [degrees, minutes, seconds] = rest.map(part => Number((part ?? '0').replace(',', '.')));
  const fraction = rest[1] !== undefined && !Number.isInteger(degrees); // 63.45° 27′ is a mistake
  const size = degrees + minutes / 60 + seconds / 3600;
  if ((side && ![plus, minus].includes(side)) || (sign && side) || minutes >= 60 || seconds >= 60 || fraction || size > most) return null;
  return sign === '-' || sign === '\u2212' || side === minus ? -size : size;
}

/** A list to choose the way from; hidden where only metres are known. */
export function placesChoice() {
  const choice = make('select', {id: 'places-as', 'aria-label': 'Places are written in'}, ...WAYS.map(([value, text]) => make('option', {value}, text)));
  choice.addEventListener('change', () => writePlacesAs(choice.value));
  const show = () => {
    choice.hidden = !onMap();
    choice.value = placesAs();
  };
  show();
  return {element: choice, release: onPlaces(show)};
}

/** Puts a text where it can be pasted from; over plain HTTP browsers have only the old way. */
export async function copied(text) {
  if (navigator.clipboard) return navigator.clipboard.writeText(text);
  const box = make('textarea', {class: 'unseen'});
  box.value = text;
  document.body.append(box);
  box.select();
  const done = document.execCommand('copy');
  box.remove();
  if (!done) throw new Error('the browser copies nothing on this page');
}

live.on('setup', setup => {
  const before = JSON.stringify(datum?.origin);
  datum = setup.datum ? new Datum(setup.datum) : null;
  if (JSON.stringify(datum?.origin) !== before) watching.forEach(changed => changed());
});
