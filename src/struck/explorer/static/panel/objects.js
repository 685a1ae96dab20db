/** The list of objects: which are there, which are still being computed, and which rings. */

const list = document.querySelector('#objects ul');
const progress = document.getElementById('progress');
const WORDS = { waiting: 'waits', working: '', ready: '', failed: 'failed' };

export class ObjectList {
  /** @param {(id: string) => void} chosen called with the object that was clicked */
  constructor(chosen) {
    this.chosen = chosen;
    this.buttons = new Map();
    this.told = new Map();
    this.refused = new Set();
  }

  /** Show an object as the server tells of it. */
  tell(told) {
    this.told.set(told.id, told);
    const button = this.buttons.get(told.id) ?? this.#button(told);
    const share = Math.round(100 * told.fraction);
    button.querySelector('.state').textContent = told.state === 'working' ? `${share} %` : WORDS[told.state];
    button.title = told.state === 'failed' ? told.message : told.stage || '';
    button.disabled = told.state !== 'ready';
    button.querySelector('.dot').hidden = told.state !== 'ready';
    this.#progress();
  }

  #button(told) {
    const button = document.createElement('button');
    button.type = 'button';
    const name = document.createElement('span');
    name.textContent = told.title;
    const state = document.createElement('span');
    state.className = 'state';
    const dot = document.createElement('span');
    dot.className = 'dot';
    button.append(name, state, dot);
    button.onclick = () => this.chosen(told.id);
    const item = document.createElement('li');
    item.append(button);
    list.append(item);
    this.buttons.set(told.id, button);
    return button;
  }

  #progress() {
    const all = [...this.told.values()];
    const busy = all.filter(({ state }) => state === 'waiting' || state === 'working');
    progress.hidden = !busy.length;
    const share = all.reduce((sum, { state, fraction }) => sum + (state === 'working' ? fraction : Number(state !== 'waiting')), 0);
    progress.firstElementChild.value = share / all.length;
    const working = busy.filter(({ state }) => state === 'working').map(({ title }) => title.toLowerCase());
    progress.lastElementChild.textContent = `${all.length - busy.length} of ${all.length} are there; computing ${working.join(' and ') || 'soon'}`;
  }

  /** Mark the chosen object. */
  choose(id) {
    for (const [each, button] of this.buttons) button.setAttribute('aria-current', String(each === id));
    this.buttons.get(id)?.scrollIntoView({ block: 'nearest', inline: 'nearest' });
  }

  /** Mark an object as ringing or not. */
  ring(id, rings) {
    this.buttons.get(id)?.classList.toggle('ringing', rings);
  }

  /** Note that an object that is there cannot be shown. */
  refuse(id) {
    this.refused.add(id);
    this.buttons.get(id).disabled = true;
    this.buttons.get(id).querySelector('.state').textContent = WORDS.failed;
    this.buttons.get(id).querySelector('.dot').hidden = true;
  }

  /** Return the objects that can be played or will be, in the order of the list. */
  get playable() {
    return [...this.told.values()].filter(({ id, state }) => state !== 'failed' && !this.refused.has(id));
  }

  /** Return the object that is `step` away from another among those that are there. */
  beside(id, step) {
    const there = this.playable.filter(({ state }) => state === 'ready').map((told) => told.id);
    const at = there.indexOf(id);
    if (!there.length) return null;
    return there[(at < 0 ? (step > 0 ? 0 : there.length - 1) : at + step + there.length) % there.length];
  }
}
