/** Live plots: channels picked from a list, one below the other over the same window of time. */
import {live} from '/static/live.js';
import {make, mount, surface} from '/static/canvas.js';
import {channels, FIRST} from '/static/plots_channels.js';
import {clock, COLOURS, digits, drawPlot, nearest} from '/static/plots_draw.js';
import {ROOM, Store} from '/static/plots_store.js';

const PERIOD = 100; // between two drawings at least [ms]
const MOST = 8; // plots at a time
const WINDOWS = [[30, '30 s'], [120, '2 min'], [600, '10 min']];
const KEY = 'rovtwin.plots';
const store = new Store(); // outlives the element: a change of tab loses nothing
const known = new Map(); // channels by id, all that ever came
let view = null;

/** Learns of channels that a state has; whether there are new ones. */
function learn(state) {
  const before = known.size;
  for (const channel of channels(live.last.setup, state)) if (!known.has(channel.id)) known.set(channel.id, channel);
  return known.size > before;
}

live.on('track', states => {
  if (states.length && learn(states.at(-1))) view?.listed();
  store.know(states, [...known.values()]);
  if (live.last.state) store.add(live.last.state, known.values());
  view?.ask(true);
});
live.on('state', state => {
  const fresh = learn(state);
  if (store.add(state, known.values())) view?.ask(state.replay); // a hand that scrubs wants to see it at once
  if (fresh) view?.listed();
});

function remembered() {
  try {
    const {ids, seconds} = JSON.parse(localStorage.getItem(KEY) ?? '{}');
    return {ids: Array.isArray(ids) ? ids.slice(0, MOST) : FIRST, seconds: WINDOWS.some(([s]) => s === seconds) ? seconds : 30};
  } catch { // storage is shut, or holds something else
    return {ids: FIRST, seconds: 30};
  }
}

class View {
  held = null; // the newest time shown, while paused [s]
  cursor = null; // time under the pointer [s]
  plots = new Map(); // by id of the channel
  waiting = 0;
  last = -Infinity; // when it was drawn last [ms]

  constructor(element) {
    this.element = element;
    Object.assign(this, remembered());
    this.board = make('div', {class: 'plots-board'});
    this.empty = make('p', {class: 'plots-none'}, 'Choose channels to plot.');
    element.replaceChildren(this.#tools(), this.board);
    this.listed();
  }

  #tools() {
    this.spans = WINDOWS.map(([seconds, text]) => make('button', {type: 'button', 'aria-pressed': String(seconds === this.seconds),
      'aria-label': `Show the last ${text}`, onclick: () => this.setWindow(seconds)}, text));
    this.pausing = make('button', {type: 'button', 'aria-pressed': 'false', 'aria-label': 'Hold the plots', onclick: () => this.pause()}, 'Pause');
    this.list = make('div', {class: 'plots-list'});
    this.find = make('input', {type: 'search', placeholder: 'Find', 'aria-label': 'Find a channel', oninput: () => this.#filter()});
    this.picker = make('details', {class: 'plots-pick'}, make('summary', {'aria-label': 'Choose channels'}, 'Channels'),
      make('div', {class: 'plots-menu'}, this.find, this.list));
    this.picker.addEventListener('keydown', event => {
      if (event.key === 'Escape') this.picker.open = false; // and on to whoever else listens: Esc is STOP
    });
    this.outside = event => { if (!this.picker.contains(event.target)) this.picker.open = false; };
    document.addEventListener('pointerdown', this.outside);
    const keys = Object.entries(COLOURS).map(([line, name]) => make('li', {style: `--key: var(--${name})`, class: line}, line));
    return make('div', {class: 'plots-tools'}, this.picker,
      make('div', {role: 'group', 'aria-label': 'Window of time'}, ...this.spans), this.pausing,
      make('ul', {class: 'plots-keys', 'aria-label': 'Lines'}, ...keys, make('li', {class: 'band', style: '--key: var(--track)'}, '95 %')));
  }

  /** The list of channels has changed: writes it anew, and shows those that were chosen before. */
  listed() {
    const groups = new Map();
    for (const channel of known.values()) groups.set(channel.group, [...groups.get(channel.group) ?? [], channel]);
    this.boxes = new Map();
    this.list.replaceChildren(...[...groups].map(([group, members]) => make('fieldset', {}, make('legend', {}, group), ...members.map(channel => {
      const box = make('input', {type: 'checkbox', value: channel.id, onchange: () => this.choose(channel.id, box.checked)});
      this.boxes.set(channel.id, box);
      return make('label', {}, box, channel.name, make('small', {}, channel.unit));
    }))));
    this.#filter();
    this.#arrange();
  }

  #filter() {
    const query = this.find.value.trim().toLowerCase();
    for (const label of this.list.querySelectorAll('label')) label.hidden = !label.textContent.toLowerCase().includes(query);
    for (const group of this.list.children) group.hidden = ![...group.querySelectorAll('label')].some(label => !label.hidden);
  }

  choose(id, on) {
    this.ids = on ? [...this.ids.filter(known.has, known), id] : this.ids.filter(other => other !== id);
    this.#remember();
    this.#arrange();
  }

  #remember() {
    try {
      localStorage.setItem(KEY, JSON.stringify({ids: this.ids, seconds: this.seconds}));
    } catch { /* storage is shut: chosen for this visit only */ }
  }

  #arrange() {
    const ids = this.ids.filter(id => known.has(id)).slice(0, MOST);
    for (const [id, plot] of this.plots) {
      if (ids.includes(id)) continue;
      plot.surface.release();
      plot.element.remove();
      this.plots.delete(id);
    }
    for (const id of ids) if (!this.plots.has(id)) this.plots.set(id, this.#plot(known.get(id)));
    this.board.dataset.many = ids.length > 4 ? 'many' : 'few';
    this.board.append(...ids.map(id => this.plots.get(id).element));
    if (ids.length) this.empty.remove();
    else if (known.size) this.board.append(this.empty);
    for (const [id, box] of this.boxes) {
      box.checked = ids.includes(id);
      box.disabled = !box.checked && ids.length >= MOST;
    }
    this.ask(true);
  }

  #plot(channel) {
    const words = make('p', {class: 'plots-words'});
    const close = make('button', {type: 'button', class: 'plots-close', 'aria-label': `Take ${channel.name} away`,
      onclick: () => this.choose(channel.id, false)}, '×');
    const canvas = make('canvas', {tabindex: 0, role: 'img', 'aria-label': `${channel.name} over time. Arrow keys move the cursor.`});
    const element = make('figure', {}, make('figcaption', {}, make('b', {}, channel.name), words, close), canvas);
    const plot = {channel, element, words};
    plot.surface = surface(canvas, (context, width, height) => {
      plot.timeAt = drawPlot(context, width, height, store, channel, this.span);
      this.#say(plot);
    });
    const point = event => this.#point(plot.timeAt?.(event.offsetX) ?? null);
    canvas.addEventListener('pointermove', point);
    canvas.addEventListener('pointerdown', point);
    canvas.addEventListener('pointerleave', event => { if (event.pointerType === 'mouse') this.#point(null); });
    canvas.addEventListener('keydown', event => this.#key(event));
    return plot;
  }

  /** Arrow keys move the cursor where the keyboard brought the focus here: elsewhere they may pilot the vehicle. */
  #key(event) {
    const by = {ArrowLeft: -1, ArrowRight: 1}[event.key];
    if (!by || !event.target.matches(':focus-visible')) return;
    event.preventDefault();
    event.stopPropagation();
    const {from, to} = this.span;
    this.#point(Math.min(Math.max((this.cursor ?? to) + by * (to - from) / 100, from), to));
  }

  #point(t) {
    this.cursor = t;
    this.ask(true);
  }

  get span() {
    const to = this.held ?? store.newest;
    const from = to - this.seconds;
    const inside = this.cursor !== null && this.cursor >= from && this.cursor <= to;
    return {from, to, cursor: inside ? this.cursor : null};
  }

  /** What the lines are at the cursor, or else the newest. */
  #say({channel, words}) {
    const {to, cursor} = this.span;
    const i = nearest(store, cursor ?? to);
    if (i === null) return;
    const read = line => store.column(channel.id, line)?.[i % ROOM];
    const parts = Object.entries(COLOURS).filter(([line]) => Number.isFinite(read(line)))
      .map(([line, name]) => make('span', {style: `color: var(--${name})`, title: line}, digits(read(line))));
    if (channel.expected && Number.isFinite(read('low'))) parts.push(make('span', {}, `expected ${digits(read('low'))} to ${digits(read('high'))}`));
    else if (Number.isFinite(read('low'))) parts.push(make('span', {}, `± ${digits((read('high') - read('low')) / 2)}`));
    words.replaceChildren(...parts, channel.unit, make('time', {}, cursor === null ? '' : `at ${clock(store.at(i))}`));
  }

  setWindow(seconds) {
    this.seconds = seconds;
    WINDOWS.forEach(([s], i) => this.spans[i].setAttribute('aria-pressed', String(s === seconds)));
    this.#remember();
    this.ask(true);
  }

  pause() {
    this.held = this.held === null ? store.newest : null;
    this.pausing.setAttribute('aria-pressed', String(this.held !== null));
    this.pausing.textContent = this.held === null ? 'Pause' : 'Go on';
    this.ask(true);
  }

  /** Draws soon; what only moves on waits until it has moved by a pixel. */
  ask(now = false) {
    if (this.waiting || document.hidden || (this.held !== null && !now)) return;
    const pixel = 1000 * this.seconds / Math.max(this.board.clientWidth, 1);
    const rest = Math.max(now ? 0 : Math.max(PERIOD, pixel), PERIOD) - (performance.now() - this.last);
    this.waiting = setTimeout(() => this.#draw(), Math.max(0, rest));
  }

  #draw() {
    this.waiting = 0;
    this.last = performance.now();
    for (const plot of this.plots.values()) plot.surface.redraw();
    this.element.dataset.pictures = Number(this.element.dataset.pictures ?? 0) + 1;
  }

  release() {
    clearTimeout(this.waiting);
    document.removeEventListener('pointerdown', this.outside);
    for (const plot of this.plots.values()) plot.surface.release();
    view = null;
  }
}

mount('plots', element => {
  view = new View(element);
  return () => view?.release();
});
