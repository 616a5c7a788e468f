/** What can be plotted, and where it stands in a state message: one table, with units as shown. */

const DEGREES = 180 / Math.PI;
const EVEN = 1.96; // standard deviations within which a number is with 95 %
const AXES = ['x', 'y', 'z', 'phi', 'theta', 'psi'];
const WRENCH = [['X', 'N'], ['Y', 'N'], ['Z', 'N'], ['K', 'N m'], ['M', 'N m'], ['N', 'N m']];
const POSE = ['North', 'East', 'Depth', 'Roll', 'Pitch', 'Heading'];
const SPEEDS = ['Surge speed u', 'Sway speed v', 'Heave speed w', 'Roll rate p', 'Pitch rate q', 'Yaw rate r'];

const unit = i => (i < 3 ? 'm' : '°');
const scale = i => (i < 3 ? 1 : DEGREES);
const wrapped = a => Math.atan2(Math.sin(a), Math.cos(a));
/** Angles: roll and pitch about zero, heading 0 to 360. */
const shown = (i, value) => (i < 3 ? value : i === 5 ? (wrapped(value) * DEGREES + 360) % 360 : wrapped(value) * DEGREES);

/** Rate of the reference as velocity in b: R_nb^T for the first three, T^-1 for the rest. */
function desired(s, i) {
  const [phi, theta, psi] = s.eta.slice(3);
  const [[x, y, z], [dphi, dtheta, dpsi]] = [s.reference_rate.slice(0, 3), s.reference_rate.slice(3)];
  const [sf, cf, st, ct, sp, cp] = [phi, theta, psi].flatMap(a => [Math.sin(a), Math.cos(a)]);
  const along = cp * x + sp * y;
  const across = -sp * x + cp * y;
  return [
    () => ct * along - st * z,
    () => sf * st * along + cf * across + sf * ct * z,
    () => cf * st * along - sf * across + cf * ct * z,
    () => dphi - st * dpsi,
    () => cf * dtheta + sf * ct * dpsi,
    () => -sf * dtheta + cf * ct * dpsi,
  ][i]();
}

/**
 * A channel: id, group, name, unit, `lines(state)` -> {value, reference?, truth?, low?, high?} (undefined: not there),
 * `turns`: 360 where it wraps, `down`: shown with large values below, `expected`: low and high are where it should be,
 * not where it may be, `least`: what is always shown.
 */
function fixed() {
  const made = [];
  const add = (id, group, name, unit, lines, more = {}) => made.push({id, group, name, unit, lines, ...more});
  AXES.forEach((axis, i) => add(axis, 'Pose', POSE[i], unit(i), s => {
    const value = shown(i, s.eta[i]);
    const half = EVEN * scale(i) * (s.sd?.[i] ?? NaN);
    return {value, low: value - half, high: value + half, reference: s.reference && shown(i, s.reference[i]), truth: s.truth && shown(i, s.truth[i])};
  }, {turns: i === 5 ? 360 : 0, down: i === 2}));
  SPEEDS.forEach((name, i) => add('uvwpqr'[i], 'Velocity', name, i < 3 ? 'm/s' : '°/s',
    s => ({value: scale(i) * (s.nu?.[i] ?? NaN), reference: s.reference_rate && scale(i) * desired(s, i)})));
  add('error', 'Errors', 'Distance from reference', 'm', s => ({value: s.reference && Math.hypot(...[0, 1, 2].map(i => s.eta[i] - s.reference[i]))}));
  AXES.forEach((axis, i) => add(`error_${axis}`, 'Errors', `${POSE[i]} less reference`, unit(i),
    s => ({value: s.reference && scale(i) * less(i, s.eta, s.reference)})));
  AXES.forEach((axis, i) => add(`estimate_${axis}`, 'Errors', `${POSE[i]} less truth`, unit(i), s => {
    const half = EVEN * scale(i) * (s.sd?.[i] ?? NaN);
    return {value: s.truth && scale(i) * less(i, s.eta, s.truth), low: -half, high: half};
  }, {expected: true}));
  AXES.forEach((axis, i) => add(`sd_${axis}`, 'Standard deviations', `${POSE[i]}, standard deviation`, unit(i), s => ({value: s.sd && scale(i) * s.sd[i]})));
  WRENCH.forEach(([name, unit], i) => add(`tau_${name}`, 'Wrench', `Wrench ${name}`, unit, s => ({value: s.tau?.[i]})));
  add('late', 'Timing', 'Autopilot late', 'ms', s => ({value: s.late_ms}));
  add('link_age', 'Timing', 'Link age', 's', s => ({value: s.link_age}));
  add('operator_age', 'Timing', 'Operator age', 's', s => ({value: s.operator_age}));
  add('pace', 'Timing', 'Pace of time', 'x', s => ({value: s.speed}));
  add('progress', 'Mission', 'Progress', '%', s => ({value: 100 * (s.progress ?? NaN)}));
  add('to_go', 'Mission', 'Distance to go', 'm', s => ({value: s.to_go}));
  ['north', 'east', 'down'].forEach((name, i) => add(`current_${name}`, 'Water', `Current ${name}`, 'm/s', s => ({value: s.current?.[i]})));
  ['north', 'east', 'down'].forEach((name, i) => add(`wave_${name}`, 'Water', `Wave motion ${name}`, 'm', s => ({value: s.wave?.[i]})));
  return made;
}

const less = (i, a, b) => (i < 3 ? a[i] - b[i] : wrapped(a[i] - b[i]));

/** Channels whose names a vehicle gives: thrusters, sensors, filter consistency. */
function own(setup, state) {
  const made = [];
  (setup?.thrusters ?? []).forEach((name, i) => made.push({id: `u_${name}`, group: 'Thrusters', name: `Thruster ${name.replaceAll('_', ' ')}`,
    unit: '', lines: s => ({value: s.u?.[i]}), least: [-1, 1]}));
  for (const name of Object.keys(state?.nis ?? {})) {
    made.push({id: `nis_${name}`, group: 'Consistency', name: `NIS of ${name}`, unit: '', lines: s => {
      const [value, , low, high] = s.nis?.[name] ?? [];
      return {value, low, high};
    }, expected: true});
  }
  for (const [name, {value}] of Object.entries(state?.sensors ?? {})) {
    const {fields, units} = setup?.readings?.[name] ?? {};
    (value ?? []).forEach((_, i) => made.push({id: `sensor_${name}_${i}`, group: 'Sensors', name: `Sensor ${name}, ${fields?.[i] ?? i + 1}`,
      unit: units?.[i] ?? '', lines: s => ({value: s.sensors?.[name]?.value?.[i]})}));
    made.push({id: `age_${name}`, group: 'Sensors', name: `Sensor ${name}, age`, unit: 's', lines: s => ({value: s.sensors?.[name]?.age})});
  }
  return made;
}

const FIXED = fixed();
export const channels = (setup, state) => [...FIXED, ...own(setup, state)];
export const LINES = ['value', 'reference', 'truth', 'low', 'high'];
export const FIRST = ['z', 'psi', 'u', 'error'];
