/** A model of another material, size, damping or loudness: its shapes stay those of the original. */

import { Recoil } from './recoil.js';

const TIMES = (values, factor) => values.map((value) => value * factor);

/**
 * What the server tells of a change; arrays have a row for each mode that is left.
 * @typedef {{modes: number[] | null, frequencies: number[], natural_frequencies: number[],
 *   decays: number[], outputs: number[][], factor: number, size: number, mass: number | null,
 *   recoil: object | null, centre: number[] | null, inertia: number[][] | null, material: object | null}} Change
 */

/** It stands for a `Model` wherever one is struck, held or heard. */
export class ChangedModel {
  /**
   * @param {import('./model.js').Model} original
   * @param {Change | null} change null: as it was
   * @param {number} [loudness] what its pressures are multiplied by
   */
  constructor(original, change, loudness = 1) {
    this.original = original;
    this.modes = change?.modes ?? null;
    this.size = change?.size ?? 1;
    this.factor = change?.factor ?? 1;
    this.metadata = change ? { ...original.metadata, centre: change.centre } : original.metadata;
    this.kind = original.kind;
    this.supported = original.supported;
    this.places = original.places;
    this.recorded = original.recorded;
    this.frequencies = change ? Float64Array.from(change.frequencies) : original.frequencies;
    this.naturalFrequencies = change ? Float64Array.from(change.natural_frequencies) : original.naturalFrequencies;
    this.decays = change ? Float64Array.from(change.decays) : original.decays;
    this.count = this.frequencies.length;
    this.outputs = change ? Float64Array.from(change.outputs.flat()) : original.outputs;
    this.outputs &&= TIMES(this.outputs, loudness);
    const recoil = change ? change.recoil : original.recoil;
    this.recoil = recoil && new Recoil({ ...recoil, levels: TIMES(recoil.levels, loudness) });
    this.material = change ? change.material : original.material;
    this.mass = change ? change.mass : original.mass;
    this.inertia = change ? change.inertia : original.inertia;
    this.centre = TIMES(original.centre, this.size);
    this.radius = original.radius * this.size;
    this.shapes = original.shapes;
    this.extent = original.extent * this.size;
  }

  #chosen(values) {
    return this.modes ? Float64Array.from(this.modes, (mode) => values[mode]) : values;
  }

  #before(contact) {
    return { ...contact, point: TIMES(contact.point, 1 / this.size) };
  }

  #after(contact) {
    return contact && { ...contact, point: TIMES(contact.point, this.size), distance: contact.distance * this.size };
  }

  /** Return a contact at a place of the body, m, as `Model.contact`. */
  contact(where) {
    return this.#after(this.original.contact(this.#before(where)));
  }

  place(name) {
    return this.#after(this.original.place(name));
  }

  loudest() {
    return this.#after(this.original.loudest());
  }

  /**
   * Return how strongly each mode answers a push, kg^-1/2 (M,), then each axis of recoil; `told` is
   * that of the original's modes, where the server computed it.
   */
  drive(contact, told) {
    const before = this.original.drive(this.#before(contact), told).subarray(0, this.original.count);
    const modes = TIMES(this.#chosen(before), this.recorded ? 1 : this.factor);
    return this.recoil ? Float64Array.of(...modes, ...this.recoil.drives(contact.direction)) : modes;
  }

  /** Return by how much a grip, N s/m, raises each decay, 1/s (M,). */
  raised(contact, grip) {
    return this.#chosen(this.original.raised(this.#before(contact), grip * (this.recorded ? 1 : this.factor ** 2)));
  }

  /** Return the gains at 1 m from the body as a point source, those of recoil last. */
  aside(sampleRate) {
    const more = this.recoil ? this.recoil.outputs(sampleRate) : [];
    const part = (k) => Float64Array.of(...Array.from({ length: this.count }, (_, n) => this.outputs[2 * n + k]), ...more.map((each) => each[k]));
    return { re: part(0), im: part(1) };
  }

  /** Return the displacement of a mode at the vertices, in a unit of its own (3 V,). */
  modeShape(mode) {
    return this.original.modeShape(this.modes ? this.modes[mode] : mode);
  }
}
