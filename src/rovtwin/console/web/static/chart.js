/** The chart seen from above: what the console's messages say, and way-points and areas edited by hand. */
import {live} from '/static/live.js';
import {make, mount, surface} from '/static/canvas.js';
import {drawChart} from '/static/chart_draw.js';
import {Hands} from '/static/chart_edit.js';
import {Layers, LayersPanel} from '/static/chart_layers.js';
import {Ruler} from '/static/chart_measure.js';
import {AreaForm, Menu, Notice, Tools, legend} from '/static/chart_panels.js';
import {copied, mapText, onPlaces} from '/static/places.js';
import {View, area, beside, boxOf, nearestLeg} from '/static/geometry.js';
import {layer as rehearsal} from '/static/rehearsal_layer.js';
import {Swath} from '/static/swath.js';
import {SwathPanel} from '/static/swath_panel.js';
import {Track} from '/static/track.js';

const model = {state: null, setup: null, plan: null, rights: null};
const track = new Track(); // outlives the element: a change of tab loses nothing
const swath = new Swath(() => shown?.changed({}));
const layers = new Layers(() => shown?.changed({}));
let shown = null;

const LEAST = 4; // of the water round a vehicle that hangs still, shown where there is no plan [m]
const metres = value => value.toFixed(1);

class Chart {
  view = new View();
  model = model;
  track = track;
  swath = swath;
  layers = layers;
  mode = 'move'; // or add, area, fence, measure
  follow = false;
  fitted = false; // the view, to a plan, once
  touched = false; // by a hand: until then the view fits itself to what there is
  selected = null; // way-point's index
  pending = null; // {i, x, y} of a way-point that was dragged and not yet confirmed by a plan message
  hover = null;
  cursor = null; // where the pointer is [m]
  area = null; // corners drawn so far
  ruler = new Ruler();
  toward = null; // where the next corner would be

  constructor(element) {
    const label = 'Chart: drag to move it, wheel to zoom, right click for a menu';
    this.canvas = make('canvas', {tabindex: 0, role: 'application', 'aria-label': label});
    this.tools = new Tools(this);
    this.menus = new Menu();
    this.form = new AreaForm(values => this.template(values), () => this.setMode('move'));
    this.notice = new Notice(this);
    this.seen = new SwathPanel(this, swath);
    this.under = new LayersPanel(this, layers);
    const corner = make('div', {class: 'chart-corner'}, this.seen.element, this.under.element, legend());
    const panels = [corner, this.notice.element, this.form.element, this.menus.element];
    element.replaceChildren(this.canvas, ...this.tools.elements, ...panels);
    this.surface = surface(this.canvas, (context, width, height) => {
      Object.assign(this.view, {width, height});
      if (this.follow && model.state?.eta) this.view.middle = {x: model.state.eta[0], y: model.state.eta[1]};
      else if (!this.touched && !this.pointed() && this.outgrown()) this.fitView();
      drawChart(context, this);
    });
    new Hands(this.canvas, this);
    this.unwatch = onPlaces(() => this.changed({}));
    this.changed({});
  }

  /** A test has no way-points. */
  editable = () => !model.setup?.test;
  may = () => Boolean(model.rights?.may) && this.editable();
  /** Whether somebody aims at something: what lies under a pointer stays there. */
  pointed = () => Boolean(this.cursor || this.pending || this.area) || this.mode !== 'move';
  /** Whether the view has to fit itself anew; a plan that was cleared is no reason while the vehicle is in sight. */
  outgrown() {
    const planned = Boolean(model.plan?.draft.length || model.plan?.flown.length);
    const at = model.state?.eta && this.view.toScreen({x: model.state.eta[0], y: model.state.eta[1]});
    const inSight = at && at.u > 0 && at.v > 0 && at.u < this.view.width && at.v < this.view.height;
    const stays = this.fitted && !planned && inSight;
    this.fitted ||= planned;
    return !stays;
  }
  drawing = () => ['area', 'fence'].includes(this.mode) && this.may() && !this.form.open;

  /** Way-points of the draft, the dragged one where the hand has it. */
  draft = () => {
    const {pending} = this;
    return (model.plan?.draft ?? []).map((p, i) => (pending?.i === i ? {...p, x: pending.x, y: pending.y} : p));
  };

  /** A click while distances are measured. */
  measure(place) {
    this.ruler.add(place);
    this.changed({});
  }

  get outline() {
    const {area: points, toward} = this;
    return points && {points, toward, closed: this.form.open || (!toward && points.length > 2)};
  }

  changed(values) {
    Object.assign(this, values);
    this.tools.show();
    this.notice.show();
    this.seen.show();
    this.under.show();
    this.surface.redraw();
  }

  // The view

  panned(du, dv) {
    this.view.pan(du, dv);
    this.changed({follow: false, touched: true});
  }

  zoomed(factor, pixel) {
    this.view.zoom(factor, this.follow ? undefined : pixel);
    this.changed({touched: true});
  }

  fit() {
    this.fitView();
    this.changed({follow: false, touched: true});
  }

  /** Plan, vehicle, home and tank; the fence only where it leaves the others large enough to see. */
  fitView() {
    const {setup, state, plan} = model;
    const points = [...(plan?.draft ?? []), ...(plan?.flown ?? []), ...(track.known ?? [])];
    if (state?.eta) points.push({x: state.eta[0], y: state.eta[1]});
    if (setup?.home) points.push({x: setup.home[0], y: setup.home[1]});
    const ends = ([south, north], [west, east]) => [{x: south, y: west}, {x: north, y: east}];
    if (setup?.room?.kind === 'tank') points.push(...ends(setup.room.x, setup.room.y));
    const fence = setup?.fence?.north && setup.fence.east ? ends(setup.fence.north, setup.fence.east) : [];
    const reach = ({low, high}) => Math.max(high.x - low.x, high.y - low.y);
    const box = boxOf(points);
    const all = boxOf([...points, ...fence]);
    const margin = Math.max(30, 0.09 * Math.min(this.view.width, this.view.height));
    const closest = Math.min(this.view.width, this.view.height) / LEAST;
    if (all) this.view.fit(box && reach(all) > 3 * reach(box) ? box : all, margin, this.tools.room(), closest);
  }

  // Editing: everything is asked of the server, and drawn when its plan message comes

  async ask(message) {
    try {
      await live.send(message);
      return true;
    } catch (error) {
      this.notice.complain(String(error?.message ?? error));
      return false;
    }
  }

  plan = (op, values) => this.may() && this.ask({do: 'plan', op, ...values});
  add = point => this.plan('add', point);
  insert = (i, {x, y}) => this.plan('insert', {i, x: Math.round(x * 100) / 100, y: Math.round(y * 100) / 100});

  async move() {
    const {pending} = this;
    if (pending && !(await this.plan('move', pending)) && this.pending === pending) this.changed({pending: null});
  }

  remove(i = this.selected) {
    if (i === null || !this.may()) return;
    this.changed({selected: null, hover: null});
    this.plan('delete', {i});
  }

  setMode(mode) {
    if (mode === 'fence' && model.state?.armed) return this.notice.complain('Disarm first: the log of a flight has one fence.');
    this.form.hide();
    // Whoever lays points by hand has chosen what to see of the water: from then on the view is theirs.
    this.ruler.clear();
    this.changed({mode, area: null, toward: null, touched: this.touched || mode !== 'move'});
  }

  areaDrawn() {
    if (!this.area || this.area.length < 3 || area(this.area) < 0.01) {
      this.changed({area: null});
      return this.notice.complain('The area is too small: drag out a rectangle, or click three corners or more.');
    }
    this.changed({toward: null});
    if (this.mode === 'fence') return this.fence(this.area.map(({x, y}) => [x, y].map(value => Math.round(value * 100) / 100)));
    const {draft, own, line_speed} = model.plan ?? {};
    const last = draft?.at(-1);
    const speed = last?.speed ?? own?.speed;
    const {low, high} = boxOf(this.area);
    const width = Math.min(high.x - low.x, high.y - low.y);
    this.form.show(area(this.area), width, {depth: last?.depth ?? model.state?.setpoint?.[2], speed}, line_speed);
    this.changed({});
  }

  /** Corners [north, east] in which the vehicle has to stay from the next flight on; null: the scenario's own. */
  async fence(corners) {
    if (await this.ask({do: 'fence', corners})) this.setMode('move');
    else this.changed({area: null});
  }

  /** A lawn-mower plan over the area; rejects with the reason where there is none. */
  async template(values) {
    const corners = this.area.map(({x, y}) => [Math.round(x * 100) / 100, Math.round(y * 100) / 100]);
    await live.send({do: 'plan', op: 'template', name: 'lawnmower', area: corners, ...values});
    this.setMode('move');
  }

  closeMenu = () => this.menus.hide();

  /** At a pixel, of way-point i or (null) of an empty place. */
  menu(pixel, i) {
    if (!this.editable()) return;
    const draft = this.draft();
    const here = i === null ? this.view.toWorld(pixel) : draft[i];
    const depth = draft[i]?.depth ?? model.state?.setpoint?.[2] ?? model.state?.eta?.[2] ?? 0;
    const place = {x: Math.round(here.x * 100) / 100, y: Math.round(here.y * 100) / 100};
    const items = [[`Go to here, ${metres(depth)} m deep`, () => this.ask({do: 'goto', ...place, depth})]];
    const words = mapText({...place, depth});
    const copy = () => copied(words).catch(error => this.notice.complain(error.message));
    if (i !== null) {
      const side = which => beside(draft, i, which, 60 / this.view.scale);
      items.push(['Insert before', () => this.insert(i, side(-1))]);
      items.push(['Insert after', () => this.insert(i + 1, side(1))]);
      items.push([`Delete way-point ${i + 1}`, () => this.remove(i)]);
    } else {
      items.push(['Add way-point here', () => this.add(place)]);
      const leg = nearestLeg(draft, here);
      if (leg !== null) items.push([`Insert between ${leg + 1} and ${leg + 2}`, () => this.insert(leg + 1, here)]);
    }
    if (model.setup?.fence_drawn) items.push(['Take the drawn fence away', () => this.fence(null)]);
    if (words) items.push([`Copy ${words}`, copy, true]);
    this.changed({selected: i});
    this.menus.show(pixel, this.view, items, this.may());
  }

  release() {
    this.unwatch();
    this.surface.release();
    this.notice.release();
  }
}

mount('chart', element => {
  const chart = new Chart(element);
  shown = chart;
  return () => {
    chart.release();
    shown = null;
  };
});

// Delete takes the chosen way-point away wherever the focus is, but for what is being typed; on the canvas it does already.
document.addEventListener('keydown', event => {
  if (event.key !== 'Delete' || event.defaultPrevented || event.target.closest?.('input, textarea, select, #plan .table')) return;
  if (!shown?.canvas.clientWidth || shown.selected === null) return;
  event.preventDefault();
  shown.remove();
});

live.on('state', state => {
  model.state = state;
  if (state.eta) track.add({t: state.t, x: state.eta[0], y: state.eta[1]});
  if (state.replay) shown?.seen.show();
  shown?.surface.redraw();
});
live.on('track', states => {
  track.know(states.filter(s => s.eta).map(({t, eta: [x, y]}) => ({t, x, y})));
  shown?.surface.redraw();
});
live.on('setup', setup => {
  model.setup = setup;
  shown?.changed({});
});
live.on('plan', plan => {
  const fewer = plan.draft.length < (model.plan?.draft.length ?? 0);
  model.plan = plan.submitted ? plan : {...plan, flown: []}; // what a scenario brings along is only drafted
  shown?.changed(fewer ? {pending: null, selected: null, hover: null} : {pending: null});
});
rehearsal.changed = () => shown?.surface.redraw();
for (const kind of ['rehearsal', 'rehearsing']) live.on(kind, rehearsal.changed);
live.on('rights', rights => {
  model.rights = rights;
  if (rights.may) shown?.changed({});
  else {
    shown?.closeMenu();
    shown?.changed({pending: null});
    shown?.setMode('move');
  }
});
