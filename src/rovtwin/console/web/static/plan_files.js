/** Files of the plan: read from other programs, and written for them. */
import {make} from '/static/canvas.js';
import {live} from '/static/live.js';
import {toast} from '/static/page.js';

const ENDINGS = '.yaml,.yml,.gpx,.kml,.geojson,.json,.plan';
const FORMATS = [['yaml', 'YAML'], ['gpx', 'GPX'], ['kml', 'KML'], ['geojson', 'GeoJSON'], ['plan', 'QGroundControl']];

/** Hands a file to the browser, as if it had been downloaded. */
function give(name, href) {
  make('a', {href, download: name}).click();
}

/** The plan in a format; what that leaves out is told. */
async function giveAs(kind) {
  if (kind === 'yaml') return give('mission.yaml', '/plan.yaml');
  const answer = await fetch(`/plan/${kind}`).then(response => response.json()).catch(() => ({error: 'the console does not answer'}));
  if (answer.error) return toast(answer.error, 'danger');
  const address = URL.createObjectURL(new Blob([answer.text]));
  give(answer.file, address);
  setTimeout(() => URL.revokeObjectURL(address), 1000);
  if (answer.notes.length) toast(answer.notes.join('. '));
}

/** Buttons for a file to the plan and back; `plan(order)` gives an order of the plan. */
export function files(plan) {
  const chooser = make('input', {type: 'file', accept: ENDINGS, 'aria-label': 'Mission file', hidden: true, id: 'mission-file'});
  chooser.addEventListener('change', async () => {
    const file = chooser.files[0];
    chooser.value = '';
    if (!file) return;
    const most = live.last.plan?.largest; // [bytes]
    if (file.size > most) {
      toast(`${file.name}: found ${Math.round(file.size / 1e3)} kB, expected at most ${most / 1e3} kB`, 'danger');
      return;
    }
    plan({op: 'import', name: file.name, text: await file.text()});
  });
  const open = 'Import a mission: YAML, GPX, KML, GeoJSON or a plan of QGroundControl';
  const choose = make('button', {class: 'action', 'aria-label': open, title: open, id: 'import', onclick: () => chooser.click()}, 'Import …');
  const format = make('select', {id: 'export-as', 'aria-label': 'Format of the export'}, ...FORMATS.map(([value, text]) => make('option', {value}, text)));
  const save = make('button', {class: 'action is-open', id: 'export', title: 'Export the plan as a file', onclick: () => giveAs(format.value)}, 'Export');
  return [chooser, choose, save, format];
}
