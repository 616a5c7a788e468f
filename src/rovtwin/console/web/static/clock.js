/** Times as people read them: minutes and seconds. */

/** A time or a long duration [s]: 2:05; a dash where there is none. */
export function clock(seconds) {
  if (!Number.isFinite(seconds)) return '–';
  const whole = Math.floor(Math.max(seconds, 0));
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, '0')}`;
}

/** A duration [s]: 12 s below a minute, 2:05 min from there on. */
export function lasting(seconds) {
  return Math.round(seconds) < 60 ? `${Math.round(seconds)} s` : `${clock(Math.round(seconds))} min`;
}
