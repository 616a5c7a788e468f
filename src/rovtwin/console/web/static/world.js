/** The simulated world: its time, and what breaks in it. Nothing of it is shown with a real vehicle. */
import {make, mount} from '/static/canvas.js';
import {live} from '/static/live.js';
import {showReply} from '/static/page.js';

const inject = what => showReply(live.send({do: 'inject', ...what}));
const SPEEDS = [0.5, 1, 2, 5, 10];

function time() {
  const run = make('button', {class: 'action', id: 'running'}, 'Pause time');
  run.addEventListener('click', () => showReply(live.send({do: 'pace', running: !live.last.state.running})));
  const speed = make('select', {'aria-label': 'Speed of simulated time', id: 'speed'},
    ...SPEEDS.map(value => make('option', {value}, `×${value}`)));
  speed.addEventListener('change', () => showReply(live.send({do: 'pace', speed: Number(speed.value)})));
  live.on('state', state => {
    run.textContent = state.running ? 'Pause time' : 'Run time';
    if (document.activeElement !== speed) speed.value = String(state.speed);
  });
  return make('fieldset', {}, make('legend', {}, 'Simulated time'), run, speed);
}

function thruster(setup) {
  const which = make('select', {'aria-label': 'Thruster', id: 'fault-thruster'},
    ...setup.thrusters.map((name, i) => make('option', {value: i}, name)));
  const to = share => inject({fault: 'thruster', thruster: Number(which.value), share});
  return make('fieldset', {}, make('legend', {}, 'Thruster'), which,
    make('button', {class: 'action', onclick: () => to(0)}, 'Dead'),
    make('button', {class: 'action', onclick: () => to(0.5)}, 'Half'),
    make('button', {class: 'action', onclick: () => to(1)}, 'Mended'));
}

function sensor(setup) {
  const which = make('select', {'aria-label': 'Sensor', id: 'fault-sensor'},
    ...setup.sensors.map(name => make('option', {value: name}, name)));
  return make('fieldset', {}, make('legend', {}, 'Sensor'), which,
    make('button', {class: 'action', onclick: () => inject({fault: 'sensor', sensor: which.value, works: false})}, 'Silent'),
    make('button', {class: 'action', onclick: () => inject({fault: 'sensor', sensor: which.value, works: true})}, 'Works'));
}

function current() {
  const field = (label, id) => make('input', {type: 'number', step: 0.05, value: 0, min: -2, max: 2, 'aria-label': label, id});
  const [north, east] = [field('Current to the north [m/s]', 'current-north'), field('Current to the east [m/s]', 'current-east')];
  const set = () => inject({fault: 'current', current: [Number(north.value), Number(east.value)]});
  return make('fieldset', {}, make('legend', {}, 'Current, north and east [m/s]'), north, east,
    make('button', {class: 'action', onclick: set}, 'Set'));
}

mount('world', section => {
  let built = '';
  const release = live.on('setup', setup => {
    const key = JSON.stringify([setup.twin, setup.thrusters, setup.sensors]);
    const tab = document.querySelector(`[aria-controls="${section.closest('[role=tabpanel]').id}"]`);
    tab.hidden = !setup.twin;
    if (key === built) return;
    built = key;
    section.replaceChildren(...(setup.twin ? [time(), thruster(setup), sensor(setup), current()] : []));
  });
  return () => release();
});
