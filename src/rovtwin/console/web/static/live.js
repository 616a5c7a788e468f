/** The socket to the console's server: messages by their kind, orders with answers, signs of life, and STOP. */

const handlers = new Map();  // kind -> functions
const waiting = new Map();  // number of an order -> [resolve, reject]
const ALIVE = 200;  // between two signs of life [ms]
const RETRY = 1000;  // until a lost server is looked for again [ms]
const FULL = 1013;  // a server's answer that has too many pages already, or gave this one up
const RETRY_FULL = 5000;  // until it is asked again, and as long again at most: many pages are not to ask at once [ms]
const PATIENCE = 30000;  // for an answer [ms]: a survey takes some time to lay out
const STOPPING = 1000;  // for the answer to STOP [ms]
const EVENTS = 500;  // kept
let socket = null;
let number = 0;

let name = sessionStorage.getItem('rovtwin-name') || `b${Math.random().toString(16).slice(2, 6).padEnd(4, '0')}`;
sessionStorage.setItem('rovtwin-name', name);

export const live = {
  last: {},
  events: [],  // all of them, for who comes late
  name,
  receivedAt: -Infinity,  // when the last state came [performance.now]
  connected: false,
  why: '',  // the server closed the connection, in its words
  hung: false,

  /** Calls `handler` with every message of a kind, and with the last one there was; of events with all. */
  on(kind, handler) {
    if (!handlers.has(kind)) handlers.set(kind, new Set());
    handlers.get(kind).add(handler);
    if (kind === 'event') this.events.forEach(handler);
    else if (kind in this.last) handler(this.last[kind]);
    return () => handlers.get(kind).delete(handler);
  },

  /** Hands a message to who asked for its kind, as if the server had sent it. */
  emit(kind, message) {
    live.last[kind] = message;
    if (kind === 'event') live.events = [...live.events.slice(1 - EVENTS), message];
    for (const handler of handlers.get(kind) || []) handler(message);
  },

  /** Gives an order; resolves with the answer, rejects with an Error whose message is for people; waits so long for it [ms]. */
  send(order, patience = PATIENCE) {
    if (socket?.readyState !== WebSocket.OPEN) return Promise.reject(new Error('the console is not connected'));
    number += 1;
    const id = number;
    return new Promise((resolve, reject) => {
      waiting.set(id, [resolve, reject]);
      setTimeout(() => settle({id, ok: false, error: 'the console does not answer'}), patience);
      socket.send(JSON.stringify({...order, id, pulse: live.last.pulse?.at}));
    });
  },

  /** An order that nobody waits for, as sticks are. */
  tell(order) {
    if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({...order, pulse: live.last.pulse?.at}));
  },

  css(variable) { return getComputedStyle(document.body).getPropertyValue(variable); },
};

function settle(answer) {
  const [resolve, reject] = waiting.get(answer.id) || [];
  waiting.delete(answer.id);
  if (!resolve) return;
  if (answer.ok) resolve(answer);
  else reject(new Error(answer.error));
}

function take(message) {
  if (message.kind === 'reply') settle(message);
  else if (message.kind === 'history') {
    if (!live.last.history) message.events.forEach(event => live.emit('event', event));
    live.last.history = message;
  } else {
    if (message.kind === 'state') {
      live.receivedAt = performance.now();
      const sight = live.last.sight;
      if (sight) Object.assign(message, {markers: sight.markers, picture: sight.picture});
    }
    if (message.kind === 'pulse') live.hung = message.hung;
    if (message.kind === 'rights' && message.you !== name) {  // another page lives under the name that this one brought
      name = live.name = message.you;
      sessionStorage.setItem('rovtwin-name', name);
    }
    live.emit(message.kind, message);
  }
}

function connect() {
  const address = new URL(path, location.href.replace(/^http/, 'ws'));
  address.searchParams.set('name', name);
  socket = new WebSocket(address);
  socket.onopen = () => { live.connected = true; live.emit('connection', {connected: true}); };
  socket.onmessage = event => take(JSON.parse(event.data));
  socket.onclose = event => {
    live.connected = false;
    live.why = event.reason;
    [...waiting.keys()].forEach(id => settle({id, ok: false, error: 'the connection was lost'}));
    live.emit('connection', {connected: false});
    setTimeout(connect, event.code === FULL ? RETRY_FULL * (1 + Math.random()) : RETRY);
  };
}

/**
 * Thrusters off: over the socket and, should that hang, over a request of its own. Resolves once either says that they
 * are, rejects with an Error for people where neither does in time.
 */
export function stop() {
  const path = fetch('/stop', {method: 'POST', keepalive: true}).then(answer => answer.json()).then(found => {
    if (!found.ok) throw new Error(found.error);
    return found;
  });
  const late = new Promise((_, reject) => {
    setTimeout(() => reject(new Error('the console does not answer')), STOPPING);
  });
  const confirmed = Promise.any([live.send({do: 'stop'}), path]).catch(error => { throw error.errors[0]; });
  return Promise.race([confirmed, late]);
}

// A page that shows something else than the flight, a replay, names its source; one that shows nothing has none.
const path = document.querySelector('meta[name=rovtwin-live]')?.content ?? '/live';
setInterval(() => live.tell({do: 'alive'}), ALIVE);
if (path) connect();
window.rovtwin = live;
