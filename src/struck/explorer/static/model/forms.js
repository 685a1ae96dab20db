/**
 * Mode shapes by formula: deflections of closed-form bodies along z at any place of their plan.
 * Each kind is the twin of the class of that name in `struck/shapes`.
 */
import { besselIScaled, besselJ, besselY } from './bessel.js';

/**
 * Deflections of M modes, of mean square 1.
 * @typedef {{count: number, values: (x: number, y: number) => Float64Array}} Forms
 */

/**
 * Return the forms of a kind by its parts as a model file keeps them, or null for one that is
 * known here by its mesh alone.
 * @param {string} kind
 * @param {Record<string, any>} parts
 * @returns {Forms | null}
 */
export function formsOf(kind, parts) {
  return KINDS[kind]?.(parts) ?? null;
}

const KINDS = {
  StringForms: stringForms,
  BendingForms: bendingForms,
  SineForms: sineForms,
  RoundForms: roundForms,
  RitzForms: ritzForms,
};

const share = (place, size) => Math.min(Math.max(place / size, 0), 1);

/** sqrt(2) sin(n pi x / length) */
function stringForms({ length, numbers }) {
  return {
    count: numbers.length,
    values(x) {
      const at = Math.PI * share(x, length);
      return Float64Array.from(numbers, (n) => Math.SQRT2 * Math.sin(at * n));
    },
  };
}

/** 2 sin(i pi x / length) sin(j pi y / width) */
function sineForms({ length, width, along, across }) {
  return {
    count: along.length,
    values(x, y) {
      const [u, v] = [Math.PI * share(x, length), Math.PI * share(y, width)];
      return Float64Array.from(along, (i, n) => 2 * Math.sin(u * i) * Math.sin(v * across[n]));
    },
  };
}

/** Two standing waves each: cos(a u), cosh(b u) / cosh(b span), sin(a u), sinh(b u) / .. */
function bendingForms({ length, origin, span, first, second, amplitudes }) {
  return {
    count: first.length,
    values(x) {
      const u = share(x, length) - origin;
      return Float64Array.from(first, (a, n) => {
        const [even, level, odd, rise] = amplitudes.subarray(4 * n, 4 * n + 4);
        let total = 0;
        if (even) total += even * Math.cos(u * a);
        if (level) total += level * levelWave(second[n], span, u);
        if (odd) total += odd * Math.sin(u * a);
        if (rise) total += rise * risingWave(second[n], span, u);
        return total;
      });
    },
  };
}

const waveNumber = (square) => Math.sqrt(Math.max(Math.abs(square), 2.2250738585072014e-308));

/** Return cosh(b u) / cosh(b span), or cos(|b| u) where b^2 lies below 0. */
function levelWave(square, span, u) {
  const b = waveNumber(square);
  if (square < 0) return Math.cos(b * u);
  const far = Math.abs(u);
  const growth = (1 + Math.exp(-2 * b * far)) / (1 + Math.exp(-2 * b * span));
  return Math.exp(b * (far - span)) * growth;
}

/** Return sinh(b u) / (b cosh(b span)), or sin(|b| u) / |b| where b^2 lies below 0. */
function risingWave(square, span, u) {
  const b = waveNumber(square);
  if (square < 0) return Math.sin(b * u) / b;
  const far = Math.abs(u);
  const rise = -Math.expm1(-2 * b * far) / (b * (1 + Math.exp(-2 * b * span)));
  return Math.sign(u) * Math.exp(b * (far - span)) * rise;
}

/** [a J_m(x r) + b Y_m(x r) + c I_m(x r) / I_m(x)] cos or sin of m times the angle */
function roundForms({ radius, ratio, orders, sines, wavenumbers, regular, singular, growing }) {
  const at = (n, r) => {
    const [m, x] = [orders[n], wavenumbers[n]];
    let total = regular[n] * besselJ(m, x * r)[m];
    if (singular[n]) total += singular[n] * besselY(m, x * r);
    if (growing[n]) {
      const grown = (besselIScaled(m, x * r) / besselIScaled(m, x)) * Math.exp(x * (r - 1));
      total += growing[n] * grown;
    }
    return total;
  };
  const repeats = (n) =>
    n > 0 &&
    [orders, wavenumbers, regular, singular, growing].every((each) => each[n] === each[n - 1]);
  return {
    count: orders.length,
    values(x, y) {
      const r = Math.min(Math.max(Math.hypot(x, y) / radius, ratio), 1);
      const angle = Math.atan2(y, x);
      const values = new Float64Array(orders.length);
      let radial = 0;
      for (let n = 0; n < orders.length; n++) {
        // A cosine and a sine of one root follow each other, and share what is dear.
        if (!repeats(n)) radial = at(n, r);
        values[n] = radial * (sines[n] ? Math.sin : Math.cos)(orders[n] * angle);
      }
      return values;
    },
  };
}

/** Sums of products of polynomials along x and y, c_ij p_i(x) q_j(y) */
function ritzForms({ length, width, ends, stride, starts, coefficients, shapes }) {
  const [modes, rows, columns] = shapes.coefficients;
  const norms = [0, 1].map((axis) =>
    edgeNorms(stride[axis] * shapes.coefficients[1 + axis], ends[2 * axis], ends[2 * axis + 1]),
  );
  const polynomials = (axis, u) =>
    edgePolynomials(norms[axis], ends[2 * axis], ends[2 * axis + 1], u);
  return {
    count: modes,
    values(x, y) {
      const along = polynomials(0, 2 * share(x, length) - 1);
      const across = polynomials(1, 2 * share(y, width) - 1);
      const values = new Float64Array(modes);
      let place = 0;
      for (let mode = 0; mode < modes; mode++) {
        for (let i = 0; i < rows; i++) {
          let line = 0;
          for (let j = 0; j < columns; j++)
            line += coefficients[place++] * across[starts[2 * mode + 1] + j * stride[1]];
          values[mode] += 2 * line * along[starts[2 * mode] + i * stride[0]];
        }
      }
      return values;
    },
  };
}

/**
 * Return (1 + u)^a (1 - u)^b P_n^(2b, 2a)(u), as many as there are norms, each over its norm; P_n
 * are Jacobi's polynomials (Abramowitz and Stegun, 22.7.1).
 */
function edgePolynomials(norms, a, b, u) {
  const [alpha, beta] = [2 * b, 2 * a];
  const edge = (1 + u) ** a * (1 - u) ** b;
  const values = new Float64Array(norms.length);
  let [before, now] = [0, 1];
  for (let n = 0; n < norms.length; n++) {
    if (n) [before, now] = [now, jacobiAfter(n, alpha, beta, u, before, now)];
    values[n] = (edge * now) / norms[n];
  }
  return values;
}

/** Return P_n by the two polynomials before. */
function jacobiAfter(n, alpha, beta, u, before, now) {
  if (n === 1) return alpha + 1 + ((alpha + beta + 2) * (u - 1)) / 2;
  const sum = 2 * n + alpha + beta;
  const middle = (sum - 1) * (sum * (sum - 2) * u + alpha * alpha - beta * beta);
  const last = 2 * (n + alpha - 1) * (n + beta - 1) * sum;
  return (middle * now - last * before) / (2 * n * (n + alpha + beta) * (sum - 2));
}

/** Return the roots of the mean squares over [-1, 1] (Abramowitz and Stegun, 22.2.1). */
function edgeNorms(count, a, b) {
  const [alpha, beta] = [2 * b, 2 * a];
  return Float64Array.from({ length: count }, (_, n) => {
    let square = 2 ** (alpha + beta + 1) / (2 * n + alpha + beta + 1);
    for (let k = 1; k <= alpha; k++) square *= (n + k) / (n + beta + k);
    return Math.sqrt(square);
  });
}
