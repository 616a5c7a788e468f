/** Controls on the chart: tools, the menu of a place, the form for an area, and a line that says what is going on. */
import {make} from '/static/canvas.js';
import {faultsOf} from '/static/faults.js';
import {area, roundLength} from '/static/geometry.js';
import {WAYS, mapText, onMap, placesAs, turnPlaces} from '/static/places.js';

const MAKE = 'Make plan';
const SIGNS = {m: 'm', deg: '°', min: '° ′'}; // of how places are written
const LINES = 4; // over an area at least, where nobody says how far apart

const button = (text, label, onclick, more = {}) =>
  make('button', {type: 'button', title: label, 'aria-label': label, onclick, ...more}, text);

/** Tools for editing at the upper left, those of the view at the upper right. */
export class Tools {
  constructor(chart) {
    this.chart = chart;
    const mode = (text, label, name) => [name, button(text, label, () => chart.setMode(name))];
    this.modes = new Map([
      mode('Move', 'Move way-points and the chart', 'move'),
      mode('Add', 'Add way-points by clicking', 'add'),
      mode('Area', 'Draw an area for a lawn-mower plan', 'area'),
      mode('Fence', 'Draw the fence in which the vehicle has to stay', 'fence'),
    ]);
    this.measure = button('Measure', 'Measure distances, bearings and areas', () => chart.setMode(chart.mode === 'measure' ? 'move' : 'measure'));
    this.remove = button('Delete', 'Delete the chosen way-point', () => chart.remove());
    this.places = button('m', '', turnPlaces);
    this.follow = button('Follow', 'Follow the vehicle', () => chart.changed({follow: !chart.follow, touched: true}));
    this.elements = [
      make(
        'div',
        {class: 'chart-tools chart-left', role: 'toolbar', 'aria-label': 'Edit the plan'},
        ...this.modes.values(),
        this.remove,
      ),
      make(
        'div',
        {class: 'chart-tools chart-right', role: 'toolbar', 'aria-label': 'View of the chart'},
        button('+', 'Zoom in', () => chart.zoomed(1.5)),
        button('\u2212', 'Zoom out', () => chart.zoomed(1 / 1.5)),
        button('Fit', 'Show the whole plan', () => chart.fit()),
        this.follow,
        this.measure,
        this.places,
      ),
    ];
  }

  /** What the buttons cover of the chart's upper and right edge [px]. */
  room() {
    const [left, right] = this.elements;
    return {top: left.hidden ? 0 : left.offsetTop + left.offsetHeight, right: right.offsetWidth + 10};
  }

  show() {
    const {chart} = this;
    for (const [name, element] of this.modes) {
      element.setAttribute('aria-pressed', String(chart.mode === name));
      element.disabled = !chart.may() && name !== 'move';
    }
    this.elements[0].hidden = !chart.editable();
    this.elements[0].classList.toggle('is-watching', !chart.may());
    this.remove.disabled = !chart.may() || chart.selected === null;
    this.follow.setAttribute('aria-pressed', String(chart.follow));
    this.measure.setAttribute('aria-pressed', String(chart.mode === 'measure'));
    const [name, words] = WAYS.find(([way]) => way === placesAs());
    Object.assign(this.places, {hidden: !onMap(), textContent: SIGNS[name], title: `Places are written in ${words}: press for another way`});
    this.places.setAttribute('aria-label', this.places.title);
  }
}

/** What the chart's signs mean; folded until asked for. */
export function legend() {
  const rows = [
    ['is-track', 'vehicle, its track'],
    ['is-ellipse', 'where it is with 95 %'],
    ['is-reference', 'desired position'],
    ['is-truth', 'where the twin really is'],
    ['is-flown', 'plan being flown'],
    ['is-leg', 'leg being flown'],
    ['is-draft', 'plan being drafted'],
    ['is-rehearsed', 'rehearsed track', 'of-rehearsal'],
    ['is-corridor', 'its corridor', 'of-rehearsal'],
    ['is-once', 'floor seen once', 'of-swath'],
    ['is-more', 'seen more often', 'of-swath'],
    ['is-gap', 'not seen of the area', 'of-swath'],
  ];
  const sign = kind => make('i', {class: kind, 'aria-hidden': 'true'});
  const list = rows.map(([kind, text, of]) => make('li', {class: of}, sign(kind), text));
  const summary = make('summary', {'aria-label': 'Legend of the chart'}, 'Legend');
  return make('details', {class: 'chart-legend'}, summary, make('ul', {}, ...list));
}

/** What can be done at a place: opened by a right click or a long press. */
export class Menu {
  constructor() {
    this.element = make('div', {
      class: 'chart-menu',
      role: 'menu',
      'aria-label': 'At this place',
      tabindex: -1,
      hidden: true,
      onkeydown: e => this.#key(e),
      onfocusout: e => this.element.contains(e.relatedTarget) || this.hide(),
    });
  }

  /** Shows items [[text, act, free], ...] at a pixel; greyed, with the reason, where nothing may be edited but the free. */
  show({u, v}, view, items, may) {
    const entries = items.map(([text, act, free]) =>
      make('button', {type: 'button', role: 'menuitem', disabled: !may && !free, onclick: () => (this.hide(), act())}, text));
    if (!may) entries.unshift(make('p', {}, 'You are watching: take control to do this.'));
    this.element.replaceChildren(...entries);
    this.element.hidden = false;
    const {offsetWidth, offsetHeight} = this.element;
    this.element.style.left = `${Math.max(4, Math.min(u, view.width - offsetWidth - 4))}px`;
    this.element.style.top = `${Math.max(4, Math.min(v, view.height - offsetHeight - 4))}px`;
    (this.element.querySelector('button:enabled') ?? this.element).focus();
  }

  hide() {
    this.element.hidden = true;
  }

  #key(event) {
    const items = [...this.element.querySelectorAll('button:enabled')];
    const step = {ArrowDown: 1, ArrowUp: -1}[event.key];
    if (event.key === 'Tab') this.hide();
    if (!step) return;
    event.preventDefault();
    event.stopPropagation(); // else the arrow would also pilot the vehicle
    items.at((items.indexOf(document.activeElement) + step) % items.length)?.focus();
  }
}

/**
 * Line spacing, depth and speed for an area that was drawn. It never makes the rest of the page inert, as a modal
 * dialog would: STOP must stay one click away.
 */
export class AreaForm {
  constructor(submit, cancel) {
    const field = (name, text, unit, value, least) => {
      const range = {type: 'number', min: least, step: 'any', inputmode: 'decimal', required: true};
      const input = make('input', {name, value, ...range});
      return make('label', {}, make('span', {}, text), input, make('span', {class: 'chart-unit'}, unit));
    };
    this.size = make('p', {});
    this.limit = make('p', {class: 'chart-small'});
    this.error = make('p', {class: 'chart-error', role: 'alert'});
    this.cancel = make('button', {type: 'button', onclick: cancel}, 'Cancel');
    this.confirm = make('button', {type: 'submit', class: 'chart-primary'}, MAKE);
    this.element = make(
      'form',
      {
        class: 'chart-form',
        role: 'dialog',
        'aria-label': 'Lawn-mower plan over the area',
        hidden: true,
        onsubmit: e => this.#submit(e, submit),
      },
      make('h2', {}, 'Lawn-mower over this area'),
      this.size,
      field('spacing', 'Line spacing', 'm', 2, 0.1),
      field('depth', 'Depth', 'm', 3, 0),
      field('speed', 'Speed', 'm/s', '', 0.01),
      this.limit,
      make(
        'label',
        {class: 'chart-check'},
        make('input', {name: 'inside', type: 'checkbox'}),
        make('span', {}, 'Stay inside the area'),
      ),
      make('p', {class: 'chart-small'}, 'Else turns lie outside of it, so that lines are at full speed.'),
      make('p', {class: 'chart-small'}, 'Takes the place of the draft; undo brings that back.'),
      this.error,
      make('div', {class: 'chart-buttons'}, this.cancel, this.confirm),
    );
  }

  get open() {
    return !this.element.hidden;
  }

  /**
   * Asks for an area of so many square metres, `width` at its narrowest [m]; depth and speed of the plan so far are put
   * in, where known. `fastest` is the speed that the vehicle has for lines [m/s].
   */
  show(squareMetres, width, known, fastest) {
    const {elements} = this.element;
    this.size.textContent = `${squareMetres.toFixed(squareMetres < 10 ? 1 : 0)} m², ${width.toFixed(1)} m at its narrowest`;
    for (const [name, value] of Object.entries(known)) {
      if (Number.isFinite(value) && value > 0) elements[name].value = Number(value.toFixed(2));
    }
    if (fastest > 0 && !(Number(elements.speed.value) <= fastest)) elements.speed.value = fastest;
    this.limit.textContent = fastest > 0 ? `At most ${fastest} m/s: half of the thrust keeps the course.` : '';
    elements.spacing.value = Math.min(Number(elements.spacing.value) || Infinity, roundLength(width / LINES));
    this.error.textContent = '';
    this.element.hidden = false;
    elements.spacing.select();
  }

  hide() {
    this.element.hidden = true;
  }

  async #submit(event, submit) {
    event.preventDefault();
    const {elements} = this.element;
    const values = ['spacing', 'depth', 'speed'].map(name => [name, Number(elements[name].value)]);
    this.error.textContent = '';
    const since = performance.now();
    const tell = () => { this.confirm.textContent = `Planning … ${Math.round((performance.now() - since) / 1e3)} s`; };
    const clock = setInterval(tell, 1000);
    tell();
    this.#busy(true); // a double click asks once
    try {
      await submit({...Object.fromEntries(values), inside: elements.inside.checked});
    } catch (error) {
      this.error.textContent = error.message;
      this.error.scrollIntoView({block: 'nearest'});
    } finally {
      clearInterval(clock);
      this.confirm.textContent = MAKE;
      this.#busy(false);
    }
  }

  #busy(on) {
    this.element.setAttribute('aria-busy', String(on));
    this.confirm.disabled = this.cancel.disabled = on;
  }
}

/** The line at the foot: what a click does now, which way-point is chosen, where the pointer is; errors for a while. */
export class Notice {
  #timer = 0;

  constructor(chart) {
    this.chart = chart;
    this.hint = make('span', {});
    this.error = make('span', {class: 'chart-error', role: 'alert'});
    this.done = button('Done', 'Finish the area', () => chart.areaDrawn(), {hidden: true});
    this.cancel = button('Cancel', 'Leave this mode', () => chart.setMode('move'), {hidden: true});
    this.element = make('div', {class: 'chart-notice'}, this.error, this.hint, this.done, this.cancel);
  }

  show() {
    const {chart} = this;
    const drawing = chart.drawing();
    this.done.hidden = !(drawing && chart.area?.length > 2);
    this.cancel.hidden = !drawing && chart.mode !== 'measure' && (chart.mode !== 'add' || !chart.may());
    const text = this.#text();
    if (this.hint.textContent !== text) this.hint.textContent = text;
    this.element.hidden = !text && !this.error.textContent && this.cancel.hidden;
  }

  #text() {
    const {chart} = this;
    const i = chart.pending?.i ?? chart.selected;
    const point = i === null ? null : chart.draft()[i];
    const at = place => {
      const words = mapText(place);
      return `N ${place.x.toFixed(1)}, E ${place.y.toFixed(1)} m${words && ` · ${words}`}`;
    };
    if (chart.mode === 'measure') return chart.ruler.text(chart.cursor);
    if (chart.drawing()) return this.#areaText(chart.area);
    const speed = point?.speed ? `, ${Number(point.speed.toFixed(2))} m/s` : '';
    const fault = faultsOf(chart.model.plan?.checks).get(i);
    if (point) return `${i + 1}: ${at(point)}, ${point.depth.toFixed(1)} m deep${speed}${fault ? `. ${fault.what}` : ''}`;
    const pointer = chart.cursor ? at(chart.cursor) : '';
    if (chart.mode !== 'add' || !chart.may()) return pointer;
    return `Click to add a way-point${pointer && ` · ${pointer}`}`;
  }

  #areaText(points) {
    if (!points) return `${this.chart.mode === 'fence' ? 'Fence: drag' : 'Drag'} out a rectangle or click corners`;
    const size = points.length > 2 ? `${area(points).toFixed(1)} m² · ` : '';
    return `${size}click the next corner, on the first one to finish`;
  }

  complain(text) {
    this.error.textContent = text;
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => {
      this.error.textContent = '';
      this.show();
    }, 8000);
    this.show();
  }

  release() {
    clearTimeout(this.#timer);
  }
}
