/** Weights by which a delay line is read between its samples: as `struck.ears.delay_lines`. */
import { besselI0 } from '../model/bessel.js';

export const READ = 32; // samples that a value between samples is made of
export const FINE = 256; // places between two samples
const STEEPNESS = 9; // of Kaiser's window

/** Return the weights (FINE + 1, READ) for places between two samples: a sinc under a window. */
export function betweenSamples() {
  const weights = new Float32Array((FINE + 1) * READ);
  for (let fine = 0; fine <= FINE; fine++) {
    const row = Array.from({ length: READ }, (_, n) => weight(n - (READ / 2 - 1) - fine / FINE));
    const sum = row.reduce((total, each) => total + each, 0);
    row.forEach((each, n) => (weights[fine * READ + n] = each / sum));
  }
  return weights;
}

function weight(place) {
  const inside = Math.sqrt(Math.max(0, 1 - (place / (READ / 2)) ** 2));
  const sinc = place === 0 ? 1 : Math.sin(Math.PI * place) / (Math.PI * place);
  return (sinc * besselI0(STEEPNESS * inside)) / besselI0(STEEPNESS);
}
