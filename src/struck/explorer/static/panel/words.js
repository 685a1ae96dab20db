/** Numbers with their units in words for a person: none with a power of ten. */

const THRESHOLDS = { kg: 0.9995, g: 9.995e-4, ms: 0.01, endless: 999 };

/** Return a number to some digits, as `toPrecision` writes it, and never with a power of ten. */
export function digits(value, count, { least = count } = {}) {
  const rounded = Number(value.toPrecision(count));
  return rounded.toLocaleString('en', { useGrouping: false, minimumSignificantDigits: least, maximumSignificantDigits: 21 });
}

/** Return a mass, kg, in words to three digits: "56.7 g", "1230 kg". */
export function weight(mass) {
  const three = (value) => digits(value, 3, { least: 1 });
  if (mass >= THRESHOLDS.kg) return `${three(mass)} kg`;
  return mass < THRESHOLDS.g ? `${three(1e6 * mass)} mg` : `${three(1000 * mass)} g`;
}

/** Return a factor in words: "as it was", "2.0 times". */
export function times(factor) {
  if (Math.abs(factor - 1) < 0.005) return 'as it was';
  return `${factor < 10 ? digits(factor, 2) : factor.toFixed(0)} times`;
}

/** Return a length, m, in words to two digits or whole centimetres. */
export function length(metres) {
  return metres < 0.0995 ? `${digits(1000 * metres, 2)} mm` : `${(100 * metres).toFixed(0)} cm`;
}

/** Return a frequency, Hz, in words to three digits. */
export function hertz(frequency) {
  return frequency < 999.5 ? `${digits(frequency, 3)} Hz` : `${digits(frequency / 1000, 3)} kHz`;
}

/** Return the time to decay by 60 dB, by a decay rate in 1/s, in words. */
export function lasting(decay) {
  const t60 = Math.log(1000) / Math.max(decay, 1e-9);
  if (t60 > THRESHOLDS.endless) return 'endless';
  if (t60 < THRESHOLDS.ms) return `${digits(1000 * t60, 1)} ms`;
  return `${t60 >= 10 ? t60.toFixed(0) : t60.toFixed(t60 >= 1 ? 1 : 2)} s`;
}
