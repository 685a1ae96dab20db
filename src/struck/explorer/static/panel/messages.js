/** Sentences for the person: what went wrong and the way out, shown until they are closed. */

const place = document.getElementById('messages');
const shown = new Map();

/**
 * Show a sentence; one that is shown already, under whatever id, is not shown twice.
 * @param {string} text
 * @param {{bad?: boolean, id?: string}} [options] `id`: a later message of that id takes its place
 */
export function say(text, { bad = false, id = text } = {}) {
  if (shown.get(id)?.dataset.text === text) return;
  unsay(id);
  if ([...shown.values()].some((each) => each.dataset.text === text)) return;
  const message = document.createElement('div');
  message.className = bad ? 'message bad' : 'message';
  message.setAttribute('role', bad ? 'alert' : 'status');
  message.dataset.text = text;
  const words = document.createElement('span');
  const sentence = /[.!?]$/.test(text) ? text : `${text}.`;
  words.textContent = sentence[0].toUpperCase() + sentence.slice(1);
  const close = document.createElement('button');
  close.type = 'button';
  close.textContent = 'Close';
  close.onclick = () => unsay(id);
  message.append(words, close);
  place.append(message);
  shown.set(id, message);
}

/** Take a sentence away, by its id or its text. */
export function unsay(id) {
  shown.get(id)?.remove();
  shown.delete(id);
}
