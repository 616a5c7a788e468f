/**
 * The line below the bar: what is wrong, what is being made ready, how long nobody has been in control. Its height never
 * changes, so that nothing moves under a finger: the gravest stands there, the others lie over the views when asked for.
 */
import {make, mount} from '/static/canvas.js';
import {clock, lasting} from '/static/clock.js';
import {live} from '/static/live.js';
import {showReply} from '/static/page.js';

const GONE = 1.5; // without a sign of life from who is in control [s]: a page says more often that it is there
const DOES = {hold: 'it stays where it is', return: 'it comes home', surface: 'it comes up', stop: 'its thrusters go off'};
const NO_ACTION = 'it goes on';
let found = []; // alerts of the newest state
let strip = null;

/** Alerts [{level, what, cause, remedy}], the gravest first. */
export function showAlerts(alerts) {
  found = alerts ?? [];
  strip?.show();
}

/** What there is to say while a vehicle is made ready; null once it is there. */
export function starting(state, since) {
  if (!state) return {words: `Starting the autopilot's process · ${lasting(since)}`, value: 0, of: 1};
  const {making} = state;
  if (!making) return null;
  const whole = making.step > 1 ? ` (${clock(making.whole)} in all)` : '';
  const patience = making.what.startsWith('compiling') ? ' The first start takes longest: what is compiled is kept.' : '';
  const words = `Getting ready, ${making.step} of ${making.of}: ${making.what} · ${clock(making.seconds)}${whole}.${patience}`;
  return {words, value: making.step - 1, of: making.of};
}

/** Seconds until the autopilot acts without an operator, and what it does then; null where somebody is in control. */
export function unattended(state, setup) {
  const rule = setup?.operator_silent;
  if (!state?.armed || state.replay || !(state.operator_age > GONE) || state.phase === 'idle') return null;
  if (!rule || rule.action === 'ignore' || !Number.isFinite(rule.limit)) return {left: null, does: NO_ACTION};
  const left = rule.limit - state.operator_age;
  return left > 0 ? {left, does: DOES[rule.action] ?? rule.action} : null; // then the alert of the autopilot says it
}

/** What a replay's page knows of the flight beside it: asked for once a second where something flies. */
let beside = null;
async function lookBeside() {
  if (!live.last.state?.replay || !document.getElementById('stop')) return;
  try {
    beside = await (await fetch('/attended')).json();
  } catch { /* the server is gone: the bar says so */
    beside = null;
  }
}

class Strip {
  #key = '';

  constructor(element) {
    this.element = element;
    this.words = make('span', {class: 'alert-words'});
    this.bar = make('progress', {'aria-label': 'Getting ready', hidden: true});
    this.take = make('button', {class: 'action alert-take', hidden: true, onclick: () => showReply(live.send({do: 'take'}))}, 'Take control');
    this.more = make('button', {class: 'action', 'aria-expanded': 'false', hidden: true, onclick: () => this.#unfold()});
    this.rest = make('div', {class: 'alert-rest', hidden: true});
    this.line = make('div', {class: 'alert-line', role: 'alert', tabindex: 0}, this.words);
    this.alone = make('strong', {class: 'alert-alone', role: 'timer', hidden: true});
    const both = make('div', {class: 'alert-text'}, this.line, this.alone);
    element.replaceChildren(both, this.bar, this.take, this.more, this.rest);
    this.began = performance.now();
    this.timers = [setInterval(() => this.show(), 500), setInterval(lookBeside, 1000)];
    this.show();
  }

  show() {
    const {state, setup} = live.last;
    const making = starting(state, (performance.now() - this.began) / 1e3);
    const alone = beside ? unattended(beside, beside) : unattended(state, setup);
    this.alone.hidden = !alone;
    if (alone) this.alone.textContent = countdown(alone);
    this.take.hidden = !alone || Boolean(live.last.rights?.may) || Boolean(beside); // control is taken where it flies
    this.bar.hidden = !making;
    // What goes on every second is not called out; nor are the alerts of a replay, which are history.
    this.line.setAttribute('aria-live', making || state?.replay ? 'off' : 'assertive');
    if (making) this.#making(making);
    else this.#alerts(alone);
    this.element.dataset.level = making ? 'note' : found[0]?.level ?? (alone ? 'warning' : '');
  }

  #making({words, value, of}) {
    Object.assign(this.bar, {max: of, value});
    this.#fold([]);
    this.#key = '';
    if (this.words.textContent !== words) this.words.textContent = words;
  }

  #alerts(alone) {
    const key = JSON.stringify([!alone, ...found.map(one => [one.level, one.what])]);
    if (key === this.#key) return;
    this.#key = key;
    this.words.replaceChildren(...(found.length ? text(found[0]) : alone ? [] : ['No alerts']));
    this.#fold(found.slice(1));
  }

  #fold(others) {
    this.more.hidden = !others.length;
    this.more.textContent = `${others.length} more`;
    if (!others.length) this.#unfold(false);
    this.rest.replaceChildren(...others.map(one => make('div', {class: `alert ${one.level}`}, ...text(one))));
  }

  #unfold(open = this.rest.hidden) {
    this.rest.hidden = !open;
    this.more.setAttribute('aria-expanded', String(open));
  }
}

const text = one => [make('strong', {}, one.what), ` – ${one.cause}. `, make('em', {}, one.remedy)];

function countdown({left, does}) {
  return left === null ? `Nobody is in control: ${does}.` : `Nobody is in control: ${does} in ${clock(Math.ceil(left))}.`;
}

mount('alerts', element => {
  strip = new Strip(element);
  return () => {
    strip.timers.forEach(clearInterval);
    strip = null;
  };
});
