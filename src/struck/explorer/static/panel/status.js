/** The one line that screen readers say: which object was chosen, and that it was struck. */

const place = document.getElementById('status');
const TOGETHER = 500; // ms in which a choice and a blow are one sentence
let choice = { text: '', time: -Infinity };

/** Say a sentence; one that was said last is said again. */
export function announce(text) {
  place.textContent = place.textContent === text ? `${text}\u00a0` : text;
}

/** Say which object was chosen: "Bell, 174 modes, bronze". */
export function announceChoice(title, model) {
  const parts = [title, `${model.count} mode${model.count === 1 ? '' : 's'}`];
  if (model.recorded) parts.push('recorded');
  else if (model.material) parts.push(model.material.name);
  choice = { text: parts.join(', '), time: performance.now() };
  announce(choice.text);
}

/** Say that an object was struck, and that it is not heard yet where the sound is `pending`. */
export function announceBlow(title, pending) {
  const name = performance.now() - choice.time < TOGETHER ? choice.text : title;
  announce(`${name}, struck${pending ? '; the sound is getting ready' : ''}`);
}
