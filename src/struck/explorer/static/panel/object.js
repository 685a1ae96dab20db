/** The chosen object: what it is, and its material, size and damping to be changed while it rings. */

import { isAudible, isBelow } from './modes.js';
import { hertz, length, times, weight } from './words.js';

const PAUSE = 40; // ms between two questions to the server while a slider moves
const get = (id) => document.getElementById(id);

const fields = {
  panel: get('object'), title: get('object-title'), text: get('object-text'), facts: get('object-facts'), notes: get('object-notes'), dropped: get('object-dropped'),
  changes: get('changes'), material: get('material'), size: get('size'), damping: get('damping'), original: get('original'),
};

const THRESHOLD = 2e-5; // Pa, of hearing

/** Say that none of these frequencies, ascending, can be heard, and where they lie. */
function silence(frequencies) {
  const [lowest, highest] = [frequencies[0], frequencies.at(-1)];
  if (lowest === undefined) return 'It has no mode that can be heard';
  if (lowest === highest) return `Its only mode cannot be heard: it lies at ${hertz(lowest)}`;
  const where = isBelow(highest) ? `the highest lies at ${hertz(highest)}` : `the lowest lies at ${hertz(lowest)}`;
  return `None of its ${frequencies.length} modes can be heard: ${where}`;
}

/** Return sentences about what is heard of an object otherwise than one would think. */
function notesOf(facts, model) {
  const notes = [];
  if (facts.averaged) notes.push('Its computed timbre field is played as its average over all directions; struck render and struck play play the field itself.');
  const audible = [...model.frequencies].some(isAudible);
  if (!audible) {
    notes.push(`${silence(model.frequencies)}. A blow ${model.recoil ? 'is heard by its recoil alone, as a short click' : 'makes no sound that can be heard'}.`);
  } else if (facts.calibrated && facts.peak < THRESHOLD) {
    notes.push('A blow on it is too soft to be heard at 1 m; here it is made louder.');
  }
  return notes;
}

export class ObjectPanel {
  /**
   * @param {Record<string, string>} materials groups by name
   * @param {(id: string, wanted: object | null) => Promise<boolean | null>} change carries a change
   *   out; returns whether that is all of it, else it is to be asked for without "quick"; null
   *   where the change was refused
   */
  constructor(materials, change) {
    this.change = change;
    this.wishes = new Map(); // by object
    this.done = new Map(); // by object: the last wish that came true
    const names = Object.keys(materials).sort((a, b) => materials[a].localeCompare(materials[b]) || a.localeCompare(b));
    for (const group of new Set(names.map((name) => materials[name]))) {
      const part = document.createElement('optgroup');
      part.label = group;
      part.append(...names.filter((name) => materials[name] === group).map((name) => new Option(name, name)));
      fields.material.append(part);
    }
    for (const field of [fields.material, fields.size, fields.damping]) field.addEventListener('input', () => this.#wish());
    fields.original.onclick = () => {
      this.wishes.delete(this.told.id);
      this.#show();
      this.#wish();
    };
  }

  /** Show an object with its model. */
  fill(told, model) {
    this.told = told;
    fields.panel.hidden = false;
    fields.title.textContent = told.title;
    fields.text.textContent = told.text;
    const own = told.facts.material?.name;
    // A material of one's own stays in the list, under its name.
    fields.material.querySelector('[data-own]')?.remove();
    if (own && ![...fields.material.options].some(({ value }) => value === own)) {
      const option = new Option(`${own} (its own)`, own);
      option.dataset.own = '';
      fields.material.prepend(option);
    }
    fields.material.disabled = !own;
    this.#show();
    this.tell(model);
  }

  /** Tell figures of the model as it is now. */
  tell(model) {
    const { size, complete_to: complete, calibrated } = this.told.facts;
    const factor = this.#wishOf().size;
    const parts = [`${model.count} mode${model.count === 1 ? '' : 's'}`];
    const { noise } = this.told.facts;
    if (noise.length) parts.push(`${noise.length} of them of the noise of the blow`);
    const dropped = model.metadata.provenance?.dropped ?? [];
    fields.dropped.hidden = !dropped.length;
    fields.dropped.textContent = `Left out: ${dropped.join('; ')}.`;
    if (complete && model.count) parts.push(`none missing up to ${((complete * model.frequencies[0]) / this.told.lowest / 1000).toFixed(1)} kHz`);
    if (size) parts.push(`${length(Math.max(...size) * factor)} long`);
    if (model.mass) parts.push(weight(model.mass));
    if (!calibrated) parts.push('level relative');
    fields.facts.textContent = parts.join(' · ');
    const notes = notesOf(this.told.facts, model);
    fields.notes.hidden = !notes.length;
    fields.notes.textContent = notes.join(' ');
  }

  #wishOf() {
    return this.wishes.get(this.told.id) ?? { material: this.told.facts.material?.name, size: 1, damping: 1 };
  }

  #show() {
    const { material, size, damping } = this.#wishOf();
    fields.material.value = material ?? '';
    fields.size.value = Math.log10(size);
    fields.damping.value = Math.log10(damping);
    this.#words();
  }

  #words() {
    const { size, damping } = this.#wishOf();
    get('size-shown').textContent = times(size);
    get('damping-shown').textContent = times(damping);
    for (const [field, value] of [[fields.size, size], [fields.damping, damping]]) field.setAttribute('aria-valuetext', times(value));
    fields.original.hidden = !this.wishes.has(this.told.id);
  }

  #wish() {
    const round = (field) => (Math.abs(field.value) < 0.015 ? 1 : 10 ** Number(field.value));
    const wish = { material: fields.material.value || undefined, size: round(fields.size), damping: round(fields.damping) };
    const own = this.told.facts.material?.name;
    if (wish.material === own && wish.size === 1 && wish.damping === 1) this.wishes.delete(this.told.id);
    else this.wishes.set(this.told.id, wish);
    this.#words();
    this.#ask(this.told.id);
  }

  /** Ask for what is wished now; while an answer is waited for, only the last wish counts. */
  async #ask(id) {
    this.asked = id;
    if (this.asking) {
      this.again = true;
      return;
    }
    this.asking = true;
    let quick = true;
    let settled = false;
    do {
      this.again = false;
      // At once as far as may be, and the rest when nothing else is wished meanwhile.
      const now = this.asked;
      const wish = this.wishes.get(now) ?? null;
      settled = await this.change(now, wish && { ...wish, quick });
      if (settled === null) this.#revert(now);
      else this.done.set(now, wish);
      quick = this.again;
      if (quick) await new Promise((done) => setTimeout(done, PAUSE));
    } while (quick || settled === false);
    this.asking = false;
  }

  /** Show what an object is still like, unless something else is wished by now. */
  #revert(id) {
    if (this.again) return;
    const wish = this.done.get(id);
    if (wish) this.wishes.set(id, wish);
    else this.wishes.delete(id);
    if (this.told.id === id) this.#show();
  }
}
