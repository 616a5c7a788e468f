/** Tabs, the theme, and words that come up for a moment. */
import {live, stop} from '/static/live.js';

const TOAST = 6000;  // [ms]

/** Says something at the lower edge for a while; `level` is info or danger. */
export function toast(text, level = 'info') {
  const box = Object.assign(document.createElement('div'), {className: `toast ${level}`, textContent: text});
  box.setAttribute('role', level === 'danger' ? 'alert' : 'status');
  document.body.append(box);
  setTimeout(() => box.remove(), TOAST);
}

/** Thrusters off; says so where nobody confirms it. */
export function pressStop() {
  return stop().catch(error => toast(`STOP is not confirmed: ${error.message}`, 'danger'));
}

/** Runs an order's promise and says why it was refused. */
export async function showReply(promise) {
  try {
    const answer = await promise;
    if (answer.message) toast(answer.message);
    return true;
  } catch (error) {
    toast(error.message, 'danger');
    return false;
  }
}

/** Day or night: as chosen before, else as the system has it. */
export function theme(daylight) {
  const chosen = daylight ?? (localStorage.getItem('rovtwin-theme') === 'daylight');
  document.body.classList.toggle('daylight', chosen);
  localStorage.setItem('rovtwin-theme', chosen ? 'daylight' : 'dark');
}

function choose(tab) {
  const list = tab.parentElement;
  for (const other of list.children) {
    const own = other === tab;
    other.setAttribute('aria-selected', own);
    other.tabIndex = own ? 0 : -1;
    document.getElementById(other.getAttribute('aria-controls')).hidden = !own;
  }
  together();
}

/** On a phone camera and sticks stand below each other, on one screen: there they are scrolled to. */
function together() {
  const pilot = document.getElementById('pilot');
  if (pilot?.offsetParent && matchMedia('(max-width: 900px)').matches) {
    document.getElementById('console').scrollIntoView({block: 'start'});
  }
}

document.addEventListener('click', event => {
  const tab = event.target.closest('[role=tab]');
  if (tab) choose(tab);
});

/** Keys that work everywhere; views have their own beside. */
const KEYS = [
  ['Esc', 'STOP: thrusters off', '#stop'], ['Ctrl Z', 'undo the last change of the plan', '#plan'],
  ['Ctrl Shift Z, Ctrl Y', 'redo it', '#plan'], ['Delete', 'take the chosen way-point away', '#plan'],
  ['W S, A D', 'ahead and astern, sideways, while you pilot', '#pilot'],
  ['R F, Q E', 'up and down, turn, while you pilot', '#pilot'],
  ['+ −', 'zoom the chart', '#chart'], ['← →', 'the next tab', '[role=tablist]'],
  ['Space', 'play or pause', '#timeline'], ['← → with Shift', 'a second, ten seconds', '#timeline'],
  [', .', 'one sample back, on', '#timeline'], ['Home End', 'to the beginning, to the end', '#timeline'],
  ['?', 'these keys', 'body'],
];

/** Shows or hides the keys. Nothing else is shut meanwhile: STOP stays one click away. */
export function help() {
  const open = document.getElementById('help');
  if (open) return open.remove();
  const rows = KEYS.filter(([, , where]) => document.querySelector(where)).flatMap(([keys, does]) => {
    const [term, meaning] = [document.createElement('dt'), document.createElement('dd')];
    [term.textContent, meaning.textContent] = [keys, does];
    return [term, meaning];
  });
  const box = Object.assign(document.createElement('aside'), {id: 'help', tabIndex: -1});
  const title = Object.assign(document.createElement('h2'), {id: 'help-title', textContent: 'Keys'});
  const list = document.createElement('dl');
  const close = Object.assign(document.createElement('button'), {className: 'action', textContent: 'Close', onclick: help});
  list.append(...rows);
  box.setAttribute('aria-labelledby', 'help-title');
  box.append(title, list, close);
  document.body.append(box);
  close.focus();
}

/** Whether what is typed there has not been taken yet: its own undo comes first. */
const typing = element => element.matches?.('textarea, [contenteditable=true]')
  || (element.matches?.('input:not([type=range], [type=checkbox])') && element.value !== element.defaultValue);

function planKey(event) {
  const key = event.key.toLowerCase();
  const op = key === 'y' || (key === 'z' && event.shiftKey) ? 'redo' : key === 'z' ? 'undo' : null;
  const allowed = live.last.rights?.may && live.last.plan?.[op] && document.getElementById('plan');
  if (!(event.ctrlKey || event.metaKey) || event.altKey || !op || typing(event.target)) return false;
  if (allowed) showReply(live.send({do: 'plan', op}));
  return true;
}

// Who closes the page in control of an armed vehicle is asked first; other pages then count down (alerts.js).
addEventListener('beforeunload', event => {
  const {state, rights} = live.last;
  if (rights?.may && state?.armed && !state.replay) event.preventDefault();
});

document.addEventListener('keydown', event => {
  const aimed = event.target.closest?.('input, textarea, select');
  if (planKey(event) || (event.key === '?' && !aimed)) {
    if (event.key === '?') help();
    event.preventDefault();
    return;
  }
  if (event.key === 'Escape' && document.getElementById('stop')) { // where nothing flies there is none
    pressStop();
    event.preventDefault();
    return;
  }
  const tab = event.target.closest?.('[role=tab]');
  const step = {ArrowRight: 1, ArrowLeft: -1}[event.key];
  if (tab && step) {
    const tabs = [...tab.parentElement.children];
    const next = tabs[(tabs.indexOf(tab) + step + tabs.length) % tabs.length];
    choose(next);
    next.focus();
  }
}, true);

theme();
