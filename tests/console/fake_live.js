/** Stands in for the server: `window.emit(message)` to the views, `window.sent` from them, `window.refuse` to reject it, `window.late` to answer late [ms]. */
const heard = {};
const last = {};
window.emit = message => {
  last[message.kind] = message;
  (heard[message.kind] ?? []).forEach(act => act(message));
};
export const live = {
  last,
  on(kind, act) {
    (heard[kind] ??= []).push(act);
    if (last[kind]) act(last[kind]);
    return () => { heard[kind] = heard[kind].filter(other => other !== act); };
  },
  css: name => getComputedStyle(document.body).getPropertyValue(name),
  async send(message) {
    window.sent.push(message);
    if (window.late) await new Promise(done => setTimeout(done, window.late));
    if (window.refuse) throw new Error(window.refuse);
  },
};
export const stop = () => live.send({do: 'stop'});
