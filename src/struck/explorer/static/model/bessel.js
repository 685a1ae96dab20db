/**
 * Bessel functions of whole order at one place, by recurrence from high orders down (Miller's
 * algorithm: Abramowitz and Stegun, "Handbook of Mathematical Functions", 9.12).
 */

const LARGE = 1e250;
const EULER = 0.5772156649015329;

/**
 * Return J_0(x) to J_m(x) and beyond, as many as the sums of `neumann` need.
 * @param {number} order m
 * @param {number} x at least 0
 * @returns {Float64Array}
 */
export function besselJ(order, x) {
  if (x === 0) return Float64Array.from({ length: order + 2 }, (_, n) => (n ? 0 : 1));
  const beyond = Math.max(order + 2, Math.ceil(x));
  const start = 2 * Math.ceil((beyond + 20 + 6 * Math.cbrt(beyond) + Math.sqrt(40 * order)) / 2);
  const values = new Float64Array(start + 2);
  values[start] = 1e-250;
  let total = 0; // J_0 + 2 J_2 + 2 J_4 + ... = 1
  for (let n = start; n > 0; n--) {
    values[n - 1] = ((2 * n) / x) * values[n] - values[n + 1];
    if (Math.abs(values[n - 1]) > LARGE) {
      values.subarray(n - 1).forEach((each, k, some) => (some[k] = each / LARGE));
      total /= LARGE;
    }
    if (n > 1 && (n - 1) % 2 === 0) total += 2 * values[n - 1];
  }
  total += values[0];
  return values.map((each) => each / total);
}

/**
 * Return Y_m(x), upwards from the sums of Neumann for Y_0 and Y_1 and their slopes (Abramowitz
 * and Stegun, 9.1.88).
 * @param {number} order m
 * @param {number} x above 0
 */
export function besselY(order, x) {
  const j = besselJ(Math.max(order, 1), x);
  const logarithm = Math.log(x / 2) + EULER;
  let zeroth = logarithm * j[0];
  let first = -j[0] / x + (logarithm - 1) * j[1];
  for (let k = 1; 2 * k + 1 < j.length; k++) {
    const sign = k % 2 ? -1 : 1;
    zeroth -= (2 * sign * j[2 * k]) / k;
    first -= (sign * (2 * k + 1) * j[2 * k + 1]) / (k * (k + 1));
  }
  let [before, now] = [(2 / Math.PI) * zeroth, (2 / Math.PI) * first];
  if (order === 0) return before;
  for (let n = 1; n < order; n++) [before, now] = [now, ((2 * n) / x) * now - before];
  return now;
}

/**
 * Return exp(-x) I_m(x), the modified function without its growth.
 * @param {number} order m
 * @param {number} x at least 0
 */
export function besselIScaled(order, x) {
  if (x === 0) return order ? 0 : 1;
  const start = order + 20 + Math.ceil(Math.sqrt(80 * x) + Math.sqrt(40 * order));
  let [above, now, total, wanted] = [0, 1e-250, 0, start === order ? 1e-250 : 0];
  for (let n = start; n > 0; n--) {
    total += 2 * now; // I_0 + 2 I_1 + 2 I_2 + ... = exp(x)
    [above, now] = [now, ((2 * n) / x) * now + above];
    if (n - 1 === order) wanted = now;
    if (now > LARGE)
      [above, now, total, wanted] = [above, now, total, wanted].map((v) => v / LARGE);
  }
  return wanted / (total + now);
}

/** Return I_0(x), by its series. */
export function besselI0(x) {
  let [term, total] = [1, 1];
  for (let k = 1; term > 1e-17 * total; k++) {
    term *= (x / (2 * k)) ** 2;
    total += term;
  }
  return total;
}
