/** Maps of the user's own under the chart, as tiles that the server has warped to north and east. */

const AT_ONCE = 4; // tiles that are on their way
const KEPT = 400; // tiles
const FROM = 5; // levels up, at most, from which a tile that is on its way is stood in for
const AGAIN = 700; // until a tile is asked for that the server had no time for [ms]
const BUSY = 202;

export class Maps {
  list = [];
  shown = new Set(); // numbers of maps
  strength = 0.8;
  #tiles = new Map(); // by key: a picture, null where there is nothing; undefined while it is on its way
  #queue = [];
  #coming = 0;

  constructor(changed) {
    this.changed = changed;
  }

  take(list) {
    if (JSON.stringify(list) === JSON.stringify(this.list)) return;
    this.list = list;
    this.shown = new Set(list.keys());
    this.#tiles = new Map();
  }

  draw(context, view) {
    this.#queue = []; // what was asked for and is not seen any more need not come
    context.imageSmoothingEnabled = true;
    context.globalAlpha = this.strength;
    this.list.forEach((map, number) => this.shown.has(number) && this.#drawOne(context, view, map, number));
    context.globalAlpha = 1;
    this.#fetch();
  }

  /** Where a map lies that is not under any part of the view, in words; "" where it is. */
  away(view, {north, east}) {
    const [low, high] = [view.toWorld({u: 0, v: view.height}), view.toWorld({u: view.width, v: 0})];
    const [up, right] = [[north, low.x, high.x], [east, low.y, high.y]].map(([[from, to], least, most]) =>
      (from > most ? from - most : to < least ? to - least : 0));
    if (!up && !right) return '';
    const words = [[up, 'north', 'south'], [right, 'east', 'west']].filter(([far]) => far)
      .map(([far, ahead, behind]) => `${Math.abs(far).toFixed(0)} m ${far > 0 ? ahead : behind}`);
    return `not here: it begins ${words.join(', ')}`;
  }

  #drawOne(context, view, map, number) {
    const fitting = Math.round(Math.log2(view.scale * (window.devicePixelRatio || 1)));
    const level = Math.min(Math.max(fitting, map.coarsest), map.finest);
    const size = map.side * 2 ** -level;
    const [low, high] = [view.toWorld({u: 0, v: view.height}), view.toWorld({u: view.width, v: 0})];
    const span = (from, to, [least, most]) => [Math.floor(Math.max(from, least) / size), Math.floor(Math.min(to, most) / size)];
    const [rows, columns] = [span(low.x, high.x, map.north), span(low.y, high.y, map.east)];
    for (let row = rows[0]; row <= rows[1]; row++) {
      for (let column = columns[0]; column <= columns[1]; column++) this.#drawTile(context, view, map, {number, level, row, column});
    }
  }

  #drawTile(context, view, map, place) {
    const {number, level, row, column} = place;
    const size = map.side * 2 ** -level;
    const at = view.toScreen({x: (row + 1) * size, y: column * size});
    const wide = size * view.scale;
    const shown = this.#tile(place, true);
    for (let up = 1; shown === undefined && up <= FROM && level - up >= map.coarsest; up++) {
      const parent = {number, level: level - up, row: row >> up, column: column >> up};
      const picture = this.#tile(parent, false);
      if (!picture) continue;
      const part = map.side / 2 ** up;
      const [right, above] = [column - (parent.column << up), (parent.row + 1 << up) - row - 1];
      context.drawImage(picture, right * part, above * part, part, part, at.u, at.v, wide, wide);
      return;
    }
    if (shown) context.drawImage(shown, at.u, at.v, wide, wide);
  }

  #tile({number, level, row, column}, ask) {
    const key = `${number}/${level}/${row}/${column}`;
    if (ask && !this.#tiles.has(key)) this.#queue.push(key);
    return this.#tiles.get(key);
  }

  #fetch() {
    while (this.#coming < AT_ONCE && this.#queue.length) this.#get(this.#queue.shift());
  }

  async #get(key) {
    this.#coming += 1;
    this.#tiles.set(key, undefined);
    try {
      const answer = await fetch(`/map/${key}.png`);
      if (answer.status === BUSY) throw new Error(await answer.text());
      this.#tiles.set(key, answer.status === 200 ? await createImageBitmap(await answer.blob()) : null);
      if (this.#tiles.size > KEPT) this.#tiles.delete(this.#tiles.keys().next().value);
    } catch {
      setTimeout(() => { this.#tiles.delete(key); this.changed(); }, AGAIN);
    }
    this.#coming -= 1;
    this.changed();
    this.#fetch();
  }
}
