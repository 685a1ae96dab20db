/** The page: it brings together the room, the instrument and the panels. */

import { FormatError, readModel } from './model/model.js';
import { fetchChange, fetchDrive, fetchModel, fetchRoom, follow } from './connection.js';
import { say, unsay } from './panel/messages.js';
import { ModeList, Ringing } from './panel/modes.js';
import { ObjectList } from './panel/objects.js';
import { ObjectPanel } from './panel/object.js';
import { Spectrum } from './panel/spectrum.js';
import { announceBlow, announceChoice } from './panel/status.js';
import { Instrument } from './room/instrument.js';
import { Room } from './room/room.js';

const STRIKERS = ['fingertip', 'felt', 'wood', 'steel'];
const PATIENCE = 1500; // ms after which what is silent stays so
const CYCLE = 1.4; // s of one swing of a mode that is shown
const CLICK = matchMedia('(pointer: coarse)').matches ? 'Tap' : 'Click';
const get = (id) => document.getElementById(id);

/** What the page holds: read by tests, and by who is curious. */
const page = { models: new Map(), ringing: new Map(), last: new Map(), chosen: null, striker: 'wood', speed: 1, blows: 0 };
globalThis.struck = page;

/** Say what an error says, and what comes of it. */
function complain(error, what) {
  if (!(error instanceof Error)) throw error;
  if (error.id) say(error.message, { bad: true, id: error.id });
  else say(what ? `${what}: ${error.message}` : error.message, { bad: true });
}

const heads = await fetchRoom().catch((error) => complain(error));
const room = new Room(get('canvas'), get('labels'), { strike, hold, release });
const instrument = new Instrument(heads.strikers, (text, id) => (text === null ? unsay(id) : say(text, { bad: true, id })));
const objects = new ObjectList((id) => {
  choose(id);
  room.approach(id);
  get('whole').hidden = false;
});
const panel = new ObjectPanel(heads.materials, change);
const modes = new ModeList(get('modes'), showMode);
const spectrum = new Spectrum(get('spectrum'));
Object.assign(page, { room, instrument, strikeAt, choose });

// Objects, as they arrive

/** Show an object as the server tells of it, and read its model once that is there. */
async function tell(told) {
  objects.tell(told);
  showProgress();
  if (told.state === 'failed') {
    tellFailures();
    chooseFirst();
  }
  if (told.state !== 'ready' || page.models.has(told.id)) return;
  page.models.set(told.id, null);
  try {
    const model = await readModel(await fetchModel(told.id));
    if (!model.outputs) throw new FormatError('it is a recorded timbre field, which the page does not play yet: struck render and struck play do');
    told.lowest = model.frequencies[0];
    room.add(told, model);
    page.models.set(told.id, model);
    page.ringing.set(told.id, new Ringing(model));
    instrument.add(told, model);
    page.sounding ??= performance.now();
  } catch (error) {
    page.models.delete(told.id);
    if (error instanceof FormatError) objects.refuse(told.id);
    complain(error, error instanceof FormatError ? `${told.title} cannot be read` : told.title);
  }
  showProgress();
  chooseFirst();
}

/** Say which objects could not be computed: in one message, however many they are. */
function tellFailures() {
  const reasons = new Map();
  for (const { state, title, message } of objects.told.values()) {
    if (state === 'failed') reasons.set(message, [...(reasons.get(message) ?? []), title]);
  }
  const parts = [...reasons].map(([reason, titles]) => `${titles.join(', ')} could not be computed: ${reason}`);
  say(parts.join('. '), { bad: true, id: 'failed' });
}

/** Choose the first object of the list, unless one was chosen: none is there before it. */
function chooseFirst() {
  const [first] = objects.playable;
  if (page.chosen === null && first) choose(first.id);
}

/** Return the chosen object, or the first one that is there. */
function current() {
  return page.chosen ?? objects.playable.find(({ id }) => page.models.get(id))?.id ?? null;
}

/** Say in the empty room what it waits for. */
function showProgress() {
  const there = [...page.models.values()].some(Boolean);
  const waiting = objects.playable.length;
  get('empty').hidden = there || !waiting;
  if (!there && waiting) {
    const [first] = objects.playable;
    get('empty').firstElementChild.textContent = first.kind === 'file'
      ? `${first.title} is being read, and appears here in a moment.`
      : `${waiting === 1 ? 'One object is' : `${waiting} objects are`} being computed, to appear here one by one. The first is the ${first.title.toLowerCase()}, in some seconds.`;
  }
  hint();
}

/** Choose an object: what is told, changed, and struck by keys. */
function choose(id) {
  if (!page.models.get(id)) return;
  if (page.chosen !== id) {
    room.showMode(page.chosen, null);
    modes.selected = null;
    get('mode-shown').textContent = 'Choose a mode to see the body move in it.';
  }
  const model = instrument.model(id) ?? page.models.get(id);
  const told = objects.told.get(id);
  if (page.chosen !== id) announceChoice(told.title, model);
  page.chosen = id;
  objects.choose(id);
  panel.fill(told, model);
  modes.fill(model, told.facts.noise);
  spectrum.mark([...model.frequencies].slice(0, 200));
  room.number(id, told.facts.points);
  wake();
}

/** Show a mode of the chosen object, or none. */
function showMode(mode) {
  const model = instrument.model(page.chosen) ?? page.models.get(page.chosen);
  const [words, frequency] = [get('mode-shown'), mode === null ? null : model.frequencies[mode]];
  spectrum.mark([...model.frequencies].slice(0, 200), frequency);
  if (mode === null) words.textContent = 'Choose a mode to see the body move in it.';
  else if (!model.shapes) words.textContent = 'A recording tells where this mode lies, not how the body moves in it.';
  else {
    const slow = Math.round(frequency * CYCLE);
    const number = modes.order.indexOf(mode) + 1;
    words.textContent = room.still ? `Mode ${number} at its farthest.` : `Mode ${number}, ${slow} times slowed down.`;
  }
  room.showMode(page.chosen, model.shapes && mode !== null ? { mode, shape: model.modeShape(mode), cycle: CYCLE } : null);
}

// Striking and damping

/** Strike an object where a ray has met it. */
function strike({ id, face, point }, pressure) {
  choose(id);
  strikeAt(id, { point: scaled(id, point), face }, pressure === null ? page.speed : page.speed * (0.3 + 1.4 * pressure));
}

/** Strike an object at a place of its own coordinates, m. */
function strikeAt(id, where, speed = page.speed) {
  try {
    const contact = instrument.model(id).contact(where);
    const how = { striker: page.striker, speed };
    if (page.models.get(id).exact) land(id, contact, how);
    else askDrive(id, contact).then((drive) => land(id, contact, { ...how, drive })).catch((error) => complain(error));
  } catch (error) {
    complain(error);
  }
}

/** Return what the server makes of a contact where the page's mesh is too coarse; else nothing. */
async function askDrive(id, { point, direction }) {
  const original = point.map((value) => value / sizeOf(id));
  try {
    const drive = await fetchDrive(id, { point: original, direction });
    if (drive.length !== page.models.get(id).count) throw new RangeError('it tells of other modes');
    unsay('drive');
    return drive;
  } catch {
    const { title } = objects.told.get(id);
    const fine = page.models.get(id).exactTo;
    say(`the server does not tell in time how a blow drives ${title}: above ${Math.round(fine)} Hz this one is approximate. Strike again for another try`, { bad: true, id: 'drive' });
    return undefined;
  }
}

/** Let a blow sound, and show where it fell. */
function land(id, contact, how) {
  const blow = instrument.strike(id, contact, how);
  Object.assign(page, { blow, contact, drive: how.drive, struck: id, blows: page.blows + 1 });
  page.last.set(id, contact);
  announceBlow(objects.told.get(id).title, instrument.pending);
  if (blow && page.ringing.get(id)) page.ringing.get(id).strike(contact, blow, performance.now() / 1000);
  room.mark(id, contact.point.map((value) => value / sizeOf(id)));
  wake();
}

/** Return how many times larger than computed an object is: also where no picture shows it. */
function sizeOf(id) {
  return instrument.model(id).size ?? 1;
}

/** Return a point of the body as computed in the coordinates of the body as it is now. */
function scaled(id, point) {
  return point.map((value) => value * sizeOf(id));
}

function hold({ id, face, point }) {
  instrument.hold(id, instrument.model(id).contact({ point: scaled(id, point), face }));
}

function release({ id }) {
  instrument.release(id);
}

/** Strike the chosen object at one of its numbered points: at the first where it is played. */
function strikeNumber(number) {
  const id = current();
  if (!objects.told.get(id)?.facts.points[number]) return;
  choose(id);
  strikeAt(id, numbered(id, number));
}

/** Return where one of an object's numbered points is on the body as it is now. */
function numbered(id, number) {
  const { point, direction } = objects.told.get(id).facts.points[number];
  return { point: scaled(id, point ?? [0, 0, 0]), direction: direction ?? undefined };
}

function dampLast(on) {
  const id = page.chosen;
  if (!id) return;
  if (on) instrument.hold(id, page.last.get(id) ?? instrument.model(id).contact(numbered(id, 0)));
  else instrument.release(id);
}

// Changes

/** Carry a change out, null for none; return whether that is all of it, or null: it was refused. */
async function change(id, wanted) {
  try {
    const answer = wanted ? await fetchChange(id, wanted) : null;
    instrument.change(id, answer);
    unsay('change');
    if (answer?.dropped.length) say(answer.dropped.join('; '), { id: 'change' });
    const model = instrument.model(id);
    room.change(id, { size: answer?.size ?? 1, material: answer?.material ?? objects.told.get(id).facts.material });
    const ringing = page.ringing.get(id);
    if (ringing && ringing.model.count === model.count) ringing.follow(model);
    else page.ringing.set(id, new Ringing(model));
    if (page.chosen === id) {
      const { selected } = modes;
      modes.fill(model, objects.told.get(id).facts.noise);
      panel.tell(model);
      spectrum.mark([...model.frequencies].slice(0, 200), modes.selected === null ? null : model.frequencies[selected]);
      if (modes.selected !== null) showMode(modes.selected);
    }
    wake();
    return answer?.settled ?? true;
  } catch (error) {
    if (error.id) complain(error);
    else say(`${objects.told.get(id).title} stays as it was: ${error.message}`, { bad: true, id: 'change' });
    return null;
  }
}

// Hearing

let looking = false;
let until = 0;

/** Follow what is heard, until it is silent. */
function wake() {
  until = performance.now() + PATIENCE;
  if (looking) return;
  looking = true;
  const look = () => {
    const now = performance.now() / 1000;
    const heard = spectrum.tick();
    const rings = modes.tick(page.ringing.get(page.chosen), now);
    for (const [id, ringing] of page.ringing) objects.ring(id, Boolean(ringing && loud(ringing, now)));
    looking = heard || rings || performance.now() < until;
    if (looking) requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
}

function loud(ringing, now) {
  return ringing.amplitudes.some((each, n) => each > 0 && ringing.share(n, now) > 0.35);
}

/** Say what can be done now, and whether the sound is still getting ready. */
function hint() {
  const there = [...page.models.values()].some(Boolean);
  let text = `${CLICK} any object: sound starts with your first ${CLICK.toLowerCase()}.`;
  if (instrument.pending) text = 'The sound is getting ready; your last blow will be heard then.';
  else if (!there && !instrument.ready) text = `Objects are on their way. Sound starts with your first ${CLICK.toLowerCase()} or key.`;
  else if (!there) text = 'The sound is ready. Objects are on their way.';
  else if (instrument.ready) {
    text = `${CLICK} an object to strike it; hold to damp it; drag beside it to look around.`;
    if (instrument.waiting) text = `You hear with one ear until two are ready. ${text}`;
  }
  if (get('hint').textContent !== text) get('hint').textContent = text;
  const sound = instrument.pending ? 'The sound is getting ready' : 'Get the sound ready meanwhile';
  get('empty').querySelector('button').textContent = instrument.ready ? 'The sound is ready' : sound;
}

instrument.onReady = () => {
  hint();
  if (instrument.analyser) spectrum.follow(instrument.analyser);
  wake();
};
instrument.onReport = (report) => {
  page.report = report;
  const many = (count, what) => `${count} ${what}${count === 1 ? '' : 's'}`;
  const words = [`${many(report.modes, 'mode')} ${report.modes === 1 ? 'rings' : 'ring'}`];
  words.push(report.reduction < -0.5 ? `limiter at −1 dB takes ${(-report.reduction).toFixed(0)} dB away` : 'limiter at −1 dB');
  if (report.dropped) words.push(`${many(report.dropped, 'strike')} dropped`);
  if (report.underruns) words.push(many(report.underruns, 'gap'));
  get('counts').textContent = words.join(' · ');
};
room.onMoved = (head) => instrument.listen(head);

// Controls

for (const name of STRIKERS) {
  const label = document.createElement('label');
  label.className = 'chip';
  const input = Object.assign(document.createElement('input'), { type: 'radio', name: 'striker', value: name, checked: name === page.striker });
  const words = document.createElement('span');
  words.textContent = name;
  input.onchange = () => { page.striker = name; };
  label.append(input, words);
  get('strikers').append(label);
}

/** Tie a slider to what it sets, with its value in words. */
function slide(id, words, set) {
  const field = get(id);
  const follow = () => {
    set(Number(field.value));
    get(`${id}-shown`).textContent = words(Number(field.value));
    field.setAttribute('aria-valuetext', words(Number(field.value)));
  };
  field.addEventListener('input', follow);
  follow();
}
slide('speed', (value) => `${(10 ** value).toPrecision(2)} m/s`, (value) => { page.speed = 10 ** value; });
slide('volume', (value) => `${value} dB`.replace('-', '−'), (value) => instrument.setVolume(value));
get('empty').querySelector('button').onclick = hint; // any click starts the sound
get('ears').onchange = (event) => instrument.setEars(event.target.value).catch((error) => complain(error));
get('even').onchange = (event) => instrument.setEven(event.target.checked);
get('simple').checked = room.stage?.simple ?? true;
get('simple').disabled = !room.stage;
get('simple').onchange = (event) => room.stage.simplify(event.target.checked);
get('whole').onclick = () => { room.home(); get('whole').hidden = true; };
get('hit').onclick = () => strikeNumber(0);
const damp = get('damp');
for (const name of ['pointerdown', 'keydown']) damp.addEventListener(name, (event) => (event.key ?? ' ') === ' ' && dampLast(true));
for (const name of ['pointerup', 'pointercancel', 'keyup', 'blur']) damp.addEventListener(name, () => dampLast(false));

/** What keys do, wherever the focus is but in a field that needs them itself. */
function key(event) {
  if (event.ctrlKey || event.altKey || event.metaKey || event.target.matches('input, select, textarea, [role="listbox"]')) return;
  const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
  const digit = /^[0-9]$/.test(event.key) ? (Number(event.key) + 9) % 10 : null;
  if (step) choose(objects.beside(page.chosen, step));
  else if (digit !== null) event.repeat || strikeNumber(digit);
  else if (event.key === ' ' && !event.target.matches('button, summary')) event.repeat || strikeNumber(0);
  else if (event.key === 'd' || event.key === 'D') event.repeat || dampLast(true);
  else if (event.key === 'm' || event.key === 'M') modes.next();
  else if (event.key === '+' || event.key === '=') room.zoom(0.85);
  else if (event.key === '-') room.zoom(1 / 0.85);
  else if (event.key === 'Home') get('whole').click();
  else if (event.key === 'Enter' && event.target === get('canvas')) room.approach(page.chosen), (get('whole').hidden = false);
  else return;
  event.preventDefault();
}
addEventListener('keydown', key);
addEventListener('keyup', (event) => (event.key === 'd' || event.key === 'D') && dampLast(false));

if (!globalThis.crossOriginIsolated) say('the page is not isolated, so that blows reach the sound a little later: open the address that struck printed, with 127.0.0.1 in it', { id: 'isolation' });
hint();
let lost = ''; // why the server is out of reach: said once, though it is tried over and over
follow(tell, (error) => {
  if (error && error.message !== lost) complain(error);
  if (!error) unsay('lost');
  lost = error?.message ?? '';
});
page.ready = true;
