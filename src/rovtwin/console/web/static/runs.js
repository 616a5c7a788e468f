/** Finished runs, the newest first: each opens in a page of its own, so that this one goes on. */
import {make, mount} from '/static/canvas.js';
import {lasting} from '/static/clock.js';

const minutes = s => (Number.isFinite(s) ? lasting(s) : '');

function row({run, name, date, verdict, level, duration}, target) {
  const here = new URLSearchParams(location.search).get('run') === run && 'page';
  return make('li', {}, make('a', {href: `/replay?run=${encodeURIComponent(run)}`, target, title: run, 'aria-current': here},
    make('strong', {}, name), make('span', {class: 'muted'}, [date, minutes(duration)].filter(Boolean).join(' · ')),
    make('span', {class: 'value', 'data-level': level}, verdict)));
}

mount('runs', section => {
  const list = make('ol', {class: 'runs', 'aria-label': 'Finished runs, newest first'});
  const say = make('p', {class: 'muted', role: 'status'});
  const look = async () => {
    say.textContent = 'looking for runs';
    try {
      const {folder, runs} = await (await fetch('/replay/runs')).json();
      // The page from which somebody flies stays; a replay goes on to another run in its own.
      const target = document.getElementById('plan') ? '_blank' : '_self';
      list.replaceChildren(...runs.map(run => row(run, target)));
      say.textContent = runs.length ? `${runs.length} in ${folder}` : `no finished run in ${folder} yet`;
    } catch {
      say.textContent = 'the console does not answer';
    }
  };
  const again = make('button', {class: 'action', type: 'button', onclick: look, 'aria-label': 'Look for runs again'}, 'Look again');
  section.append(make('div', {class: 'line'}, say, again), list);
  // Runs come while the page is open: whoever opens the tab sees them.
  const shown = new IntersectionObserver(([entry]) => { if (entry.isIntersecting) look(); });
  shown.observe(section);
  return () => shown.disconnect();
});
