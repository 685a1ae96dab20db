/**
 * Propagation of sound from bodies to ears, one stretch of time after the other: the twin of
 * `struck.ears.propagation` for bodies that stand still and a listener who moves.
 */
import { READ } from './weights.js';

export const STRETCH = 512; // samples from one look at all places to the next
const SOUND_SPEED = 343.21; // m/s, dry air at 20 degrees Celsius
const [EARLIEST, WAITING] = [1e-3, 16]; // s that a head may hear early, samples responses wait
const NEAREST = 1e-3; // m
const WORDS = 10; // of a knot: its time, then position, forward and up
const SHORT = 1e-9;

/** Where the listener's head is over time: knots, joined by straight lines, held at both ends. */
export class Course {
  constructor() {
    this.knots = new Float64Array(64 * WORDS);
    this.count = 0;
    this.set(0, [0, 0, 0, 1, 0, 0, 0, 0, 1], 0);
  }

  /** Make a knot the last one: those at its time or later go. */
  set(time, words, at) {
    while (this.count && this.knots[(this.count - 1) * WORDS] >= time) this.count--;
    if ((this.count + 1) * WORDS > this.knots.length) {
      const longer = new Float64Array(2 * this.knots.length);
      longer.set(this.knots);
      this.knots = longer;
    }
    const place = this.count * WORDS;
    this.knots[place] = time;
    for (let k = 0; k < 9; k++) this.knots[place + 1 + k] = words[at + k];
    this.count++;
  }

  /** Forget what lies before a time. */
  forget(time) {
    let gone = 0;
    while (gone + 1 < this.count && this.knots[(gone + 1) * WORDS] <= time) gone++;
    if (!gone) return;
    this.knots.copyWithin(0, gone * WORDS, this.count * WORDS);
    this.count -= gone;
  }

  /** Write position, forward and up at a time (9,). */
  at(time, pose) {
    let after = 1;
    while (after < this.count - 1 && this.knots[after * WORDS] < time) after++;
    const end = Math.min(after, this.count - 1) * WORDS;
    const begin = Math.max(end - WORDS, 0);
    const length = this.knots[end] - this.knots[begin];
    const share = length > 0 ? Math.min(Math.max((time - this.knots[begin]) / length, 0), 1) : 1;
    for (let k = 1; k < WORDS; k++)
      pose[k - 1] = (1 - share) * this.knots[begin + k] + share * this.knots[end + k];
  }
}

/** Write the axes of a head, rows forward, left and up; what has no direction stays as it was. */
function writeAxes(pose, axes) {
  normal(axes, 0, pose[3], pose[4], pose[5]);
  cross(axes, 3, pose[6], pose[7], pose[8], axes[0], axes[1], axes[2]);
  cross(axes, 6, axes[0], axes[1], axes[2], axes[3], axes[4], axes[5]);
}

function cross(axes, at, a, b, c, x, y, z) {
  normal(axes, at, b * z - c * y, c * x - a * z, a * y - b * x);
}

/** Write a vector of length one, where it has a length. */
function normal(axes, at, x, y, z) {
  const size = Math.sqrt(x * x + y * y + z * z);
  if (!(size > SHORT)) return;
  axes[at] = x / size;
  axes[at + 1] = y / size;
  axes[at + 2] = z / size;
}

/** Return by how many samples all delays are longer, so that none is too short to be read. */
export const leadOf = (sampleRate) => READ / 2 + WAITING + Math.ceil(EARLIEST * sampleRate);

/** The ways from all bodies to the ears of a head. */
export class Propagation {
  distance = 0; // m, of the body that is looked at

  /**
   * @param {import('./head.js').Head} head
   * @param {number} sampleRate Hz
   * @param {Propagation} [before] that of another head, which moves along with this one
   */
  constructor(head, sampleRate, before = undefined) {
    this.head = head;
    this.rate = sampleRate;
    this.lead = leadOf(sampleRate);
    this.start = before?.start ?? -this.lead / sampleRate;
    this.stretches = before?.stretches ?? 0;
    this.course = before?.course ?? new Course();
    this.pose = new Float64Array(9);
    this.axes = Float64Array.from(before?.axes ?? [1, 0, 0, 0, 1, 0, 0, 0, 1]);
    this.seen = new Float64Array(3);
    this.later = new Float64Array(head.ears);
  }

  /** The time from which the next stretch is heard, s. */
  get now() {
    return this.start + (this.stretches * STRETCH) / this.rate;
  }

  /** Bring the listener to a pose within the next stretch. */
  follow(words, at) {
    this.course.at(this.now, this.pose);
    this.course.set(this.now, this.pose, 0);
    this.course.set(this.now + STRETCH / this.rate, words, at);
  }

  /**
   * Return the way of a body, begun as if nothing had moved.
   * @param {{delays: Float64Array, gains: Float64Array, before: Float32Array,
   *   after: Float32Array}} line what its delay line reads
   */
  way(line, centre, radius) {
    const ears = this.head.ears;
    const end = { delays: new Float64Array(ears), gains: new Float64Array(ears) };
    const way = { line, centre, radius, end, later: new Float64Array(ears) };
    this.#look(this.now);
    this.#arrive(way, true);
    for (let ear = 0; ear < ears; ear++) {
      const { delay, gain } = this.#toward(way, ear, way.later[ear]);
      line.delays.fill((end.delays[ear] = delay), 3 * ear, 3 * ear + 3);
      line.gains.fill((end.gains[ear] = gain), 3 * ear, 3 * ear + 3);
    }
    return way;
  }

  /** Go on with all ways to the next stretch. */
  goOn(ways) {
    const [begin, length] = [this.now, STRETCH / this.rate];
    this.stretches++;
    this.#look(begin + length / 2);
    for (const way of ways) this.#begin(way);
    this.#look(begin + length);
    for (const way of ways) this.#finish(way);
    this.course.forget(begin);
  }

  /** Take over the end of the last stretch, and the distance at the middle of the next. */
  #begin({ line, end, centre, radius }) {
    const distance = this.#distance(centre);
    for (let ear = 0; ear < this.head.ears; ear++) {
      line.delays[3 * ear] = end.delays[ear];
      line.gains[3 * ear] = end.gains[ear];
      line.delays[3 * ear + 1] = distance;
      line.gains[3 * ear + 1] = 1 / Math.max(distance, radius, NEAREST);
    }
    line.before.set(line.after);
  }

  /** Add what the head does, whose delays move straight from stretch to stretch. */
  #finish(way) {
    const { line, end, later } = way;
    this.#arrive(way, false);
    for (let ear = 0; ear < this.head.ears; ear++) {
      const added = (later[ear] + this.later[ear]) / 2;
      const middle = line.delays[3 * ear + 1];
      line.delays[3 * ear + 1] = this.#delay(line, middle, added);
      later[ear] = this.later[ear];
      const { delay, gain } = this.#toward(way, ear, later[ear]);
      line.delays[3 * ear + 2] = end.delays[ear] = delay;
      line.gains[3 * ear + 2] = end.gains[ear] = gain;
    }
  }

  #arrive(way, first) {
    const { centre, line } = way;
    this.distance = this.#distance(centre);
    this.#direct(centre);
    this.head.toward(this.seen, this.distance, this.later, line.after);
    if (first) way.later.set(this.later);
    if (first) line.before.set(line.after);
  }

  #toward({ line, radius }, ear, added) {
    const gain = 1 / Math.max(this.distance, radius, NEAREST);
    return { delay: this.#delay(line, this.distance, added), gain };
  }

  /** Return a delay in samples, at most what the line holds. */
  #delay(line, distance, added) {
    const delay = this.lead + (distance / SOUND_SPEED + added) * this.rate;
    return Math.min(delay, line.longest);
  }

  /** Take the listener's place at a time; a direction without length leaves the last one. */
  #look(time) {
    this.course.at(time, this.pose);
    writeAxes(this.pose, this.axes);
  }

  #distance(centre) {
    const [x, y, z] = centre;
    const dx = x - this.pose[0];
    const dy = y - this.pose[1];
    const dz = z - this.pose[2];
    return Math.sqrt(dx * dx + dy * dy + dz * dz);
  }

  /** Write the direction of a place in the head's frame. */
  #direct(centre) {
    const size = Math.max(this.distance, SHORT);
    for (let axis = 0; axis < 3; axis++) {
      let total = 0;
      for (let k = 0; k < 3; k++) total += this.axes[3 * axis + k] * (centre[k] - this.pose[k]);
      this.seen[axis] = total / size;
    }
  }
}
