/** Thrusters as bars: the command of each within -1..1, what it still can do, who is at a limit and who is lost. */
import {live} from '/static/live.js';
import {make, mount} from '/static/canvas.js';

const LOST = 0.05; // below this share of its thrust a thruster counts as lost
const FULL = 0.99; // of what it can do: at its limit

const model = {state: null, setup: null};
let shown = null;

/** What to show of one thruster with command `u` and `health`, the share of its thrust it still gives. */
export function reading(u, health = 1) {
  const lost = health < LOST;
  const full = !lost && Math.abs(u) >= FULL;
  const word = lost ? 'lost' : full ? 'at limit' : health < 0.95 ? `${Math.round(100 * health)} % left` : '';
  const sign = u < 0 ? '\u2212' : u > 0 ? '+' : '';
  return {lost, full, weak: !lost && health < 0.95, word, value: `${sign}${Math.abs(u).toFixed(2)}`};
}

class Row {
  constructor(name) {
    this.name = name;
    this.fill = make('i', {class: 'thruster-fill'});
    this.gone = ['astern', 'ahead'].map(end => make('i', {class: `thruster-gone thruster-${end}`}));
    this.bar = make(
      'div',
      {class: 'thruster-bar', role: 'meter', 'aria-label': name, 'aria-valuemin': -1, 'aria-valuemax': 1},
      ...this.gone,
      this.fill,
      make('i', {class: 'thruster-zero'}),
    );
    this.value = make('span', {class: 'thruster-value'});
    this.word = make('span', {class: 'thruster-word'});
    const label = make('span', {class: 'thruster-name', title: name}, name);
    this.element = make('div', {class: 'thruster'}, label, this.bar, this.value, this.word);
  }

  show(u, health) {
    const {lost, full, weak, word, value} = reading(u, health);
    this.fill.style.transform = `scaleX(${Math.max(-1, Math.min(1, u))})`;
    this.gone.forEach(part => { part.style.transform = `scaleX(${1 - Math.max(0, Math.min(1, health))})`; });
    for (const [name, on] of Object.entries({lost, full, weak})) this.element.classList.toggle(`is-${name}`, on);
    if (this.value.textContent !== value) {
      this.value.textContent = value;
      this.bar.setAttribute('aria-valuenow', u.toFixed(2));
      this.bar.setAttribute('aria-valuetext', word ? `${value}, ${word}` : value);
    }
    if (this.word.textContent !== word) this.word.textContent = word;
  }
}

class Bars {
  #asked = 0;
  #rows = [];
  #names = '';

  constructor(element) {
    this.element = element;
    element.replaceChildren();
    this.redraw();
  }

  redraw() {
    this.#asked ||= requestAnimationFrame(() => {
      this.#asked = 0;
      this.#show();
    });
  }

  #show() {
    const u = model.state?.u ?? [];
    const names = model.setup?.thrusters ?? u.map((_, i) => `thruster ${i + 1}`);
    if (names.join() !== this.#names || !this.#rows.length) this.#build(names);
    this.#rows.forEach((row, i) => row.show(u[i] ?? 0, model.state?.health?.[i] ?? 1));
  }

  #build(names) {
    this.#names = names.join();
    this.#rows = names.map(name => new Row(name.replaceAll('_', ' ')));
    const ends = ['\u22121', '0', '+1'].map(text => make('span', {}, text));
    const scale = make('div', {class: 'thruster-scale', 'aria-hidden': 'true'}, ...ends);
    const rows = this.#rows.map(row => row.element);
    this.element.replaceChildren(...(rows.length ? [...rows, scale] : [make('p', {}, 'No thrusters known yet.')]));
  }

  release() {
    cancelAnimationFrame(this.#asked);
  }
}

mount('thrusters', element => {
  const bars = new Bars(element);
  shown = bars;
  return () => {
    bars.release();
    shown = null;
  };
});

live.on('state', state => {
  model.state = state;
  shown?.redraw();
});
live.on('setup', setup => {
  model.setup = setup;
  shown?.redraw();
});
