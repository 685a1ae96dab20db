/** The discrete Fourier transform of a power of two, in place (Cooley and Tukey 1965). */

/**
 * Return the sums over k of z_k exp(2 pi i k n / size), in place of z.
 * @param {Float64Array} re real parts, as many as a power of two
 * @param {Float64Array} im
 */
export function transformBack(re, im) {
  const size = re.length;
  for (let k = 1, mirrored = 0; k < size; k++) {
    let bit = size >> 1;
    for (; mirrored & bit; bit >>= 1) mirrored ^= bit;
    mirrored ^= bit;
    if (k < mirrored) {
      [re[k], re[mirrored]] = [re[mirrored], re[k]];
      [im[k], im[mirrored]] = [im[mirrored], im[k]];
    }
  }
  for (let half = 1; half < size; half *= 2) {
    for (let k = 0; k < half; k++) {
      const turn = (Math.PI * k) / half;
      const [c, s] = [Math.cos(turn), Math.sin(turn)];
      for (let low = k; low < size; low += 2 * half) {
        const high = low + half;
        const [x, y] = [re[high] * c - im[high] * s, re[high] * s + im[high] * c];
        [re[high], im[high]] = [re[low] - x, im[low] - y];
        re[low] += x;
        im[low] += y;
      }
    }
  }
}
