/** What lies under the plan: maps of one's own and tracks of earlier dives, and the panel to choose them in. */
import {make} from '/static/canvas.js';
import {Dives} from '/static/chart_dives.js';
import {Maps} from '/static/chart_maps.js';
import {live} from '/static/live.js';

export class Layers {
  known = false; // whether the server has any: that of a replay alone has not

  constructor(changed) {
    this.maps = new Maps(changed);
    this.dives = new Dives(changed);
    this.changed = changed;
    live.on('layers', ({maps}) => {
      this.known = true;
      this.maps.take(maps);
      changed();
    });
  }
}

export class LayersPanel {
  constructor(chart, layers) {
    Object.assign(this, {chart, layers});
    this.maps = make('ul', {'aria-label': 'Maps'});
    this.runs = make('ul', {'aria-label': 'Earlier dives'});
    this.say = make('p', {role: 'status'});
    const strength = make('input', {type: 'range', min: 0.1, max: 1, step: 0.1, value: layers.maps.strength, 'aria-label': 'Strength of the maps'});
    strength.addEventListener('input', () => {
      layers.maps.strength = Number(strength.value);
      layers.changed();
    });
    this.strength = make('label', {}, 'strength', strength);
    this.element = make('details', {class: 'chart-layers'}, make('summary', {'aria-label': 'Maps and earlier dives'}, 'Layers'),
      this.maps, this.strength, make('p', {class: 'chart-small'}, 'Earlier dives'), this.runs, this.say);
    this.element.addEventListener('toggle', () => this.element.open && this.#look());
  }

  show() {
    const {layers, chart} = this;
    this.element.hidden = !layers.known;
    this.strength.hidden = !layers.maps.list.length;
    if (this.maps.childElementCount !== layers.maps.list.length) this.maps.replaceChildren(...layers.maps.list.map((map, i) => this.#map(map, i)));
    layers.maps.list.forEach((map, i) => {
      const away = layers.maps.away(chart.view, map);
      const note = this.maps.children[i].lastElementChild;
      if (note.textContent !== away) note.textContent = away;
    });
  }

  #map({name, north, east, pixel}, i) {
    const box = make('input', {type: 'checkbox'});
    box.checked = this.layers.maps.shown.has(i);
    box.addEventListener('change', () => {
      this.layers.maps.shown[box.checked ? 'add' : 'delete'](i);
      this.layers.changed();
    });
    const about = `north ${north.map(Math.round).join(' to ')} m, east ${east.map(Math.round).join(' to ')} m, pixels of ${Number(pixel.toPrecision(2))} m`;
    return make('li', {title: about}, make('label', {}, box, name), make('span', {class: 'chart-note'}));
  }

  async #look() {
    const {dives} = this.layers;
    this.say.textContent = 'looking for runs';
    try {
      await dives.look();
      this.runs.replaceChildren(...dives.runs.map(run => this.#run(run)));
      this.say.textContent = dives.runs.length ? '' : `no finished run in ${dives.folder} yet`;
    } catch {
      this.say.textContent = 'the console does not answer';
    }
  }

  #run(run) {
    const box = make('input', {type: 'checkbox'});
    box.checked = this.layers.dives.has(run.run);
    box.addEventListener('change', async () => {
      box.disabled = true;
      this.say.textContent = box.checked ? `reading ${run.name}` : '';
      try {
        await this.layers.dives.show(run, box.checked);
        this.say.textContent = '';
      } catch (error) {
        box.checked = false;
        this.say.textContent = error.message;
      }
      box.disabled = false;
    });
    return make('li', {title: run.run}, make('label', {}, box, make('span', {}, run.name, make('span', {class: 'chart-small'}, run.date))));
  }
}
