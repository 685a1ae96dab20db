/** A body as the room shows it: its surface, one of its modes in motion, and what was struck. */

import * as THREE from 'three';
import { displacementColour, modeSurface, recordSurfaces, surfaceOf } from './looks.js';

const CREASE = Math.cos((38 * Math.PI) / 180); // sharper edges stay edges
const MANY_FACES = 300_000; // beyond them, corners share their normals
const WITHIN = 0.35; // share of the motion that is outward, below which a surface moves within itself
const SWING = 0.07; // largest displacement shown, of the body's longest edge

/**
 * Return the unit normals at the corners of faces, smooth but where the surface has an edge.
 * @param {Float32Array} points (V, 3)
 * @param {Uint32Array} faces (F, 3)
 * @returns {Float32Array} (F, 3, 3)
 */
export function cornerNormals(points, faces) {
  const count = faces.length / 3;
  const flat = new Float32Array(faces.length);
  const sums = new Float32Array(points.length);
  for (let face = 0; face < count; face += 1) {
    const [a, b, c] = [0, 1, 2].map((k) => 3 * faces[3 * face + k]);
    const [ux, uy, uz] = [0, 1, 2].map((k) => points[b + k] - points[a + k]);
    const [vx, vy, vz] = [0, 1, 2].map((k) => points[c + k] - points[a + k]);
    const normal = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    for (let k = 0; k < 3; k += 1) {
      flat[3 * face + k] = normal[k];
      for (const corner of [a, b, c]) sums[corner + k] += normal[k];
    }
  }
  const normals = new Float32Array(3 * faces.length);
  if (count > MANY_FACES) {
    for (let i = 0; i < faces.length; i += 1) place(normals, 3 * i, sums, 3 * faces[i]);
    return normals;
  }
  const around = facesAround(points.length / 3, faces);
  const sum = new Float32Array(3);
  for (let face = 0; face < count; face += 1) {
    for (let k = 0; k < 3; k += 1) {
      sum.fill(0);
      const vertex = faces[3 * face + k];
      for (let at = around.starts[vertex]; at < around.starts[vertex + 1]; at += 1) {
        const other = around.faces[at];
        if (cosine(flat, 3 * face, 3 * other) < CREASE) continue;
        for (let axis = 0; axis < 3; axis += 1) sum[axis] += flat[3 * other + axis];
      }
      place(normals, 3 * (3 * face + k), sum, 0);
    }
  }
  return normals;
}

function place(target, to, source, from) {
  const length = Math.hypot(source[from], source[from + 1], source[from + 2]) || 1;
  for (let k = 0; k < 3; k += 1) target[to + k] = source[from + k] / length;
}

function cosine(vectors, a, b) {
  let product = 0;
  let first = 0;
  let second = 0;
  for (let k = 0; k < 3; k += 1) {
    product += vectors[a + k] * vectors[b + k];
    first += vectors[a + k] ** 2;
    second += vectors[b + k] ** 2;
  }
  return product / (Math.sqrt(first * second) || 1);
}

function facesAround(vertices, faces) {
  const starts = new Uint32Array(vertices + 1);
  for (const vertex of faces) starts[vertex + 1] += 1;
  for (let i = 0; i < vertices; i += 1) starts[i + 1] += starts[i];
  const next = starts.slice();
  const list = new Uint32Array(faces.length);
  faces.forEach((vertex, at) => { list[next[vertex]++] = Math.floor(at / 3); });
  return { starts, faces: list };
}

/** A body in the room. Its three.js object's own coordinates are the body's, in m. */
export class Solid {
  /**
   * @param {object} told what the server tells of the object
   * @param {{vertices: Float64Array, faces: Uint32Array} | null} surface null: a recording, drawn
   *   as a drum or as a token
   */
  constructor(told, surface) {
    this.told = told;
    if (surface) this.mesh = new THREE.Mesh(this.#geometry(surface), surfaceOf(told.facts.material));
    else {
      const { geometry, surfaces, spot } = told.figure === 'drum' ? drum() : token();
      this.mesh = new THREE.Mesh(geometry, surfaces);
      this.spot = spot; // where a blow is shown
    }
    this.mesh.castShadow = true;
    this.mesh.receiveShadow = true;
    this.mesh.userData.id = told.id;
    this.group = new THREE.Group();
    const [x, y, z] = told.rotation;
    this.group.matrixAutoUpdate = false;
    this.group.matrix.set(...x, told.position[0], ...y, told.position[1], ...z, told.position[2], 0, 0, 0, 1);
    this.mesh.scale.set(...told.swelling);
    this.group.add(this.mesh);
    this.group.updateMatrixWorld(true);
    this.mode = null;
    this.size = 1;
  }

  #geometry({ vertices, faces }) {
    this.faces = faces;
    this.rest = new Float32Array(3 * faces.length); // a corner of a face has its own row
    const points = Float32Array.from(vertices);
    for (let i = 0; i < faces.length; i += 1) this.rest.set(points.subarray(3 * faces[i], 3 * faces[i] + 3), 3 * i);
    this.normals = cornerNormals(points, faces);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(this.rest.slice(), 3));
    geometry.setAttribute('normal', new THREE.BufferAttribute(this.normals.slice(), 3));
    geometry.computeBoundingBox();
    geometry.computeBoundingSphere();
    this.extent = Math.max(...geometry.boundingBox.getSize(new THREE.Vector3()).toArray());
    return geometry;
  }

  /** Show it `size` times as large, standing where it stood. */
  resize(size) {
    this.size = size;
    this.mesh.scale.set(...this.told.swelling.map((times) => times * size));
    const low = this.mesh.geometry.boundingBox ?? new THREE.Box3();
    const hung = this.told.hangs ?? false;
    const base = new THREE.Vector3((low.min.x + low.max.x) / 2, (low.min.y + low.max.y) / 2, hung ? low.max.z : low.min.z);
    this.mesh.position.copy(base).multiply(new THREE.Vector3(...this.told.swelling)).multiplyScalar(1 - size);
    this.group.updateMatrixWorld(true);
  }

  /** Stand out from the others, or not. */
  stand(out) {
    this.out = out;
    const own = this.mode === null ? this.mesh.material : this.worn;
    for (const surface of [own].flat()) surface.emissive.setHex(out ? 0x16384a : (surface.userData.glow ?? 0));
  }

  /** Look as another material does. */
  wear(material) {
    if (Array.isArray(this.mesh.material)) return;
    const worn = surfaceOf(material);
    if (this.mode === null) {
      this.mesh.material.dispose();
      this.mesh.material = worn;
    } else {
      this.worn?.dispose();
      this.worn = worn;
    }
    this.stand(this.out);
  }

  /**
   * Show a mode in place of the material.
   * @param {number} mode
   * @param {Float32Array} shape displacements at the vertices (V, 3), in any unit
   */
  show(mode, shape) {
    if (!this.faces) return;
    if (this.mode === null) {
      this.worn = this.mesh.material;
      this.mesh.material = modeSurface(); // without any glow: its colours tell
    }
    this.mode = mode;
    this.#displace(shape);
    this.swing(1);
  }

  /** Return the axis along which a body moves whose surface moves within itself; else null. */
  #mainAxis(shape) {
    const energy = [0, 0, 0];
    let outward = 0;
    for (let i = 0; i < this.faces.length; i += 1) {
      let along = 0;
      for (let k = 0; k < 3; k += 1) {
        const displaced = shape[3 * this.faces[i] + k];
        energy[k] += displaced ** 2;
        along += displaced * this.normals[3 * i + k];
      }
      outward += along ** 2;
    }
    const whole = energy[0] + energy[1] + energy[2];
    if (outward > WITHIN * whole) return null;
    const most = energy.indexOf(Math.max(...energy));
    return [0, 1, 2].map((k) => Number(k === most));
  }

  #displace(shape) {
    let largest = 0;
    for (let i = 0; i < shape.length; i += 3) largest = Math.max(largest, Math.hypot(shape[i], shape[i + 1], shape[i + 2]));
    const axis = this.#mainAxis(shape);
    this.swingScale = largest ? (SWING * this.extent) / largest : 0;
    const { swelling } = this.told;
    this.moved = new Float32Array(this.rest.length);
    const points = new Float32Array(shape.length);
    const colours = new Float32Array(this.rest.length);
    const colour = new THREE.Color();
    for (let i = 0; i < this.faces.length; i += 1) {
      const vertex = 3 * this.faces[i];
      let outward = 0;
      for (let k = 0; k < 3; k += 1) {
        const displaced = (shape[vertex + k] * this.swingScale) / swelling[k];
        this.moved[3 * i + k] = displaced;
        points[vertex + k] = this.rest[3 * i + k] + displaced;
        outward += (axis?.[k] ?? this.normals[3 * i + k]) * shape[vertex + k];
      }
      displacementColour(outward / largest, colour).toArray(colours, 3 * i);
    }
    this.bent = cornerNormals(points, this.faces);
    this.mesh.geometry.setAttribute('color', new THREE.BufferAttribute(colours, 3));
  }

  /** Displace the mode that is shown by a share of its swing, from -1 to 1. */
  swing(share) {
    const position = this.mesh.geometry.attributes.position;
    const normal = this.mesh.geometry.attributes.normal;
    for (let i = 0; i < this.rest.length; i += 1) {
      position.array[i] = this.rest[i] + share * this.moved[i];
      normal.array[i] = this.normals[i] + share * (this.bent[i] - this.normals[i]);
    }
    position.needsUpdate = true;
    normal.needsUpdate = true;
  }

  /** Stand still, and look like its material again. */
  rests() {
    if (this.mode === null) return;
    this.mode = null;
    this.mesh.geometry.attributes.position.array.set(this.rest);
    this.mesh.geometry.attributes.normal.array.set(this.normals);
    this.mesh.geometry.attributes.position.needsUpdate = true;
    this.mesh.geometry.attributes.normal.needsUpdate = true;
    this.mesh.geometry.deleteAttribute('color');
    this.mesh.material.dispose();
    this.mesh.material = this.worn;
    this.stand(this.out);
  }

  /** Return where a point of a face is while no mode is shown, m in the body's own coordinates. */
  atRest(face, point) {
    if (this.mode === null || !this.faces) return point.toArray();
    const corner = (array, k) => new THREE.Vector3().fromArray(array, 9 * face + 3 * k);
    const shown = [0, 1, 2].map((k) => corner(this.mesh.geometry.attributes.position.array, k));
    const weights = THREE.Triangle.getBarycoord(point, ...shown, new THREE.Vector3());
    if (!weights) return corner(this.rest, 0).toArray();
    const rest = new THREE.Vector3();
    weights.toArray().forEach((weight, k) => rest.addScaledVector(corner(this.rest, k), weight));
    return rest.toArray();
  }

  /** Return a point of the body, m in its own coordinates, in the room. */
  inRoom(point) {
    return this.mesh.localToWorld(new THREE.Vector3(...point));
  }

  /** Return the box around it in the room. */
  box() {
    return new THREE.Box3().setFromObject(this.mesh);
  }
}

/** Return a body of revolution about y of a profile (r, y), of two parts: rows up to `last`, and the rest. */
function lathe(profile, last) {
  const geometry = new THREE.LatheGeometry(profile.map(([r, y]) => new THREE.Vector2(r, y)), 64);
  geometry.clearGroups();
  const index = [...geometry.index.array];
  const [first, rest] = [[], []];
  for (let at = 0; at < index.length; at += 3) {
    const within = [0, 1, 2].every((k) => index[at + k] % profile.length <= last);
    (within ? first : rest).push(...index.slice(at, at + 3));
  }
  geometry.setIndex([...first, ...rest]);
  geometry.addGroup(0, first.length, 0);
  geometry.addGroup(first.length, rest.length, 1);
  return geometry;
}

function finished(geometry) {
  geometry.computeVertexNormals();
  geometry.computeBoundingBox();
  return geometry;
}

/** Return a small drum, for one that was recorded. */
function drum() {
  const profile = [[0, 0], [0.07, 0], [0.098, 0.035], [0.104, 0.08], [0.094, 0.15], [0.088, 0.162], [0, 0.162]];
  const geometry = finished(lathe(profile, profile.length - 2).rotateX(Math.PI / 2));
  const surfaces = [surfaceOf({ name: 'rosewood', group: 'wood' }), surfaceOf({ name: 'polyester film', group: 'plastic' })];
  return { geometry, surfaces, spot: [0, 0, 0.162] };
}

/** Return a record that stands upright, for what was recorded and has no shape. */
function token() {
  const profile = [[0, -0.008], [0.03, -0.008], [0.032, -0.006], [0.08, -0.006], [0.08, 0.006], [0, 0.006]];
  const geometry = finished(lathe(profile, 1).translate(0, 0, 0.08));
  return { geometry, surfaces: recordSurfaces(), spot: [0, -0.008, 0.08] };
}
