/** What was seen of the floor in words: share, gaps, the height that it rests on; which eye, and lines over the gaps. */
import {make} from '/static/canvas.js';
import {lasting} from '/static/clock.js';
import {live} from '/static/live.js';
import {squareMetres} from '/static/swath.js';

const NOTHING = 'Seen: nothing yet';
const QUIET = 2; // nothing new for so long is worth a word [s]
const KINDS = {imager: 'imager', camera: 'camera', sonar: 'sonar'};
const percent = share => `${share > 0.99 && share < 1 ? '> 99' : Math.round(100 * share)} %`;

export class SwathPanel {
  constructor(chart, swath) {
    Object.assign(this, {chart, swath});
    this.head = make('span', {}, NOTHING);
    this.eyes = make('select', {'aria-label': 'Sensor whose swath is shown', onchange: () => this.#pick()});
    this.picked = make('label', {hidden: true}, make('span', {}, 'Sensor'), this.eyes);
    this.layer = make('input', {type: 'checkbox', checked: true, onchange: () => this.#toggle()});
    this.facts = make('ul', {});
    this.fill = make('button', {type: 'button', class: 'chart-fill', onclick: () => this.#fill()}, 'Plan the gaps');
    this.answer = make('p', {role: 'status'});
    this.gaps = make('span', {class: 'chart-small'});
    this.note = make('span', {class: 'chart-note'});
    this.more = make(
      'details',
      {ontoggle: () => this.show()},
      make('summary', {}, this.head, this.gaps, this.note),
      make('label', {}, this.layer, make('span', {}, 'Show what was seen')),
      this.picked,
      this.facts,
    );
    this.element = make('div', {class: 'chart-swath', hidden: true}, this.more, this.fill, this.answer);
  }

  show() {
    const {swath, chart} = this;
    const {eye, message} = swath;
    this.element.hidden = !eye && !message?.notes?.length;
    if (this.element.hidden) return;
    const names = (message.eyes ?? []).map(one => one.name);
    if (this.names !== names.join()) {
      this.names = names.join();
      this.eyes.replaceChildren(...message.eyes.map(one => make('option', {value: one.name}, `${one.name} (${KINDS[one.kind]})`)));
      this.picked.hidden = names.length < 2;
    }
    if (eye) this.eyes.value = eye.name;
    const t = chart.model.state?.t ?? 0;
    for (const [element, text] of [[this.head, this.#head(t)], [this.gaps, this.#missing()], [this.note, this.#silence(t)]]) {
      if (element.textContent !== text) element.textContent = text;
    }
    const facts = this.#facts();
    if (this.listed !== facts.join()) {
      this.listed = facts.join();
      this.facts.replaceChildren(...facts.map(text => make('li', {}, text)));
    }
    const why = this.#refusal();
    this.fill.hidden = Boolean(chart.model.state?.replay) || !eye || (Boolean(why) && !this.more.open);
    this.fill.disabled = Boolean(why) || this.busy;
    this.fill.title = why || 'Lay a draft over what was not seen of the area';
  }

  #head(t) {
    const {eye, picture} = this.swath;
    if (!eye) return 'Seen: not known';
    if (eye.found?.share !== undefined) return `Seen ${percent(eye.found.share)} of ${squareMetres(eye.found.area_m2)}`;
    if (!picture) return NOTHING;
    return `Seen ${squareMetres(eye.course ? picture.seen(t) : eye.seen_m2)}`;
  }

  /** How much of the area is missing. */
  #missing() {
    const {found} = this.swath.eye ?? {};
    if (!found || found.error) return '';
    return found.count ? `${found.count} ${found.count === 1 ? 'gap' : 'gaps'}, ${squareMetres(found.gaps_m2)}` : 'no gaps';
  }

  /** Why nothing is painted now, and for how long. */
  #silence(t) {
    const {eye, message} = this.swath;
    const why = eye && this.swath.why(t);
    if (!why || !(message.flying || eye.course)) return '';
    const since = eye.course || eye.ended === null ? 0 : t - eye.ended;
    return `not painted now: ${why}${since > QUIET ? `, for ${lasting(since)}` : ''}`;
  }

  #facts() {
    const {eye, message, picture} = this.swath;
    const facts = [...(message.notes ?? [])];
    if (!eye) return facts;
    if (eye.found?.error) facts.push(eye.found.error);
    if (!message.area && !eye.course) facts.push('no area: lay a survey with Area');
    if (picture && !eye.course) facts.push(`seen within ${lasting(eye.ended - eye.began)}`);
    const known = eye.height !== null && eye.height !== undefined;
    if (eye.by) facts.push(`${known ? `${eye.height.toFixed(2)} m over the floor` : 'height'} by ${eye.by}`);
    facts.push(`sees up to ${eye.reach} m far`);
    return facts;
  }

  /** Why no lines can be laid over gaps now, "" where they can. */
  #refusal() {
    const {eye, message} = this.swath;
    if (!this.chart.may()) return 'You are watching: take control to do this';
    if (!message?.area) return 'There is no area: lay a survey with Area first';
    if (!eye || eye.began === null) return 'Nothing was seen yet: fly the survey first';
    return eye.found?.share !== undefined && !eye.found.count ? 'Nothing is missing: all of the area was seen' : '';
  }

  #pick() {
    this.swath.name = this.eyes.value;
    this.chart.changed({});
  }

  #toggle() {
    this.swath.shown = this.layer.checked;
    this.chart.changed({});
  }

  async #fill() {
    this.busy = true;
    this.answer.className = '';
    this.answer.textContent = 'Planning …';
    this.show();
    try {
      this.answer.textContent = (await live.send({do: 'fill_gaps', eye: this.swath.eye.name})).message ?? '';
    } catch (error) {
      this.answer.className = 'chart-error';
      this.answer.textContent = error.message;
    }
    this.busy = false;
    this.show();
  }
}
