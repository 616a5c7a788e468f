/** Commissionings there are, and the form that begins one or asks for something else. */
import {make} from '/static/canvas.js';
import {live} from '/static/live.js';
import {toast} from '/static/page.js';

export const LONG = 150000;  // for an order that reads files: the first one starts a process that imports all that computes [ms]
const address = name => `/commission?name=${encodeURIComponent(name)}`;

/** The list, the newest first; `found` as `/commission/list` has it. */
export function listOf(found) {
  return make('ol', {class: 'runs', 'aria-label': 'Commissionings, the one that was worked on last first'},
    ...found.map(one => make('li', {}, make('a', {href: address(one.name)}, make('strong', {}, one.name),
      make('span', {class: 'muted'}, `${one.vehicle} over ${one.link}`),
      make('span', {class: 'muted'}, `${one.date}${one.last ? `, last stage: ${one.last}` : ', just begun'}`)))));
}

function field(label, input, hint = '') {
  const text = hint ? [make('span', {class: 'muted'}, hint)] : [];
  return make('label', {class: 'commission-field'}, make('span', {}, label), input, ...text);
}

const text = (id, value, more = {}) => make('input', {id, type: 'text', value: value ?? '', spellcheck: 'false', ...more});
const figure = (id, value, more = {}) => make('input', {id, type: 'number', value: value ?? '', step: 'any', inputmode: 'decimal', ...more});
const numbers = line => line.split(/[\s,;]+/).filter(Boolean).map(Number);
const words = line => line.split(/[\s,;]+/).filter(Boolean);

/**
 * The form. `asked` is what was asked for, or what a new one begins with; `name` is that of a commissioning, null for a
 * new one. `done(name)` is called once it is taken.
 */
export function formOf(asked, name, done) {
  const sizes = (asked.tank ?? '').split('x');
  const folder = text('commission-folder', `commissioned-${(asked.vehicle || 'vehicle').replace(/^.*\//, '').replace(/\.ya?ml$/, '')}`
    .replace(/[^A-Za-z0-9._-]/g, '-').slice(0, 60), {required: true});
  const vehicle = text('commission-vehicle', asked.vehicle, {required: true, readonly: name !== null});
  const link = text('commission-link', asked.link, {required: true});
  const sensors = text('commission-sensors', (asked.sensors ?? []).join(' '));
  const sides = ['length', 'width', 'depth'].map((side, i) => figure(`commission-${side}`, sizes[i],
    {required: true, min: 0.1, max: 1000, 'aria-label': `${side} of the tank [m]`, placeholder: side}));
  const minutes = figure('commission-minutes', asked.minutes ?? 15, {min: 1, max: 240});
  const prior = text('commission-prior', asked.prior);
  const interval = figure('commission-interval', 100 * (asked.interval ?? 0.05), {min: 0.5, max: 100});
  const currents = text('commission-currents', (asked.currents ?? [0, 0.1, 0.2]).join(' '));
  const seas = text('commission-seas', (asked.seas ?? [0]).join(' '));
  const samples = figure('commission-samples', asked.samples ?? 20, {min: 1, max: 10000, step: 1});
  const label = name === null ? 'Begin' : 'Ask for this from now on';
  const send = make('button', {class: 'action wide', type: 'submit', id: 'commission-send'}, label);
  const say = make('p', {class: 'commission-refused', role: 'alert'});

  const request = () => ({
    vehicle: vehicle.value, link: link.value, sensors: words(sensors.value), tank: sides.map(side => side.value).join('x'),
    minutes: minutes.valueAsNumber, prior: prior.value || null, interval: interval.valueAsNumber / 100,
    currents: numbers(currents.value), seas: numbers(seas.value), samples: samples.valueAsNumber,
  });
  const submit = async event => {
    event.preventDefault();
    send.disabled = true;
    [send.textContent, say.textContent] = ['Looking at it …', ''];
    try {
      const order = name === null ? {op: 'begin', folder: folder.value} : {op: 'change', folder: name};
      const answer = await live.send({do: 'commission', ...order, request: request()}, LONG);
      if (name !== null) toast('asked for from now on');
      done(name ?? answer.message);
    } catch (error) {
      say.textContent = error.message;
    }
    [send.disabled, send.textContent] = [false, label];
  };
  return make('form', {class: 'commission-form', onsubmit: submit, 'aria-label': name === null ? 'Begin a commissioning' : 'What is asked for'},
    field('Vehicle', vehicle, 'its file or library name'),
    field('Link', link, 'a URL; the command rovtwin links lists what there is'),
    field('Instruments beside it', sensors, 'URLs, such as ugps://192.168.2.94; may be empty'),
    make('fieldset', {class: 'commission-tank'}, make('legend', {}, 'Tank: length, width, depth of the water [m]'), ...sides),
    field('Most minutes of test flying', minutes),
    field('Earlier identified file', prior, 'of these parts or of others; may be empty'),
    ...(name === null ? [field('Folder', folder, 'below the folder of flights')] : []),
    make('details', {}, make('summary', {}, 'More'),
      field('Test until damping is known to [%]', interval),
      field('Currents to prove it in [m/s]', currents), field('Wave heights to prove it in [m]', seas),
      field('Missions in each of them', samples)),
    say, send);
}
