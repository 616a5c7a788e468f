/** The event log: newest first, filtered by level. */
import {live} from '/static/live.js';
import {make, mount} from '/static/canvas.js';

const MOST = 500; // events that are kept
const LEVELS = ['info', 'warning', 'danger'];
const KEY = 'rovtwin.events';
const kept = []; // the newest last
let count = 0; // of all events that ever came
const seen = new Set(); // what they are: after a lost connection the server sends the last ones again
let view = null;
let now = Infinity; // time up to which events are shown [s]: in a replay that of the state

const isPast = event => (event.t ?? 0) <= now + 1e-6;
// How many of the events, oldest first, have happened by now: only a change of that is worth a look at the list.
const happened = () => kept.reduce((sum, event) => sum + isPast(event), 0);
live.on('state', state => {
  if (!state.replay) return;
  const before = happened();
  now = state.t;
  if (happened() !== before) view?.until();
});

live.on('event', event => {
  const what = JSON.stringify([event.t, event.clock, event.level, event.text]);
  if (seen.has(what)) return;
  seen.add(what);
  kept.push({...event, what});
  count++;
  if (kept.length > MOST) seen.delete(kept.shift().what);
  view?.ask();
});

function remembered() {
  try {
    const hidden = JSON.parse(localStorage.getItem(KEY) ?? '[]');
    return new Set(Array.isArray(hidden) ? hidden.filter(level => LEVELS.includes(level)) : []);
  } catch { // storage is shut, or holds something else
    return new Set();
  }
}

class View {
  hidden = remembered(); // levels that are not shown

  constructor(element) {
    this.element = element;
    this.buttons = new Map(LEVELS.map(level => [level, make('button', {type: 'button', class: level, onclick: () => this.toggle(level)})]));
    this.list = make('ol', {'aria-label': 'Events, newest first', tabindex: 0});
    const log = make('div', {role: 'log', 'aria-label': 'Events', 'aria-live': 'polite'}, this.list);
    this.none = make('p', {class: 'events-none'});
    element.replaceChildren(make('div', {class: 'events-tools', role: 'group', 'aria-label': 'Levels shown'}, ...this.buttons.values()), this.none, log);
    this.shown = 0; // of `count`
    this.#tell();
    this.#catchUp();
  }

  /** Lists what is new at the next frame, however much came by then. */
  ask() {
    this.waiting ||= requestAnimationFrame(() => this.#catchUp());
  }

  #catchUp() {
    this.waiting = 0;
    const fresh = Math.min(count - this.shown, kept.length);
    this.shown = count;
    if (!fresh) return;
    const {scrollTop, scrollHeight} = this.list;
    this.list.prepend(...kept.slice(-fresh).map(row).reverse());
    this.until();
    while (this.list.children.length > MOST) this.list.lastElementChild.remove();
    // Who reads further down stays there.
    if (scrollTop > 0) this.list.scrollTop = scrollTop + this.list.scrollHeight - scrollHeight;
    this.#tell();
  }

  /** Hides what has not happened yet. */
  until() {
    for (const item of this.list.children) item.hidden = Number(item.dataset.t) > now + 1e-6;
    this.#tell();
  }

  toggle(level) {
    if (!this.hidden.delete(level)) this.hidden.add(level);
    try {
      localStorage.setItem(KEY, JSON.stringify([...this.hidden]));
    } catch { /* storage is shut: chosen for this visit only */ }
    this.#tell();
  }

  #tell() {
    let shown = 0;
    for (const level of LEVELS) {
      const many = kept.filter(event => levelOf(event) === level && isPast(event)).length;
      const on = !this.hidden.has(level);
      this.list.classList.toggle(`without-${level}`, !on);
      const button = this.buttons.get(level);
      button.textContent = `${level} ${many}`;
      button.setAttribute('aria-pressed', String(on));
      button.setAttribute('aria-label', `${on ? 'Hide' : 'Show'} ${level}: ${many} event${many === 1 ? '' : 's'}`);
      if (on) shown += many;
    }
    this.none.textContent = happened().length ? 'All events are of levels that are not shown.' : 'Nothing has happened yet.';
    this.none.hidden = shown > 0;
  }
}

const levelOf = event => (LEVELS.includes(event.level) ? event.level : 'info');

function row(event) {
  const level = levelOf(event);
  return make('li', {class: level, 'data-t': event.t ?? 0}, make('time', {title: `${Number(event.t ?? 0).toFixed(1)} s of the vehicle's time`}, event.clock ?? ''),
    make('b', {}, level), make('span', {}, event.text ?? ''));
}

mount('events', element => {
  view = new View(element);
  return () => {
    cancelAnimationFrame(view.waiting);
    view = null;
  };
});
