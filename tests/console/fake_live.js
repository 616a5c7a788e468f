/** Stands in for the server: `window.emit(message)` to the views, `window.sent` from them, `window.refuse` to reject it, `window.late` to answer late [ms]. */
const handlers = {};
const last = {};
window.emit = message => {
  last[message.kind] = message;
  (handlers[message.kind] ?? []).forEach(act => act(message));
};
export const live = {
  last,
  on(kind, act) {
    (handlers[kind] ??= []).push(act);
    if (last[kind]) act(last[kind]);
    return () => { handlers[kind] = handlers[kind].filter(other => other !== act); };
  },
  css: name => getComputedStyle(document.body).getPropertyValue(name),
  async send(message) {
    window.sent.push(message);
    if (window.late) await new Promise(done => setTimeout(done, window.late));
    if (window.refuse) throw new Error(window.refuse);
    return {ok: true};
  },
};
export const stop = () => live.send({do: 'stop'});
