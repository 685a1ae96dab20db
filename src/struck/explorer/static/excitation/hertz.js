/** Elastic impact after Hertz: the twin of `struck/excitation/hertz.py` and of `Strike.resolved`. */
import { cross, dot, subtract } from '../model/surface.js';

/**
 * A round, elastic head, as `strikers.toml` has it.
 * @typedef {{radius: number, mass: number, youngs_modulus: number, poisson_ratio: number,
 *   restitution: number}} Striker
 */

// 4 sqrt(pi)/5 Gamma(2/5)/Gamma(9/10) (15/16)^(2/5) (Johnson 1985, section 11.4)
const CONTACT_CONSTANT = 2.8682656991953315;
const DEFAULT_SPEED = 0.5; // m/s

const softness = (solid) => (1 - solid.poisson_ratio ** 2) / solid.youngs_modulus;

/**
 * Return how long an elastic impact lasts, s.
 * @param {{mass: number, radius: number, modulus: number, speed: number}} impact kg, m, Pa, m/s
 */
export function contactTime({ mass, radius, modulus, speed }) {
  return CONTACT_CONSTANT * (mass ** 2 / (radius * modulus ** 2 * speed)) ** 0.2;
}

/**
 * Return the mass that a free rigid body shows to a push, kg: 1/(1/M + (r x n) I^-1 (r x n)).
 */
export function effectiveMass({ mass, centre, inertia, point, direction }) {
  const torque = cross(subtract(point, centre), direction);
  return 1 / (1 / mass + dot(torque, solved(inertia, torque)));
}

/** Return the solution of a system of three equations, by Cramer's rule. */
function solved(matrix, side) {
  const columns = [0, 1, 2].map((axis) => matrix.map((row) => row[axis]));
  const determinant = dot(columns[0], cross(columns[1], columns[2]));
  return [0, 1, 2].map((axis) => {
    const some = columns.map((column, k) => (k === axis ? side : column));
    return dot(some[0], cross(some[1], some[2])) / determinant;
  });
}

/**
 * Return impulse and duration of a strike on a body; `impulse` or `duration` alone overrule what
 * follows from the striker's speed.
 * @param {import('../model/model.js').Model} model
 * @param {import('../model/model.js').Contact} contact
 * @param {{striker?: Striker, speed?: number, impulse?: number, duration?: number}} said
 * @returns {{impulse: number, duration: number}} N s, s; 0 s is an ideal impulse
 */
export function resolved(model, contact, { striker, speed, impulse, duration }) {
  if (!striker) return { impulse: impulse ?? 1, duration: duration ?? 0 };
  if (impulse !== undefined && duration !== undefined) return { impulse, duration };
  const mass = massInContact(striker, model, contact);
  const gain = mass * (1 + striker.restitution);
  const fast = impulse === undefined ? (speed ?? DEFAULT_SPEED) : impulse / gain;
  const soft = softness(striker) + (model.material ? softness(model.material) : 0);
  const impact = { mass, radius: striker.radius, modulus: 1 / soft, speed: fast };
  return { impulse: gain * fast, duration: duration ?? contactTime(impact) };
}

/** Return the joint mass of striker and body; a body that is held, or of unknown mass, is heavy. */
function massInContact(striker, model, { point, direction }) {
  const { mass, inertia, supported, metadata } = model;
  if (supported || !mass || !inertia || !metadata.centre) return striker.mass;
  const body = effectiveMass({ mass, centre: metadata.centre, inertia, point, direction });
  return 1 / (1 / striker.mass + 1 / body);
}
