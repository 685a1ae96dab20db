/**
 * A model as the page uses it: modes, where they are driven and how they are heard.
 * Arrays are views of the file; what depends on a contact is the twin of `ShapeGains` in Python.
 */
import { FormatError, readContainer } from './container.js';
import { formsOf } from './forms.js';
import { Recoil } from './recoil.js';
import { Surface, dot, length, subtract } from './surface.js';

export { FormatError } from './container.js';

const SNAP = 0.02; // share of the body's extent within which a place is moved onto the surface
const FINE = 0.28; // spacing times wave number up to which straight lines miss a wave by 1 %
const FIELDS = ['TimbreField', 'TimbreTable'];
const HELD_AXES = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
];

/**
 * Where and along which direction a body is pushed.
 * @typedef {{point: number[], normal: number[], direction: number[], face: number,
 *   weights: number[], distance: number}} Contact
 */

/**
 * Return the model that a file holds.
 * @param {ArrayBuffer} buffer content of a `.struck` file
 * @returns {Promise<Model>}
 * @throws {FormatError} with a sentence for a person
 */
export async function readModel(buffer) {
  const { metadata, tensors } = await readContainer(buffer);
  let text;
  try {
    text = JSON.parse(metadata.json);
  } catch {
    throw new FormatError('its metadata cannot be read, it is damaged: save the model again');
  }
  return new Model(text, tensors);
}

export class Model {
  /**
   * @param {any} text the JSON values of its file
   * @param {Record<string, {data: any, shape: number[]}>} tensors
   */
  constructor(text, tensors) {
    this.metadata = text;
    this.kind = text.gains?.kind;
    this.material = text.material;
    this.mass = text.mass;
    this.inertia = text.inertia;
    this.supported = text.supported;
    this.places = text.places;
    this.frequencies = numbers(tensors, 'frequencies');
    this.naturalFrequencies = numbers(tensors, 'natural_frequencies');
    this.decays = numbers(tensors, 'decays');
    this.count = this.frequencies.length;
    this.recoil = text.recoil ? new Recoil(text.recoil) : null;
    this.vertices = tensors.vertices ? numbers(tensors, 'vertices') : null;
    this.faces = tensors.faces?.data ?? null;
    this.centre = text.gains?.centre ?? text.centre ?? [0, 0, 0];
    this.surface = this.vertices && this.faces ? new Surface(this.vertices, this.faces) : null;
    this.#readGains(tensors);
    this.extent = this.surface ? this.surface.extent : 0;
    this.radius = this.surface ? this.surface.radiusAbout(this.centre) : 0;
  }

  /** @type {null | import('./forms.js').Forms} */
  #forms = null;
  #weights = new Float64Array(0);
  #size = 1;
  #plan = 2;
  /** @type {Float64Array} of modes known by their mesh alone, 1/m */
  #waveNumbers = new Float64Array(0);

  #readGains(tensors) {
    const shaped = this.kind === 'ShapeGains';
    if (!shaped && this.kind !== 'SinglePoint' && !FIELDS.includes(this.kind))
      throw new FormatError(
        `its gains are '${this.kind}', which this page does not know: update struck`,
      );
    const named = shaped ? 'outputs' : 'field_outputs';
    this.outputs = FIELDS.includes(this.kind) ? null : numbers(tensors, named);
    this.shapes = shaped ? numbers(tensors, 'shapes') : null;
    if (shaped && !this.surface)
      throw new FormatError('its mode shapes have no surface: save the model again');
    const wanted = shaped ? this.vertices.length * this.count : 0;
    const fits = !this.outputs || this.outputs.length === 2 * this.count;
    if (!fits || (shaped && this.shapes.length !== wanted) || this.decays.length !== this.count)
      throw new FormatError('its tensors are of different numbers of modes: save the model again');
    if (shaped && this.faces.some((corner) => corner >= this.vertices.length / 3))
      throw new FormatError('its faces name vertices that it does not have: save the model again');
    if (shaped && this.metadata.gains.formula) this.#readFormula(tensors);
  }

  #readFormula(tensors) {
    const shapes = this.metadata.gains.formula.TransverseShapes;
    const parts = partsOf(shapes, tensors);
    const [kind, given] = Object.entries(shapes.forms)[0];
    this.#forms = formsOf(kind, partsOf(given, tensors));
    this.#weights = parts.weights;
    this.#size = parts.size;
    this.#plan = this.metadata.coordinates.length;
    this.formula = kind;
    if (!this.#forms) this.#waveNumbers = partsOf(given, tensors).wavenumbers;
  }

  /**
   * The frequency up to which `drive` is true to 1 % where its formula has no twin here, so that it
   * goes straight from vertex to vertex, Hz: beyond it ask the server. Infinite for all others.
   */
  get exactTo() {
    if (!this.formula || this.#forms) return Infinity;
    // Straight lines miss a wave by (wave number times spacing)^2 / 8 of its amplitude.
    const longest = (FINE / this.surface.longestEdge) * this.#size;
    const fine = this.#waveNumbers.filter((each) => each <= longest).length;
    return fine ? this.naturalFrequencies[fine - 1] : 0;
  }

  /** Whether a click anywhere is the one contact that was recorded. */
  get recorded() {
    return this.shapes === null;
  }

  /**
   * Return a contact at a place of the body, m, moved onto its surface.
   * @param {{point: number[], face?: number, direction?: number[]}} where the face a ray has met,
   *   where it is known; a push straight into the surface unless it has a direction
   * @returns {Contact}
   */
  contact({ point, face, direction }) {
    if (!point.every(Number.isFinite))
      throw new RangeError(`the place is (${point.join(', ')}): give finite numbers, in m`);
    if (this.recorded) {
      const none = [0, 0, 0];
      const found = { point, normal: none, direction: none, face: 0, weights: [1, 0, 0] };
      return { ...found, distance: 0 };
    }
    const place = this.surface.nearest(point, face);
    if (!(place.distance <= SNAP * this.extent))
      throw new RangeError(
        `the place is ${place.distance.toPrecision(3)} m off the body, more than ` +
          `${(SNAP * this.extent).toPrecision(3)} m: choose one on it`,
      );
    const normal = this.surface.normalAt(place);
    return { ...place, normal, direction: direction ? unit(direction) : normal.map((n) => -n) };
  }

  /** Return the contact at one of `places`, or null where none has that name. */
  place(name) {
    const point = this.places[name];
    return point ? this.contact({ point: this.recorded ? point : padded(point) }) : null;
  }

  /** Return the loudest contact among the named places, or the first vertex without any. */
  loudest() {
    const contacts = Object.keys(this.places).map((name) => this.place(name));
    if (!contacts.length)
      contacts.push(this.contact({ point: this.surface ? this.surface.vertex(0) : [0, 0, 0] }));
    const levels = contacts.map((contact) => this.#level(this.drive(contact)));
    return contacts[levels.indexOf(Math.max(...levels))];
  }

  /** Return the energy that modes give off until they have died away, for one drive. */
  #level(drive) {
    let total = 0;
    for (let n = 0; n < this.count; n++) {
      const size = Math.hypot(this.outputs[2 * n], this.outputs[2 * n + 1]) * drive[n];
      total += (size * size) / Math.max(this.decays[n], 1e-3 * this.naturalFrequencies[n]);
    }
    return total;
  }

  /** Whether `drive` is true to 1 % for all modes, or the server knows better. */
  get exact() {
    return !this.count || this.exactTo >= this.naturalFrequencies[this.count - 1];
  }

  /**
   * Return how strongly each mode answers a push, kg^-1/2 (M,), then each axis of recoil, where the
   * body has it (3,).
   * @param {Contact} contact
   * @param {ArrayLike<number>} [told] that of the modes, where the server computed it
   */
  drive(contact, told) {
    const { recoil } = this;
    const modes = told ?? this.#moved(contact, contact.direction);
    return Float64Array.of(...modes, ...(recoil ? recoil.drives(contact.direction) : []));
  }

  /** Return the mode shapes at a contact along a direction, kg^-1/2 (M,). */
  #moved(contact, direction) {
    if (this.kind === 'SinglePoint') return new Float64Array(this.count).fill(1);
    if (!this.shapes)
      throw new FormatError(
        'it is a recorded timbre field, which this page does not play yet: render it with struck',
      );
    if (!this.#forms) return this.#atVertices(contact, direction);
    const plan = contact.point.map((each) => each / this.#size);
    const values = this.#forms.values(plan[0], this.#plan > 1 ? plan[1] : 0);
    return values.map((value, n) => value * this.#weights[n] * direction[2]);
  }

  #atVertices({ face, weights }, direction) {
    const drive = new Float64Array(this.count);
    for (let corner = 0; corner < 3; corner++) {
      const vertex = this.faces[3 * face + corner];
      for (let axis = 0; axis < 3; axis++) {
        const share = weights[corner] * direction[axis];
        const row = (3 * vertex + axis) * this.count;
        if (share) for (let n = 0; n < this.count; n++) drive[n] += share * this.shapes[row + n];
      }
    }
    return drive;
  }

  /**
   * Return the gains at a listener in body coordinates, m, relative to the arrival of the sound.
   * @returns {{re: Float64Array, im: Float64Array}} each (M,)
   */
  toward(listener) {
    const distance = length(subtract(listener, this.centre));
    if (!(distance > 0 && distance >= this.radius))
      throw new RangeError(
        `the listener is ${distance.toPrecision(3)} m from the body's centre, inside its radius ` +
          `of ${this.radius.toPrecision(3)} m: move it away`,
      );
    return this.#outputs(1 / distance);
  }

  /**
   * Return the gains at 1 m from the body as a point source, those of recoil last.
   * @returns {{re: Float64Array, im: Float64Array}}
   */
  aside(sampleRate) {
    const { re, im } = this.#outputs(1);
    const more = this.recoil ? this.recoil.outputs(sampleRate) : [];
    const filled = (values, part) => Float64Array.of(...values, ...more.map((each) => each[part]));
    return { re: filled(re, 0), im: filled(im, 1) };
  }

  #outputs(scale) {
    if (!this.outputs)
      throw new FormatError('it is a recorded timbre field: render it with struck');
    const re = Float64Array.from({ length: this.count }, (_, n) => scale * this.outputs[2 * n]);
    const im = Float64Array.from({ length: this.count }, (_, n) => scale * this.outputs[2 * n + 1]);
    return { re, im };
  }

  /**
   * Return by how much a soft grip of `grip` N s/m raises each decay, 1/s (M,): the twin of `Hold`.
   * @param {Contact} contact
   * @param {number} grip
   */
  raised(contact, grip) {
    const raised = new Float64Array(this.count);
    for (const axis of HELD_AXES) {
      const moved = this.#moved(contact, axis);
      for (let n = 0; n < this.count; n++) raised[n] += (grip / 2) * moved[n] * moved[n];
    }
    return raised;
  }

  /** Return the displacement of a mode at the vertices, kg^-1/2 (3 V,). */
  modeShape(mode) {
    return Float32Array.from(this.vertices, (_, k) => this.shapes[k * this.count + mode]);
  }
}

/** Return the numbers of a tensor; FormatError where it is missing or not finite. */
function numbers(tensors, name) {
  const data = tensors[name]?.data;
  if (!data) throw new FormatError(`its tensor '${name}' is missing: save the model again`);
  for (let k = 0; k < data.length; k++)
    if (!Number.isFinite(data[k]))
      throw new FormatError(`its tensor '${name}' holds numbers that are not finite`);
  return data;
}

/** Return the parts of a formula, each array by its name in the file. */
function partsOf(given, tensors) {
  const parts = { shapes: {} };
  for (const [name, value] of Object.entries(given)) {
    if (value?.array) {
      const tensor = tensors[`formula.${value.array[0]}`];
      if (!tensor) throw new FormatError('a part of its formula is missing: save the model again');
      parts[name] = tensor.data;
      parts.shapes[name] = tensor.shape;
    } else parts[name] = value;
  }
  return parts;
}

function unit(direction) {
  const size = Math.sqrt(dot(direction, direction));
  if (!(size > 0)) throw new RangeError('the direction is (0, 0, 0): give one with a length');
  return direction.map((each) => each / size);
}

const padded = (point) => [...point, 0, 0].slice(0, 3);
