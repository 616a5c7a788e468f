/** Commissionings in the navigation: what goes on now, those there are, and the way to begin one. */
import {make, mount} from '/static/canvas.js';
import {listOf} from '/static/commission_list.js';
import {live} from '/static/live.js';

mount('commissionings', section => {
  const now = make('p', {class: 'muted', role: 'status'});
  const list = make('div');
  const say = make('p', {class: 'muted'});
  const look = async () => {
    try {
      const {folder, found} = await (await fetch('/commission/list')).json();
      list.replaceChildren(listOf(found));
      say.textContent = found.length ? `${found.length} in ${folder}` : `none in ${folder} yet`;
    } catch {
      say.textContent = 'the console does not answer';
    }
  };
  section.append(now, make('div', {class: 'line'},
    make('a', {class: 'action', href: '/commission'}, 'Begin a commissioning')), say, list);
  const shown = new IntersectionObserver(([entry]) => { if (entry.isIntersecting) look(); });
  shown.observe(section);
  const release = live.on('commission', message => {
    const {now: doing, question, held} = message;
    now.replaceChildren(doing ? make('a', {href: `/commission?name=${encodeURIComponent(doing.folder)}`},
      question ? `${doing.title}: a question waits for an answer` : `${doing.title} is being done`)
      : held ? 'A commissioning holds the vehicle: it is given back there.'
      : 'From a vehicle file to a proven vehicle, stage by stage.');
  });
  return () => { shown.disconnect(); release(); };
});
