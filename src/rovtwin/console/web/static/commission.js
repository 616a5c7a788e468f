/** The view Commission: what to do next, the checklist, the stage that is being done, the page of a stage. */
import {make, mount} from '/static/canvas.js';
import {clock} from '/static/clock.js';
import {LONG, formOf, listOf} from '/static/commission_list.js';
import {LEVEL, chip, lineOf, pageOf} from '/static/commission_page.js';
import {cardOf} from '/static/commission_question.js';
import {live} from '/static/live.js';
import {showReply} from '/static/page.js';

const order = (op, more = {}) => showReply(live.send({do: 'commission', op, ...more}, LONG));
const SILENT = 3000; // without a pulse of the console, twice a second, something is wrong [ms]
const nameOf = () => new URLSearchParams(location.search).get('name');
const NOTHING = {now: null, question: null, progress: {what: '', share: null, since: 0, began: 0}, lines: [], ended: null, held: false, revision: 0};

/** The whole view; `data` is the checklist, null before it has come or where none was chosen. */
class View {
  constructor(section) {
    this.name = nameOf();
    this.data = null;
    this.error = '';
    this.chosen = null; // a stage that a hand chose
    this.message = NOTHING;
    this.receivedAt = null; // when the console's pulse came [performance.now]
    this.starting = null; // title of a stage that was ordered and does not run yet
    this.asked = 0; // revision of the checklist that was asked for
    this.had = null; // and of the one that is shown
    this.head = make('div', {class: 'commission-head'});
    this.next = make('p', {class: 'commission-next', role: 'status', id: 'commission-next'});
    this.actions = make('div', {class: 'line commission-actions'});
    this.now = make('div', {class: 'commission-now', id: 'commission-now'});
    this.list = make('ol', {class: 'commission-list', 'aria-label': 'Stages'});
    this.page = make('article', {class: 'commission-page', 'aria-label': 'Page of the stage'});
    this.body = make('div', {class: 'commission-body'}, this.list, make('div', {class: 'commission-main'}, this.now, this.page));
    section.append(make('div', {class: 'commission-top'}, this.head, this.next, this.actions), this.body);
    this.#showHead();
    if (this.name) this.read();
    else this.#choice();
  }

  async read() {
    this.asked = this.message.revision;
    try {
      const found = await (await fetch(`/commission/checklist?name=${encodeURIComponent(this.name)}`)).json();
      [this.data, this.error] = found.error ? [this.data, found.error] : [found, ''];
    } catch {
      this.error = 'The console does not answer.';
    }
    this.had = this.asked;
    this.show();
    if (this.asked !== this.message.revision) this.read();
  }

  take(message) {
    const asked = this.message.question?.id;
    const doing = this.message.now?.name;
    const anew = message.revision !== this.message.revision;
    this.message = message;
    if (message.now?.name !== doing && message.now?.folder === this.name) this.chosen = message.now?.name ?? this.chosen;
    if (!message.now && message.ended?.folder === this.name && doing) this.chosen = message.ended.stage;
    if (anew && this.name && this.asked !== message.revision) this.read();
    this.show();
    document.title = message.question ? '● a question – rovtwin commission' : 'rovtwin commission';
    if (message.question && message.question.id !== asked) this.#call();
  }

  /** Brings a new question before the eyes, and before a screen reader. */
  #call() {
    const card = this.now.querySelector('.commission-question');
    card?.scrollIntoView({block: 'center'});
    card?.focus({preventScroll: true});
  }

  progress({what, share, since, began}) {
    this.message.progress = {what, share, since, began};
    const bar = this.now.querySelector('progress');
    if (!bar) return;
    if (share === null) bar.removeAttribute('value');
    else bar.value = share;
    this.now.querySelector('.commission-what').textContent = what;
    this.showTime();
  }

  /** For how long what is done now goes on, and the stage: nothing else moves while a share is not known. */
  showTime() {
    const {since, began} = this.message.progress;
    const time = this.now.querySelector('.commission-time');
    const at = live.last.pulse?.at; // the server's clock: a page that comes late knows as much as the others
    if (time) time.textContent = since - began < 1 ? clock(at - since) : `${clock(at - since)} (${clock(at - began)} in all)`;
  }

  show() {
    this.#showNext();
    this.#showNow();
    this.showTime();
    this.#showList();
    this.#showPage();
  }

  #showHead() {
    const all = this.name ? [make('a', {class: 'action', href: '/commission'}, 'All commissionings')] : [];
    this.head.replaceChildren(make('a', {class: 'action', href: '/'}, '‹ Console'), ...all,
      make('strong', {class: 'commission-name'}, this.name ?? 'Commissioning'));
  }

  /** Whether the checklist is that of before: what is due then may be done by now. */
  get isOld() { return this.data !== null && this.had !== this.message.revision; }

  /** In one sentence. */
  #sentence() {
    const {now, question} = this.message;
    const title = now?.folder === this.name ? now?.title : `${now?.title} of ${now?.folder}`;
    const silent = this.receivedAt === null ? 0 : performance.now() - this.receivedAt;
    if (silent > SILENT) return `No news from the console for ${Math.round(silent / 1e3)} s: look after the network, and after the vehicle.`;
    if (now?.ending) return `${title} is being ended: what it has measured is kept. Wait.`;
    if (question?.kind === 'number' && live.last.rights?.may) return `${title} asks for a figure: type it and send it.`;
    if (question && live.last.rights?.may) return `${title} asks: read it, look at the vehicle, then answer.`;
    if (question) return `${title} asks: whoever is in control answers.`;
    if (now?.phase === 'turning') return `${title}: thrusters may turn. Watch the vehicle; STOP or Esc ends it at once.`;
    if (now?.moves) return `${title} is being computed: thrusters stay off until it has asked. Wait.`;
    if (now) return `${title} is being done: thrusters stay off. Wait.`;
    if (this.starting) return `${this.starting} is being started: wait.`;
    if (!this.name) return 'Begin a commissioning, or open one to go on where it was left.';
    if (this.error) return this.error;
    if (this.isOld) return 'Reading what came of it: wait.';
    return this.data?.next ?? 'Reading the checklist: half a minute the first time.';
  }

  #showNext() {
    const sentence = this.#sentence();
    if (this.next.textContent !== sentence) this.next.textContent = sentence;
    const {now, held} = this.message;
    const may = Boolean(live.last.rights?.may) && !this.starting;
    const due = this.isOld ? null : this.data?.stages.find(stage => stage.name === this.data.due);
    const button = (words, id, act, more = '') => make('button', {class: `action ${more}`, type: 'button', id, disabled: !may || now?.ending, onclick: act}, words);
    const key = JSON.stringify([now?.name, now?.ending, held, may, due?.name, due?.state]);
    if (this.actions.dataset.key === key) return; // or a click would miss a button that is made anew
    this.actions.dataset.key = key;
    this.actions.replaceChildren(
      ...(now ? [button(`End ${now.title}`, 'commission-end', () => order('end'), 'commission-end')] : []),
      ...(due && !now ? [button(`Start ${due.title}`, 'commission-start', () => this.start(due), 'commission-start')] : []),
      ...(held && !now ? [button('Give the vehicle back to the console', 'commission-back', () => order('give_back'))] : []),
      ...(live.last.rights?.may ? [] : [make('span', {class: 'muted'}, 'You are watching; take control above to go on.')]));
  }

  /** Once a second: what changes without a message. */
  tick() {
    this.showTime();
    this.#showNext();
  }

  async start(stage) {
    this.starting = stage.title;
    this.show();
    await order('start', {folder: this.name, stage: stage.name});
    this.starting = null;
    this.show();
  }

  #showNow() {
    const {now, question, progress, ended} = this.message;
    const heading = this.data?.stages.find(one => one.name === now?.name);
    // The terminal needs number, title and purpose; here they stand on the page of the stage.
    const lines = this.message.lines.filter(line => !heading || line !== `${heading.number}. ${heading.title}: ${heading.purpose}`);
    const key = JSON.stringify([now, question?.id, lines, ended, live.last.rights?.may, this.#chosenName(), this.data?.folder, this.starting]);
    if (this.now.dataset.key === key) return;
    this.now.dataset.key = key;
    const parts = [];
    if (question) parts.push(cardOf(question, now));
    if (now && !question) parts.push(make('div', {class: 'commission-progress'},
      make('progress', {max: 1, 'aria-label': `Progress of ${now.title}`, ...(progress.share === null ? {} : {value: progress.share})}),
      make('span', {class: 'commission-what'}, progress.what), make('span', {class: 'commission-time muted', role: 'timer'})));
    if (!now && this.starting) parts.push(make('div', {class: 'commission-progress'},
      make('progress', {'aria-label': `Start of ${this.starting}`}), make('span', {class: 'commission-what'}, 'reading what was done before')));
    else if (!now && ended?.folder === this.name && ended.stage === this.#chosenName()) parts.push(make('p', {class: 'commission-ended', 'data-level': LEVEL[ended.how === 'go' ? 'go' : 'no-go'], role: 'status'}, ended.text));
    if (now && lines.length) parts.push(make('ul', {class: 'commission-lines', role: 'log', 'aria-label': 'What the stage says'},
      ...lines.map(line => lineOf(now.folder, now.folder === this.name ? this.data?.folder : '', line))));
    this.now.replaceChildren(...parts);
    const log = this.now.querySelector('.commission-lines');
    if (log) log.scrollTop = log.scrollHeight;
  }

  choose(name) {
    this.chosen = name;
    this.show();
    if (matchMedia('(max-width: 900px)').matches) this.page.scrollIntoView({block: 'start'}); // above the list there
  }

  #chosenName() { return this.chosen ?? this.#recent(); }

  /** What is due, or what was done last where that says why it is no-go. */
  #recent() { return this.data?.due ?? this.data?.stages.at(-1)?.name; }

  #showList() {
    if (!this.data) return;
    const {now} = this.message;
    const key = JSON.stringify([this.data.stages.map(one => [one.state, one.attempts.length]), now, this.#chosenName(), this.data.due]);
    if (this.list.dataset.key === key) return;
    this.list.dataset.key = key;
    const focused = this.list.contains(document.activeElement) ? document.activeElement.id : null;
    this.list.replaceChildren(...this.data.stages.map(stage => this.#row(stage, now)));
    if (focused) document.getElementById(focused)?.focus();
  }

  #row(stage, now) {
    const doing = now?.name === stage.name && now.folder === this.name;
    const seconds = stage.attempts.at(-1)?.seconds;
    const tried = stage.attempts.length > 1 ? `${stage.attempts.length} attempts` : '';
    const facts = [seconds ? `${Math.round(seconds)} s` : '', tried].filter(Boolean).join(', ');
    return make('li', {}, make('button', {type: 'button', id: `stage-${stage.name}`, class: 'commission-stage', title: stage.purpose,
      'aria-pressed': String(this.#chosenName() === stage.name), onclick: () => this.choose(stage.name)},
    make('span', {class: 'commission-number'}, String(stage.number)),
    make('span', {class: 'commission-title'}, stage.title, make('span', {class: 'muted'}, stage.purpose)),
    make('span', {class: 'commission-state'}, chip(doing ? 'now' : stage.state), make('span', {class: 'muted'}, facts))));
  }

  #showPage() {
    const stage = this.data?.stages.find(one => one.name === this.#chosenName());
    if (!stage) return;
    const may = Boolean(live.last.rights?.may) && !this.message.now && !this.starting && !this.isOld;
    const {now} = this.message;
    const doing = now?.name === stage.name && now.folder === this.name ? now : null;
    const key = JSON.stringify([stage, may, doing]);
    if (this.page.dataset.key === key) return;
    this.page.dataset.key = key;
    const words = stage.attempts.length ? `Do ${stage.title} again` : '';
    const again = words && stage.name !== this.data.due ? [make('button', {class: 'action', type: 'button', disabled: !may,
      onclick: () => this.start(stage)}, words)] : [];
    const open = this.page.querySelector('#commission-asked')?.open;
    const other = `${stage.name} ${stage.attempts.length} ${Boolean(doing)}`;
    if (this.page.dataset.shown !== other) this.page.parentElement.scrollTop = 0; // its verdict stands on top
    this.page.dataset.shown = other;
    const form = make('details', {id: 'commission-asked'}, make('summary', {}, 'What is asked for'),
      formOf(this.data.request, this.name, () => this.read()));
    form.open = Boolean(open);
    this.page.replaceChildren(...pageOf(this.name, stage, again, doing), form);
  }

  /** Those there are, and the form that begins one. */
  async #choice() {
    this.show();
    this.body.classList.add('choosing');
    const say = make('p', {class: 'muted'}, 'looking for commissionings');
    this.page.replaceChildren(say);
    try {
      const {folder, found, defaults} = await (await fetch('/commission/list')).json();
      const tank = [...(defaults.sides ?? []), defaults.depth].filter(Boolean);
      const asked = {...defaults, tank: tank.length === 3 ? tank.join('x') : ''};
      const done = name => location.assign(`/commission?name=${encodeURIComponent(name)}`);
      say.textContent = `In ${folder}`;
      this.page.replaceChildren(
        ...(found.length ? [make('section', {'aria-label': 'Commissionings there are'}, make('h2', {}, 'Go on with one'), say, listOf(found))] : []),
        make('section', {'aria-label': 'A new commissioning'}, make('h2', {}, 'Begin one'), formOf(asked, null, done)));
    } catch {
      say.textContent = 'The console does not answer.';
    }
  }
}

mount('commission', section => {
  const view = new View(section);
  const leave = event => { if (view.message.now?.phase === 'turning' && live.last.rights?.may) event.preventDefault(); };
  addEventListener('beforeunload', leave); // closing the page ends what moves
  const release = [
    live.on('commission', message => view.take(message)),
    live.on('commission_progress', message => view.progress(message)),
    live.on('rights', () => view.show()),
    live.on('pulse', () => { view.receivedAt = performance.now(); }),
  ];
  const timer = setInterval(() => view.tick(), 1000);
  return () => { clearInterval(timer); release.forEach(one => one()); removeEventListener('beforeunload', leave); };
});
