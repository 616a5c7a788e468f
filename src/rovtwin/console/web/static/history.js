/** All of a replayed run at once, thinned, for the lines that views draw behind the vehicle: message `track`. */
import {live} from '/static/live.js';

/** States from the block of numbers that `console/replays/history.py` makes; what is not there is left out. */
export function unfold(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const numbers = new Float32Array(buffer, 4 + length);
  const columns = header.columns.map(([path, width]) => [path.split('.'), width]);
  const states = [];
  let at = 0;
  for (let i = 0; i < header.count; i++) {
    const state = {t: header.start + i * header.step, sensors: {}, nis: {}};
    for (const [path, width] of columns) {
      const value = width ? Array.from(numbers.subarray(at, at + width)) : numbers[at];
      at += width || 1;
      if (!Number.isNaN(width ? value[0] : value)) put(state, path, value);
    }
    states.push(state);
  }
  return states;
}

function put(state, path, value) {
  let place = state;
  for (const step of path.slice(0, -1)) place = place[step] ??= {};
  place[path.at(-1)] = value;
}

let asked = null;
live.on('setup', async ({history}) => {
  if (!history || history === asked) return;
  asked = history;
  const answer = await fetch(history);
  if (answer.ok) live.emit('track', unfold(await answer.arrayBuffer()));
});
