/** The list of modes: frequency, note, time of decay, and how loudly each rings now. */

import { lasting } from './words.js';

const NAMES = ['C', 'C♯', 'D', 'D♯', 'E', 'F', 'F♯', 'G', 'G♯', 'A', 'A♯', 'B'];
const RANGE = 60; // dB that the bars show
const HEARD = [20, 20_000]; // Hz

/** Return whether a frequency, Hz, can be heard. */
export function isAudible(frequency) {
  return frequency >= HEARD[0] && frequency <= HEARD[1];
}

/** Return whether a frequency, Hz, is too low to be heard. */
export function isBelow(frequency) {
  return frequency < HEARD[0];
}

/** Return the nearest equal-tempered note (A4 = 440 Hz) with the cents beside it. */
export function note(frequency) {
  const semitones = 69 + 12 * Math.log2(frequency / 440);
  const nearest = Math.round(semitones);
  const cents = Math.round(100 * (semitones - nearest));
  const sign = cents < 0 ? '−' : '+';
  return `${NAMES[((nearest % 12) + 12) % 12]}${Math.floor(nearest / 12) - 1} ${sign}${Math.abs(cents)}`;
}

/** Return how much of a half-sine of some duration, s, a frequency gets, from 0 to 1. */
function pulseShare(frequency, duration) {
  const turns = frequency * duration;
  const gap = 1 - 4 * turns * turns;
  return Math.abs(gap) < 1e-6 ? Math.PI / 4 : Math.abs(Math.cos(Math.PI * turns) / gap);
}

/** How loudly each mode of a body rings, followed from what strikes it. */
export class Ringing {
  constructor(model) {
    this.follow(model);
    this.amplitudes = new Float64Array(model.count);
    this.since = 0;
    this.most = 1e-12;
  }

  /** Go on with a changed model of as many modes. */
  follow(model) {
    this.model = model;
    this.loudness = Float64Array.from({ length: model.count }, (_, n) => Math.hypot(model.outputs[2 * n], model.outputs[2 * n + 1]));
  }

  /** Count a blow. */
  strike(contact, { impulse, duration }, time) {
    this.#decay(time);
    const drive = this.model.drive(contact);
    this.amplitudes.forEach((before, n) => {
      const blow = Math.abs(drive[n]) * this.loudness[n] * impulse * pulseShare(this.model.frequencies[n], duration);
      this.amplitudes[n] = Math.hypot(before, blow);
    });
    this.most = Math.max(...this.amplitudes, 1e-12);
  }

  #decay(time) {
    const passed = time - this.since;
    this.since = time;
    this.amplitudes.forEach((each, n) => { this.amplitudes[n] = each * Math.exp(-this.model.decays[n] * passed); });
  }

  /** Return how far a mode is up, from 0 at `RANGE` below the last blow's loudest to 1. */
  share(mode, time) {
    const now = this.amplitudes[mode] * Math.exp(-this.model.decays[mode] * (time - this.since));
    return Math.max(0, 1 + (20 * Math.log10(now / this.most || 1e-12)) / RANGE);
  }
}

export class ModeList {
  /**
   * @param {HTMLElement} place
   * @param {(mode: number | null) => void} chosen called with the mode that shall be shown
   */
  constructor(place, chosen) {
    this.place = place;
    this.chosen = chosen;
    this.rows = [];
    this.order = []; // modes in the order of the rows
    this.selected = null;
    place.addEventListener('click', (event) => {
      const row = event.target.closest('[role="option"]');
      if (row) this.choose(Number(row.dataset.mode));
    });
    place.addEventListener('keydown', (event) => this.#key(event));
  }

  /**
   * List the modes of a model; the chosen one stays, where there are as many.
   * @param {import('../model/model.js').Model} model
   * @param {number[]} [noise] modes of the original that a fit spends on the noise of the blow,
   *   which come last
   */
  fill(model, noise = []) {
    const head = heading('mode head', ...['', 'Hz', 'note', 'T60', 'level'].map(cell));
    const blow = new Set(noise);
    const every = Array.from({ length: model.count }, (_, n) => n);
    const isNoise = (n) => blow.has(model.modes ? model.modes[n] : n);
    this.order = [...every.filter((n) => !isNoise(n)), ...every.filter(isNoise)];
    const objects = this.order.length - every.filter(isNoise).length;
    this.rows = this.order.map((n, place) => {
      const row = document.createElement('div');
      row.className = place < objects ? 'mode' : 'mode noise';
      row.id = `mode-${n}`;
      row.dataset.mode = n;
      row.setAttribute('role', 'option');
      row.setAttribute('aria-selected', String(n === this.selected));
      const frequency = model.frequencies[n];
      const bar = document.createElement('span');
      bar.className = 'bar';
      bar.append(document.createElement('i'));
      const name = cell(isAudible(frequency) ? note(frequency) : 'inaudible');
      row.append(cell(place + 1), cell(frequency.toFixed(frequency < 1000 ? 1 : 0)), name, cell(lasting(model.decays[n])), bar);
      return row;
    });
    const shown = [head, ...this.rows];
    if (objects < this.order.length) {
      const text = `${this.order.length - objects} of the noise of the blow`;
      shown.splice(1 + objects, 0, heading('mode part', text));
    }
    this.place.replaceChildren(...shown);
    if (!(this.selected < model.count)) this.selected = null;
  }

  /** Return the row of a mode, if there is one. */
  #row(mode) {
    return mode === null ? undefined : this.rows[this.order.indexOf(mode)];
  }

  /** Show how loudly modes ring; return whether any does. */
  tick(ringing, time) {
    const [top, bottom] = [this.place.scrollTop, this.place.scrollTop + this.place.clientHeight];
    const height = this.rows[0]?.offsetHeight || 24;
    const last = Math.min(this.rows.length, Math.ceil(bottom / height) + 1);
    let any = false;
    for (let at = Math.max(0, Math.floor(top / height) - 3); at < last; at += 1) {
      const share = ringing ? ringing.share(this.order[at], time) : 0;
      any ||= share > 0;
      this.rows[at].lastChild.firstChild.style.transform = `scaleX(${share.toFixed(3)})`;
    }
    return any;
  }

  /** Choose a mode; the chosen one once more: none. */
  choose(mode) {
    const next = mode === this.selected ? null : mode;
    this.#row(this.selected)?.setAttribute('aria-selected', 'false');
    this.selected = next;
    const row = this.#row(next);
    row?.setAttribute('aria-selected', 'true');
    if (row) this.#reveal(row);
    if (row) this.place.setAttribute('aria-activedescendant', row.id);
    else this.place.removeAttribute('aria-activedescendant');
    this.chosen(next);
  }

  /** Scroll the list, and it alone, until a row is seen. */
  #reveal(row) {
    const [top, height] = [row.offsetTop, row.offsetHeight];
    const { scrollTop, clientHeight } = this.place;
    if (top < scrollTop + height) this.place.scrollTop = top - height;
    else if (top + height > scrollTop + clientHeight) this.place.scrollTop = top + height - clientHeight;
  }

  /** Choose the next mode. */
  next() {
    const { length } = this.order;
    if (length) this.choose(this.order[(this.order.indexOf(this.selected) + 1) % length]);
  }

  #key(event) {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (step && this.rows.length) {
      const from = this.selected === null ? (step > 0 ? -1 : this.rows.length) : this.order.indexOf(this.selected);
      const to = this.order[Math.min(this.rows.length - 1, Math.max(0, from + step))];
      if (to !== this.selected) this.choose(to);
    } else if ((event.key === 'Escape' || event.key === 'Enter') && this.selected !== null) {
      this.choose(this.selected);
    } else return;
    event.preventDefault();
    event.stopPropagation();
  }
}

function heading(name, ...parts) {
  const row = document.createElement('div');
  row.className = name;
  row.setAttribute('role', 'presentation');
  row.append(...parts);
  return row;
}

function cell(text) {
  const span = document.createElement('span');
  span.textContent = text;
  return span;
}
