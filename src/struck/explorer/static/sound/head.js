/**
 * Heads: delays and responses of the ears to sound from a direction, from tables that the server
 * makes (`struck.explorer.head_bytes`). Between nodes they follow cubics, as `struck.ears` has it.
 */
import { readContainer } from '../model/container.js';

/**
 * @typedef {{ears: number, taps: number, points: number[][],
 *   toward: (direction: ArrayLike<number>, distance: number, delays: Float64Array,
 *     responses: Float32Array) => void}} Head
 */

const HEAD_RADIUS = 0.0875; // m
const GROUP = 8; // taps are padded to a multiple

const padded = (taps) => GROUP * Math.ceil(taps / GROUP);

/** Catmull and Rom 1974: weights of four neighbours, `share` of the way from the second on. */
function cubic(share, weights, at) {
  const square = share * share;
  const cube = square * share;
  weights[at] = 0.5 * (-share + 2 * square - cube);
  weights[at + 1] = 0.5 * (2 - 5 * square + 3 * cube);
  weights[at + 2] = 0.5 * (share + 4 * square - 3 * cube);
  weights[at + 3] = 0.5 * (-square + cube);
}

/** One ear without a head. */
export class SinglePoint {
  ears = 1;
  taps = GROUP;
  points = [[0, 0, 0]];

  toward(direction, distance, delays, responses) {
    delays[0] = 0;
    responses.fill(0);
    responses[0] = 1;
  }
}

/**
 * Return the head that a file holds.
 * @param {ArrayBuffer} buffer
 * @returns {Promise<Head>}
 */
export async function readHead(buffer) {
  const { metadata, tensors } = await readContainer(buffer, { kind: 'struck-head' });
  return headOf(JSON.parse(metadata.json), tensors);
}

/** Return the head of tables that have been read. */
export function headOf(text, tensors) {
  return text.kind === 'ball' ? new Ball(text, tensors) : new Measured(text, tensors);
}

const sides = (radius) => [
  [0, radius, 0],
  [0, -radius, 0],
];

/** Two ears on a rigid ball: a table over angle and distance, the same for both ears. */
class Ball {
  ears = 2;

  constructor(text, { delays, responses }) {
    this.text = text;
    this.delays = delays.data;
    this.responses = responses.data;
    this.width = responses.shape[1];
    this.taps = padded(this.width);
    this.points = sides(text.radius);
    this.weights = new Float64Array(8);
  }

  toward(direction, distance, delays, responses) {
    const { steps, near, knots, knot_step: step, radius, ears } = this.text;
    const height = Math.max(distance / radius, near) - 1;
    const along = Math.min(Math.log(height / (near - 1)) / step, knots - 4) + 1;
    responses.fill(0);
    for (let ear = 0; ear < 2; ear++) {
      const [x, y, z] = ears[ear];
      const cosine = direction[0] * x + direction[1] * y + direction[2] * z;
      const angle = (Math.acos(Math.max(-1, Math.min(1, cosine))) * steps) / Math.PI + 1;
      delays[ear] = this.#mix(along, angle, responses, ear * this.taps);
    }
  }

  #mix(along, angle, responses, at) {
    const [low, first] = [Math.floor(along), Math.floor(angle)];
    cubic(along - low, this.weights, 0);
    cubic(angle - first, this.weights, 4);
    let delay = 0;
    for (let i = 0; i < 4; i++) {
      for (let j = 0; j < 4; j++) {
        const weight = this.weights[i] * this.weights[4 + j];
        const node = (low + i - 1) * (this.text.steps + 4) + first + j - 1;
        delay += weight * this.delays[node];
        const row = node * this.width;
        for (let t = 0; t < this.width; t++) responses[at + t] += weight * this.responses[row + t];
      }
    }
    return delay;
  }
}

/** Two measured ears: far responses over directions, convolved with the change near by. */
class Measured {
  ears = 2;

  constructor(text, tensors) {
    this.text = text;
    this.far = { delays: tensors.far_delays.data, responses: tensors.far_responses.data };
    this.near = { delays: tensors.near_delays.data, responses: tensors.near_responses.data };
    this.long = tensors.far_responses.shape[2];
    this.short = tensors.near_responses.shape[2];
    this.taps = padded(this.long);
    this.points = sides(HEAD_RADIUS);
    this.weights = new Float64Array(8);
    this.mixed = new Float64Array(2 * this.long);
    this.change = new Float64Array(2 * this.short);
    this.later = new Float64Array(2);
  }

  toward([x, y, z], distance, delays, responses) {
    const { columns, near_columns: nearColumns, step, knot_step: knot } = this.text;
    const { near, near_steps: nearSteps, farthest, radius } = this.text;
    const degrees = 180 / Math.PI / step;
    const up = Math.atan2(z, Math.hypot(x, y)) * degrees + 90 / step + 1;
    const around = Math.atan2(-y, -x) * degrees + 180 / step + 1;
    const bounded = Math.min(Math.max(distance, near * radius), farthest * radius);
    const height = (Math.log(bounded / radius - 1) - Math.log(near - 1)) / knot + 1;
    const aside = (Math.atan2(Math.hypot(x, z), y) * nearSteps) / Math.PI + 1;
    this.#mix(this.far, up, around, columns, this.mixed, delays);
    this.#mix(this.near, height, aside, nearColumns, this.change, this.later);
    delays[0] += this.later[0];
    delays[1] += this.later[1];
    for (let ear = 0; ear < 2; ear++) this.#convolve(ear, responses);
  }

  #mix({ delays, responses }, first, second, columns, mixed, later) {
    const width = mixed.length;
    const [low, left] = [Math.floor(first), Math.floor(second)];
    cubic(first - low, this.weights, 0);
    cubic(second - left, this.weights, 4);
    mixed.fill(0);
    later[0] = later[1] = 0;
    for (let i = 0; i < 4; i++) {
      for (let j = 0; j < 4; j++) {
        const weight = this.weights[i] * this.weights[4 + j];
        const node = (low + i - 1) * columns + left + j - 1;
        later[0] += weight * delays[2 * node];
        later[1] += weight * delays[2 * node + 1];
        const row = node * width;
        for (let t = 0; t < width; t++) mixed[t] += weight * responses[row + t];
      }
    }
  }

  #convolve(ear, responses) {
    const { long, short, mixed, change, taps } = this;
    for (let t = 0; t < taps; t++) {
      let total = 0;
      const last = Math.min(short - 1, t);
      if (t < long)
        for (let k = 0; k <= last; k++)
          total += change[ear * short + k] * mixed[ear * long + t - k];
      responses[ear * taps + t] = total;
    }
  }
}
