/** Places on a triangle surface: the nearest point, its face, and the weights of its corners. */

/**
 * A point of a face.
 * @typedef {{face: number, weights: number[], point: number[], distance: number}} Place
 */

const TINY = 2.2250738585072014e-308;

export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const length = (a) => Math.hypot(a[0], a[1], a[2]);

// Cosine of 40 degrees: faces that turn further from each other meet in an edge.
const SMOOTH = Math.cos((40 * Math.PI) / 180);
const FLAT = 1e-9; // of unit normals: what differs less lies in one plane

/** A closed surface of V vertices and F triangles. */
export class Surface {
  /**
   * @param {Float64Array} vertices (V, 3), m
   * @param {Uint32Array} faces (F, 3)
   */
  constructor(vertices, faces) {
    this.vertices = vertices;
    this.faces = faces;
  }

  /** Return a vertex, m. */
  vertex(number) {
    return Array.from(this.vertices.subarray(3 * number, 3 * number + 3));
  }

  /** Return the corners of a face, m. */
  corners(face) {
    return [0, 1, 2].map((corner) => this.vertex(this.faces[3 * face + corner]));
  }

  /** Return the outward unit normal of a face. */
  normal(face) {
    const [a, b, c] = this.corners(face);
    const across = cross(subtract(b, a), subtract(c, a));
    const size = length(across) || 1;
    return across.map((each) => each / size);
  }

  /** Return the outward unit normal at a place, smooth but for sharp edges, as Python's Mesh. */
  normalAt({ face, weights }) {
    const own = this.normal(face);
    const corners = [0, 1, 2].map((corner) => this.#cornerNormal(3 * face + corner, own));
    const apart = corners.map((each) => Math.max(...subtract(each, own).map(Math.abs)));
    if (Math.max(...apart) <= FLAT) return own;
    const sum = own.map((_, k) => corners.reduce((all, each, c) => all + weights[c] * each[k], 0));
    return sum.map((each) => each / (length(sum) || 1));
  }

  /** Return the unit normal at a corner, by Max's weights over faces that turn little from `own`. */
  #cornerNormal(corner, own) {
    const vertex = this.faces[corner];
    const sum = [0, 0, 0];
    for (let side = 0; side < this.faces.length; side++) {
      if (this.faces[side] !== vertex) continue;
      const face = Math.floor(side / 3);
      const turned = this.normal(face).reduce((all, each, k) => all + each * own[k], 0);
      if (turned <= SMOOTH) continue;
      const ends = [1, 2].map((step) => this.vertex(this.faces[3 * face + ((side + step) % 3)]));
      const [to, back] = ends.map((end) => subtract(end, this.vertex(vertex)));
      const share = (length(to) * length(back)) ** 2 || 1;
      cross(to, back).forEach((each, k) => (sum[k] += each / share));
    }
    return sum.map((each) => each / (length(sum) || 1));
  }

  /** Longest edge of the box around it, m. */
  get extent() {
    const low = [Infinity, Infinity, Infinity];
    const high = [-Infinity, -Infinity, -Infinity];
    for (let k = 0; k < this.vertices.length; k++) {
      low[k % 3] = Math.min(low[k % 3], this.vertices[k]);
      high[k % 3] = Math.max(high[k % 3], this.vertices[k]);
    }
    return Math.max(...subtract(high, low));
  }

  #longestEdge = 0;

  /** Longest edge of all faces, m; kept, once found. */
  get longestEdge() {
    this.#longestEdge ||= this.#longest();
    return this.#longestEdge;
  }

  #longest() {
    let longest = 0;
    for (let side = 0; side < this.faces.length; side++) {
      const next = side % 3 === 2 ? side - 2 : side + 1;
      const end = this.vertex(this.faces[next]);
      longest = Math.max(longest, this.#distanceTo(this.faces[side], end));
    }
    return longest;
  }

  /** Return the radius of the ball about a point that holds it, m. */
  radiusAbout(centre) {
    let square = 0;
    for (let k = 0; k < this.vertices.length; k += 3) {
      const x = this.vertices[k] - centre[0];
      const y = this.vertices[k + 1] - centre[1];
      const z = this.vertices[k + 2] - centre[2];
      square = Math.max(square, x * x + y * y + z * z);
    }
    return Math.sqrt(square);
  }

  /**
   * Return the point of the surface nearest to a place; of one face alone where that is known.
   * @param {number[]} point m
   * @param {number} [face] the face that a ray has met
   * @returns {Place}
   */
  nearest(point, face) {
    if (face === undefined || face === null) return this.#nearestOfAll(point);
    const corners = this.corners(face);
    const weights = barycentric(corners, point);
    const found = combined(corners, weights);
    return { face, weights, point: found, distance: length(subtract(found, point)) };
  }

  #distanceTo(vertex, point) {
    const x = this.vertices[3 * vertex] - point[0];
    const y = this.vertices[3 * vertex + 1] - point[1];
    const z = this.vertices[3 * vertex + 2] - point[2];
    return Math.sqrt(x * x + y * y + z * z);
  }

  #nearestOfAll(point) {
    let best = { square: Infinity, face: 0, point: /** @type {number[]} */ ([]) };
    const reach = this.longestEdge;
    for (let face = 0; face < this.faces.length / 3; face++) {
      // No point of a face is farther from a corner than its longest edge.
      if (this.#distanceTo(this.faces[3 * face], point) - reach > Math.sqrt(best.square)) continue;
      const corners = this.corners(face);
      const found = nearestOfTriangle(corners, point);
      const apart = subtract(found, point);
      const square = dot(apart, apart);
      if (square < best.square) best = { square, face, point: found };
    }
    const weights = barycentric(this.corners(best.face), best.point);
    return { face: best.face, weights, point: best.point, distance: Math.sqrt(best.square) };
  }
}

function combined(corners, weights) {
  return [0, 1, 2].map(
    (axis) =>
      weights[0] * corners[0][axis] + weights[1] * corners[1][axis] + weights[2] * corners[2][axis],
  );
}

/** Return the weights of the corners of a triangle that make a point in its plane, none below 0. */
export function barycentric(corners, point) {
  const [a, b, c] = corners;
  const first = subtract(b, a);
  const second = subtract(c, a);
  const offset = subtract(point, a);
  const [uu, uv, vv] = [dot(first, first), dot(first, second), dot(second, second)];
  const [ou, ov] = [dot(offset, first), dot(offset, second)];
  const area = Math.max(uu * vv - uv * uv, TINY);
  const along = Math.min(Math.max((vv * ou - uv * ov) / area, 0), 1);
  const across = Math.min(Math.max((uu * ov - uv * ou) / area, 0), 1 - along);
  return [1 - along - across, along, across];
}

/**
 * Return the point of a triangle nearest to a place, by the region that the place lies in
 * (Ericson, "Real-Time Collision Detection", 2005, section 5.1.5).
 */
function nearestOfTriangle(corners, point) {
  const [a, b, c] = corners;
  const ab = subtract(b, a);
  const ac = subtract(c, a);
  const ap = subtract(point, a);
  const [d1, d2] = [dot(ab, ap), dot(ac, ap)];
  if (d1 <= 0 && d2 <= 0) return a;
  const bp = subtract(point, b);
  const [d3, d4] = [dot(ab, bp), dot(ac, bp)];
  if (d3 >= 0 && d4 <= d3) return b;
  const vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return along(a, ab, d1 / (d1 - d3));
  const cp = subtract(point, c);
  const [d5, d6] = [dot(ab, cp), dot(ac, cp)];
  if (d6 >= 0 && d5 <= d6) return c;
  const vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return along(a, ac, d2 / (d2 - d6));
  const va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0)
    return along(b, subtract(c, b), (d4 - d3) / (d4 - d3 + (d5 - d6)));
  const scale = 1 / (va + vb + vc);
  return along(along(a, ab, vb * scale), ac, vc * scale);
}

const along = (from, way, share) => from.map((each, axis) => each + share * way[axis]);
