/** What the head-up display says in words, from the state message; without a page. */

import {lasting} from '/static/clock.js';

const OFF_MISSION = new Set(['idle', 'piloted']);
const GRAVE = new Set(['aborted', 'held', 'returning', 'returned', 'surfacing', 'surfaced']);

/** The newest readings of the sensors of a kind, [{age, value}]: of `leak`, `leak_2` and so on. */
export function ofKind(state, kind) {
  const named = name => name.replace(/_[2-9]\d*$|_1\d+$/, '') === kind;
  return Object.entries(state.sensors ?? {}).filter(([name]) => named(name)).map(([, reading]) => reading);
}

/** Height over the ground of the altimeter: {text, old} where a vehicle has one, else null; `old` says since when. */
export function depthUnder(state, setup) {
  const [reading] = ofKind(state, 'altimeter');
  if (!reading) return setup?.sensors?.includes('altimeter') ? {text: '–', old: ''} : null;
  const value = reading.value?.[0];
  const text = Number.isFinite(value) ? value.toFixed(2) : '–';
  return {text, old: reading.age > 1 ? `${reading.age.toFixed(0)} s ago` : ''};
}

/** Lines [{text, level (a colour's name), small}] at the lower left (what it does) and right (how far it is). */
export function hudLines(state) {
  const left = [thrust(state)];
  const note = state.note ? `: ${state.note}` : '';
  if (state.stage !== 'ready' && state.stage !== 'replay') left.push({text: `${state.stage}${note}`, level: 'hud-warn'});
  else if (state.phase) {
    const reason = state.reason ? `: ${state.reason}` : '';
    left.push({text: `${state.phase.toUpperCase()}${reason}`, level: graveness(state)});
  }
  return {left, right: progress(state)};
}

const graveness = ({phase, reason}) => (!GRAVE.has(phase) ? 'hud' : reason === 'operator' ? 'hud-warn' : 'hud-danger');

function thrust({stopped, hung, armed, arming}) {
  if (stopped) return {text: 'STOPPED', level: 'hud-danger', small: true};
  if (hung) return {text: 'AUTOPILOT HANGS', level: 'hud-danger', small: true};
  if (armed) return {text: 'ARMED', level: 'hud-ok', small: true};
  return {text: arming ? 'ARMING' : 'DISARMED', level: arming ? 'hud-warn' : 'hud-muted', small: true};
}

/** Whether way-points mean anything: nothing of a mission is flown before its start, after it, or by hand. */
export const onMission = ({count, phase, experiment}) => Boolean(count) && (Boolean(experiment) || !OFF_MISSION.has(phase));

/** `waypoint` counts from 0, people from 1. */
function progress(state) {
  const {count, waypoint, to_go, experiment} = state;
  if (!onMission(state)) return [];
  if (experiment) {
    return [
      {text: `manoeuvre ${experiment.manoeuvre + 1} of ${experiment.of}`, small: true},
      {text: experiment.running ? lasting(experiment.remaining) : ''},
    ];
  }
  return [
    {text: `way-point ${Math.min(waypoint + 1, count)} of ${count}`, small: true},
    {text: Number.isFinite(to_go) ? `${to_go.toFixed(1)} m to go` : ''},
  ];
}
