/**
 * The force of a strike as samples: a half-sine read through a short low-pass, so that nothing
 * above half the sample rate folds down. The twin of `struck/excitation/pulses.py`.
 */
import { besselI0 } from '../model/bessel.js';
import { transformBack } from './fourier.js';

export const LEAD = 7; // samples that a pulse begins before its onset
const FLATNESS = 7.5; // of the Kaiser window
const OVERSAMPLING = 8;
const STEP = 1 / 128; // of frequency times duration, between which spectra go straight
const TABLE_END = 512;

/**
 * Return the band-limited samples of a half-sine.
 * @param {{impulse: number, onset: number, duration: number, sampleRate: number}} pulse its area,
 *   N s, and times, s
 * @returns {{first: number, force: Float64Array}} number of the first sample, and forces, N
 */
export function sampledPulse({ impulse, onset, duration, sampleRate }) {
  const length = duration * sampleRate;
  const first = Math.floor(onset * sampleRate) - LEAD;
  const begin = onset * sampleRate - first;
  const count = Math.ceil(begin + length) + LEAD;
  let size = 64;
  while (size < count) size *= 2;
  const { re, im } = folded(size, begin + length / 2, length);
  transformBack(re, im);
  const scale = (impulse * sampleRate) / size;
  return { first, force: re.slice(0, count).map((each) => each * scale) };
}

/** Return the spectrum of the samples, what lies above half their rate added to what is below. */
function folded(size, delay, length) {
  const [re, im] = [new Float64Array(size), new Float64Array(size)];
  const pass = lowPassSpectrum(size);
  for (let bin = 0; bin < size; bin++) {
    const strength = halfSine((bin * length) / size) * pass[bin];
    const turn = (-2 * Math.PI * delay * bin) / size;
    // A real sum has conjugate bins: each goes to its place and, conjugate, to the mirrored one.
    const mirrored = (size - bin) % size;
    const share = bin === 0 ? 0.5 : 1;
    re[bin] += share * strength * Math.cos(turn);
    im[bin] += share * strength * Math.sin(turn);
    re[mirrored] += share * strength * Math.cos(turn);
    im[mirrored] -= share * strength * Math.sin(turn);
  }
  return { re, im };
}

/** Return the spectrum of a half-sine of unit area over frequency times duration, by its table. */
function halfSine(cycles) {
  if (cycles > TABLE_END) return 0;
  const low = Math.floor(cycles / STEP);
  const share = cycles / STEP - low;
  return (1 - share) * halfSineExactly(low * STEP) + share * halfSineExactly((low + 1) * STEP);
}

const halfSineExactly = (cycles) =>
  cycles === 0.5 ? Math.PI / 4 : Math.cos(Math.PI * cycles) / (1 - 4 * cycles * cycles);

/** Return the low-pass at a place in samples: a sinc in a Kaiser window of +-LEAD. */
function lowPass(place) {
  if (Math.abs(place) >= LEAD) return 0;
  const window = besselI0(FLATNESS * Math.sqrt(1 - (place / LEAD) ** 2)) / besselI0(FLATNESS);
  return place === 0 ? window : (window * Math.sin(Math.PI * place)) / (Math.PI * place);
}

/** @type {Map<number, Float64Array>} */
const SPECTRA = new Map();

/** Return the spectrum of the low-pass at 0, 1/size, ... (size - 1)/size of the rate. */
function lowPassSpectrum(size) {
  const known = SPECTRA.get(size);
  if (known) return known;
  const taps = Array.from({ length: LEAD * OVERSAMPLING + 1 }, (_, k) => lowPass(k / OVERSAMPLING));
  const spectrum = Float64Array.from({ length: size }, (_, bin) =>
    taps.reduce(
      (sum, tap, k) =>
        sum + (k ? 2 : 1) * tap * Math.cos((2 * Math.PI * k * bin) / (size * OVERSAMPLING)),
      0,
    ),
  );
  const whole = spectrum[0];
  SPECTRA.set(
    size,
    spectrum.map((each) => each / whole),
  );
  return SPECTRA.get(size);
}
