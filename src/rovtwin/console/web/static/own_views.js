/** Views of one's own: pictures, rows or text that their processes give. Nothing of them runs here. */
import {live} from '/static/live.js';
import {make, mount} from '/static/canvas.js';

const MOST = 16;

/** A picture as an image: an SVG in an image runs no scripts and loads nothing. */
function picture(svg, title) {
  return make('img', {src: `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg)}`, alt: title});
}

function table(rows) {
  return make('table', {}, ...rows.map(([label, value = '', unit = '']) => make('tr', {},
    make('th', {scope: 'row'}, label), make('td', {}, `${value} ${unit}`.trim()))));
}

function content(message) {
  if (message.error) {
    const who = message.error.includes(message.title) ? '' : `${message.title}: `;
    return make('p', {role: 'alert', class: 'own-view-error'}, `${who}${message.error}`);
  }
  if (message.svg) return picture(message.svg, message.title);
  if (message.rows) return table(message.rows);
  return make('p', {}, message.text ?? '');
}

function show(element, message) {
  element.replaceChildren(content(message));
  const tab = document.getElementById(element.parentElement?.getAttribute('aria-labelledby') ?? '');
  if (tab && tab.textContent !== message.title) tab.textContent = message.title;
  tab?.toggleAttribute('data-failed', Boolean(message.error));
}

for (let number = 0; number < MOST; number++) {
  mount(`own-view-${number}`, element => {
    element.replaceChildren(make('p', {class: 'own-view-waiting'}, 'waiting for its first look'));
    return live.on(`view-${number}`, message => show(element, message));
  });
}
