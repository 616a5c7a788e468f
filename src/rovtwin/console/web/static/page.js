/** Tabs, the theme, and words that come up for a moment. */
import {stop} from '/static/live.js';

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
export async function said(promise) {
  try {
    const answer = await promise;
    if (answer.said) toast(answer.said);
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
}

document.addEventListener('click', event => {
  const tab = event.target.closest('[role=tab]');
  if (tab) choose(tab);
});

document.addEventListener('keydown', event => {
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
