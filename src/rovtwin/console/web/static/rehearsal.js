/** What the plan's rehearsal predicts, and the flight beside it: messages `rehearsal` and `rehearsing`. */
import {make, mount, surface} from '/static/canvas.js';
import {pointsOf} from '/static/faults.js';
import {live} from '/static/live.js';
import {showReply} from '/static/page.js';
import {drawProfile} from '/static/rehearsal_profile.js';
import {arrival, basis, compared, figures, going, thrustLeft, verdict} from '/static/rehearsal_words.js';
import {layer} from '/static/rehearsal_layer.js';

const LITTLE = 0.1; // thrust that should be left
const KEYS = [['plan', 'planned'], ['predicted', 'predicted, its band'], ['hull', 'lowest of the hull'], ['floor', 'floor'], ['flown', 'flown']];
const order = what => showReply(live.send({do: 'rehearse', ...what}));
const list = (items, more = {}) => make('ul', {class: 'checks', ...more}, ...items.map(({level, what}) => make('li', {class: level}, what)));

/** Current and waves in place of the scenario's; left empty they are the scenario's, and the twin's. */
class WaterForm {
  constructor() {
    const field = (name, label, more) => make('input', {type: 'number', name, step: 'any', 'aria-label': label, placeholder: label, ...more});
    this.speed = field('speed', 'Current [m/s]', {min: 0, max: 5});
    this.toward = field('toward', 'towards [deg]', {min: 0, max: 360});
    this.waves = field('waves', 'Waves [m]', {min: 0.01, max: 20});
    this.water = '[null,null]';
    const fields = [this.speed, this.toward, this.waves];
    fields.forEach(one => one.addEventListener('change', () => this.#send()));
    this.element = make('details', {class: 'rehearsal-water'}, make('summary', {}, 'Other water than the scenario\u2019s'),
      make('div', {class: 'line'}, ...fields),
      make('p', {class: 'muted'}, 'Left empty: the scenario\u2019s, with what World has added.'));
  }

  show(message, may) {
    this.waves.hidden = !message?.has_waves;
    [this.speed, this.toward, this.waves].forEach(one => { one.disabled = !may; });
    this.#fill(message);
  }

  /** What holds, also for a page that was loaded anew or watches; what is half typed stays. */
  #fill(message) {
    const water = JSON.stringify([message?.current ?? null, message?.waves ?? null]);
    if (water === this.water) return;
    this.water = water;
    const [north, east] = message?.current ?? [];
    const degrees = (Math.atan2(east, north) * 180 / Math.PI + 360) % 360;
    this.speed.value = north === undefined ? '' : String(Number(Math.hypot(north, east).toFixed(3)));
    this.toward.value = north === undefined ? '' : String(Number(degrees.toFixed(1)));
    this.waves.value = message?.waves ?? '';
    if (message?.current || message?.waves) this.element.open = true;
  }

  #send() {
    const value = input => (input.value.trim() === '' ? null : Number(input.value));
    const [speed, toward] = [value(this.speed), value(this.toward)];
    if ((speed === null) !== (toward === null)) return; // the other is still to come
    order({op: 'water', speed, toward, waves: value(this.waves)});
  }
}

/** When each way-point is reached, and the thrust that is left on the way. */
function table(points, remarks) {
  const faults = new Set(remarks.filter(one => one.level !== 'ok').flatMap(pointsOf));
  const row = (point, i) => make('tr', {class: faults.has(i) || Math.min(point.margin, point.least_margin ?? 1) < LITTLE ? 'warning' : ''},
    make('th', {scope: 'row'}, String(i + 1)), make('td', {}, arrival(point)), make('td', {}, thrustLeft(point)));
  const head = ['#', 'Reached', 'Thrust left (least drawn)'].map(text => make('th', {scope: 'col'}, text));
  return make('table', {}, make('thead', {}, make('tr', {}, ...head)), make('tbody', {}, ...points.map(row)));
}

function comparison({flown, whole}) {
  if (!flown) return [];
  const rows = compared(flown).map(({level, name, what}) => make('tr', {class: level}, make('th', {scope: 'row'}, name), make('td', {}, what)));
  return [make('h3', {}, 'Predicted against flown'), list([verdict(flown, whole)]), make('table', {class: 'rehearsal-flown'}, make('tbody', {}, ...rows)),
    ...flown.notes.map(text => make('p', {class: 'muted'}, text))];
}

class View {
  constructor(element) {
    this.say = make('p', {class: 'rehearsal-going', role: 'status'});
    this.begin = make('button', {class: 'action', onclick: () => order({op: 'now'})}, 'Rehearse');
    this.shown = make('input', {type: 'checkbox', checked: layer.shown});
    this.shown.addEventListener('change', () => {
      layer.shown = this.shown.checked;
      layer.changed();
    });
    this.water = new WaterForm();
    this.top = make('div', {class: 'line'}, this.begin, make('label', {}, this.shown, ' Show on the chart'), this.say);
    this.canvas = make('canvas', {role: 'img', 'aria-label': 'Depth over time: planned, predicted, floor'});
    this.keys = make('ul', {class: 'rehearsal-keys'}, ...KEYS.map(([name, text]) => make('li', {class: `is-${name}`}, text)));
    this.profile = make('figure', {hidden: true}, make('figcaption', {}, 'Depth [m] over time'), this.canvas, this.keys);
    this.words = make('div', {class: 'rehearsal-words'});
    this.rest = make('div', {class: 'rehearsal-rest'});
    element.replaceChildren(this.top, this.water.element, this.words, this.profile, this.rest);
    this.surface = surface(this.canvas, (context, width, height) => drawProfile(context, width, height, live.last.rehearsal ?? {}));
    this.show();
    this.go();
  }

  /** What goes on, and who may ask for it. */
  go() {
    const [message, replay] = [live.last.rehearsing, Boolean(live.last.state?.replay)];
    const may = Boolean(live.last.rights?.may) && !replay;
    this.begin.hidden = this.water.element.hidden = replay;
    this.begin.disabled = !may;
    this.water.show(message, may);
    const text = replay && !live.last.rehearsal ? 'This run was not rehearsed.' : going(message);
    if (this.say.textContent !== text) this.say.textContent = text;
    this.say.classList.toggle('is-wrong', Boolean(message?.why) && !message.busy);
    this.rest.classList.toggle('is-stale', Boolean(message?.stale));
    this.words.classList.toggle('is-stale', Boolean(message?.stale));
  }

  show() {
    const message = live.last.rehearsal;
    this.profile.hidden = !message?.profile.t.length;
    if (!message) return;
    const rows = figures(message).map(([name, what]) => make('tr', {}, make('th', {scope: 'row'}, name), make('td', {}, what)));
    this.words.replaceChildren(...comparison(message), list(message.remarks, {'aria-label': 'Remarks of the rehearsal'}),
      make('table', {}, make('tbody', {}, ...rows)));
    this.rest.replaceChildren(table(message.points, message.remarks), ...basis(message).map(text => make('p', {class: 'muted'}, text)));
    this.keys.querySelector('.is-flown').hidden = !message.flown;
    this.keys.querySelectorAll('.is-hull, .is-floor').forEach(one => { one.hidden = !message.profile.floor; });
    this.surface.redraw();
  }
}

mount('rehearsal', element => {
  const view = new View(element);
  let replay = Boolean(live.last.state?.replay);
  const release = [
    live.on('rehearsal', () => { view.show(); view.go(); }),
    live.on('rehearsing', () => view.go()),
    live.on('rights', () => view.go()),
    live.on('state', state => { // the first one says whether this is a replay
      if (Boolean(state.replay) === replay) return;
      replay = Boolean(state.replay);
      view.go();
    }),
  ];
  return () => { view.surface.release(); release.forEach(one => one()); };
});
