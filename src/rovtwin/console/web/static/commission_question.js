/** The question that a stage asks: nothing but a click on this card, made after it appeared, answers it. */
import {make} from '/static/canvas.js';
import {live} from '/static/live.js';
import {showReply} from '/static/page.js';

const READ = 800;  // for which the buttons of a new question take no click: that was meant for something else [ms]

function answer(question, value, card) {
  card.querySelectorAll('button, input').forEach(one => { one.disabled = true; });
  return showReply(live.send({do: 'commission', op: 'answer', question: question.id, value})).then(taken => {
    if (!taken && card.isConnected) able(card);
  });
}

function able(card) {
  const may = Boolean(live.last.rights?.may);
  card.querySelectorAll('button, input').forEach(one => { one.disabled = !may; });
}

/** The card of a question; in the phase `asking` thrusters may turn after a yes. */
export function cardOf(question, {title, phase}) {
  const rights = live.last.rights;
  const card = make('div', {class: 'commission-question', role: 'alertdialog', tabindex: '-1', 'aria-label': `${title} asks`});
  const ask = make('p', {class: 'commission-ask'}, question.text.replace(/\s*\?*$/, '?'));
  card.append(make('p', {class: 'muted'}, `${title} asks`), ask);
  if (question.kind === 'confirm') {
    const button = (word, value) => make('button', {class: `action commission-${word.toLowerCase()}`, type: 'button', disabled: true,
      onclick: () => answer(question, value, card)}, word);
    card.append(make('div', {class: 'commission-answers'}, button('Yes', true), button('No', false)));
    if (phase === 'asking') card.append(make('p', {class: 'muted'}, 'Thrusters may turn after a yes. STOP or Esc ends it at once.'));
  } else {
    const input = make('input', {type: 'number', step: 'any', required: true, disabled: true, inputmode: 'decimal', id: 'commission-figure',
      'aria-label': `${question.text} [${question.unit}]`});
    const send = event => {
      event.preventDefault();
      if (Number.isFinite(input.valueAsNumber)) answer(question, input.valueAsNumber, card);
    };
    card.append(make('form', {class: 'commission-answers', onsubmit: send}, make('span', {class: 'commission-figure'}, input, ` ${question.unit}`),
      make('button', {class: 'action commission-yes', type: 'submit', disabled: true}, 'Send'),
      make('button', {class: 'action', type: 'button', disabled: true, onclick: () => answer(question, null, card)}, 'Not to be had')),
    make('p', {class: 'muted'}, 'Without the figure the stage goes on, and its page says what is lost.'));
  }
  if (!rights?.may) card.append(make('p', {class: 'muted'}, rights?.in_control
    ? `${rights.in_control} is in control, and answers.` : 'Nobody is in control: take control above to answer.'));
  setTimeout(() => able(card), READ);
  return card;
}
