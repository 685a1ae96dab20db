/**
 * Recoil: the sound of a free body that a push sets moving as a whole, as three resonators beside
 * its modes, one for each axis. The twin of `struck/model/recoil.py`, which derives it.
 */
import { dot } from './surface.js';

const FASTEST = 3; // corner over sample rate, rad
const TINY = 2.2250738585072014e-308;

export class Recoil {
  /**
   * @param {{axes: number[][], levels: number[], corners: number[], dampings: number[]}} given
   *   unit vectors, Pa s/N at 1 m, Hz, damping ratios
   */
  constructor({ axes, levels, corners, dampings }) {
    this.axes = axes;
    this.levels = levels;
    this.corners = corners;
    this.dampings = dampings;
  }

  /** Return how strongly a unit push along a direction wakes each axis (3). */
  drives(direction) {
    const shares = this.axes.map((axis) => dot(axis, direction) ** 2);
    const power = shares.reduce((sum, each, n) => sum + each * this.levels[n] ** 2, 0);
    const strength = Math.max(Math.sqrt(power), TINY);
    return shares.map((each, n) => (each * this.levels[n]) / strength);
  }

  /** Return the poles at a sample rate, 1/s: [real, imaginary] of each axis. */
  poles(sampleRate) {
    return this.corners.map((corner, n) => {
      const fast = Math.min(2 * Math.PI * corner, FASTEST * sampleRate);
      const damping = this.dampings[n];
      return [-damping * fast, Math.sqrt(1 - damping * damping) * fast];
    });
  }

  /** Return the output gains at 1 m, Pa m/(N s): [real, imaginary] of each axis. */
  outputs(sampleRate) {
    return this.poles(sampleRate).map(([re, im], n) => {
      const size = Math.exp(re / sampleRate);
      const [x, y] = [size * Math.cos(im / sampleRate), size * Math.sin(im / sampleRate)];
      const [middle, last] = [-2 * x, size * size];
      const slope = (sampleRate * (1 + middle + last)) ** 2;
      const there = this.#power(n, sampleRate / 4) * ((1 - last) ** 2 + middle ** 2);
      const rising = Math.max(4 * (there - slope), 0);
      const bending = slope - rising / 4;
      const half = Math.sqrt(rising) / 2;
      const first = (half + Math.sqrt(Math.max(half * half + bending, 0))) / 2;
      const direct = -bending / (4 * first) / last;
      const now = first - direct;
      const scale = sampleRate * this.levels[n];
      return [(scale * (now * x - half - direct * middle)) / y, scale * now];
    });
  }

  /** Return the square of the response of an axis over its level at a frequency, Hz. */
  #power(n, frequency) {
    const below = frequency / this.corners[n];
    const denominator = (1 - below * below) ** 2 + (2 * this.dampings[n] * below) ** 2;
    return (2 * Math.PI * frequency) ** 2 / denominator;
  }
}
