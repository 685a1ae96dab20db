/** What stands in the room and does not sound: floor, wall, plinth, frames and cords. */

import * as THREE from 'three';

const PLASTER = { color: 0xd9d2c5, roughness: 0.95 };
const PAINT = { color: 0xf4f0e8, roughness: 0.8 };
const DARK = { color: 0x4a3627, roughness: 0.6 };
const FELT = { color: 0x7d2f2f, roughness: 1 };
const CORD = { color: 0x3d3a36, roughness: 1 };

function solid(geometry, look) {
  const mesh = new THREE.Mesh(geometry, new THREE.MeshStandardMaterial({ ...look, envMapIntensity: 0.55 }));
  mesh.castShadow = true;
  mesh.receiveShadow = true;
  return mesh;
}

/** Return a box between two corners, m. */
function box(low, high, look) {
  const size = high.map((value, k) => value - low[k]);
  const mesh = solid(new THREE.BoxGeometry(...size), look);
  mesh.position.set(...low.map((value, k) => value + size[k] / 2));
  return mesh;
}

/** Return a round rod between two points, m. */
function rod(from, to, radius, look) {
  const [a, b] = [new THREE.Vector3(...from), new THREE.Vector3(...to)];
  const mesh = solid(new THREE.CylinderGeometry(radius, radius, a.distanceTo(b), 20), look);
  mesh.position.copy(a).add(b).multiplyScalar(0.5);
  mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), b.sub(a).normalize());
  return mesh;
}

/**
 * Return floor and wall as one sheet that bends up behind the objects.
 * @param {{wall: number, front: number, side: number, top: number}} size m: where the wall is, how
 *   far the floor reaches to the front and to each side, and how high the wall is
 */
export function backdrop({ wall, front, side, top }) {
  const bend = 0.5;
  const profile = [new THREE.Vector2(-front, 0), new THREE.Vector2(wall - bend, 0)];
  for (let step = 1; step <= 24; step += 1) {
    const angle = (step / 24) * (Math.PI / 2);
    profile.push(new THREE.Vector2(wall - bend + bend * Math.sin(angle), bend - bend * Math.cos(angle)));
  }
  profile.push(new THREE.Vector2(wall, top));
  const points = [];
  const faces = [];
  profile.forEach(({ x: y, y: z }, row) => {
    points.push(-side, y, z, side, y, z);
    if (row) faces.push(2 * row - 2, 2 * row - 1, 2 * row, 2 * row - 1, 2 * row + 1, 2 * row);
  });
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.Float32BufferAttribute(points, 3));
  geometry.setIndex(faces);
  geometry.computeVertexNormals();
  const sheet = solid(geometry, { ...PLASTER, side: THREE.DoubleSide });
  sheet.castShadow = false;
  return sheet;
}

/** Return a frame of four bars around a rectangle on the wall, m. */
function frame(left, right, low, high, y) {
  const [wide, deep] = [0.018, 0.035];
  return [
    box([left - wide, y - 0.008, low - wide], [right + wide, y + deep, low], DARK),
    box([left - wide, y - 0.008, high], [right + wide, y + deep, high + wide], DARK),
    box([left - wide, y - 0.008, low], [left, y + deep, high], DARK),
    box([right, y - 0.008, low], [right + wide, y + deep, high], DARK),
  ];
}

/** By object: what it stands on or hangs from. */
const HOLDERS = {
  square: () => frame(-1.85, -1.45, 0.92, 1.32, 1.26),
  l_membrane: () => outline([[0, 0], [0.4, 0], [0.4, 0.2], [0.2, 0.2], [0.2, 0.4], [0, 0.4]], [-1.28, 1.26, 0.92]),
  plate: () => [
    rod([-0.62, 1.262, 1.268], [-0.5, 1.27, 1.42], 0.0015, CORD),
    rod([-0.38, 1.262, 1.268], [-0.5, 1.27, 1.42], 0.0015, CORD),
    rod([-0.5, 1.23, 1.42], [-0.5, 1.4, 1.42], 0.006, DARK),
  ],
  string: () => [
    box([0.62, -0.2, 0], [1.42, 0.25, 0.6], PAINT),
    box([0.66, 0.135, 0.6], [1.38, 0.205, 0.63], DARK),
    box([0.683, 0.14, 0.63], [0.695, 0.2, 0.668], DARK),
    box([1.345, 0.14, 0.63], [1.357, 0.2, 0.668], DARK),
  ],
  bar: () => [0.91, 1.13].map((x) => box([x - 0.006, 0.002, 0.6], [x + 0.006, 0.058, 0.63], FELT)),
  rod: () => [0.91, 1.13].map((x) => box([x - 0.006, -0.115, 0.6], [x + 0.006, -0.085, 0.63], FELT)),
  chime_1: () => [
    rod([0.24, 0.85, 1.64], [0.95, 0.85, 1.64], 0.013, DARK),
    rod([0.26, 0.85, 0], [0.26, 0.85, 1.64], 0.012, DARK),
    rod([0.93, 0.85, 0], [0.93, 0.85, 1.64], 0.012, DARK),
    box([0.2, 0.7, 0], [0.32, 1.0, 0.02], DARK),
    box([0.87, 0.7, 0], [0.99, 1.0, 0.02], DARK),
    ...[0, 1, 2, 3, 4, 5].map((n) => rod([0.32 + 0.11 * n, 0.85, 1.545], [0.32 + 0.11 * n, 0.85, 1.64], 0.0015, CORD)),
  ],
  bell: () => [
    rod([1.62, 0.75, 1.175], [1.62, 0.75, 1.4], 0.004, CORD),
    rod([1.58, 0.75, 1.4], [1.93, 0.75, 1.4], 0.013, DARK),
    rod([1.91, 0.75, 0], [1.91, 0.75, 1.4], 0.014, DARK),
    box([1.76, 0.63, 0], [1.98, 0.87, 0.02], DARK),
  ],
  tabla: () => {
    const stool = solid(new THREE.CylinderGeometry(0.15, 0.16, 0.5, 48), PAINT);
    stool.rotation.x = Math.PI / 2;
    stool.position.set(1.75, 0.02, 0.25);
    return [stool];
  },
};

/** Return thin bars along the edges of a polygon on the wall, its corner at `origin`, m. */
function outline(corners, [x, y, z]) {
  return corners.map(([a, b], at) => {
    const [c, d] = corners[(at + 1) % corners.length];
    const low = [x + Math.min(a, c) - 0.009, y - 0.008, z + Math.min(b, d) - 0.009];
    const high = [x + Math.max(a, c) + 0.009, y + 0.035, z + Math.max(b, d) + 0.009];
    return box(low, high, DARK);
  });
}

/**
 * Return what an object of the room stands on or hangs from; a given one stands on a plinth.
 * @param {object} told what the server tells of the object
 * @param {THREE.Box3} around the box around it in the room
 */
export function holderOf(told, around) {
  const group = new THREE.Group();
  if (HOLDERS[told.id]) group.add(...HOLDERS[told.id]());
  if (told.kind === 'file') {
    const middle = around.getCenter(new THREE.Vector3());
    const size = around.getSize(new THREE.Vector3());
    const [width, depth] = [size.x, size.y].map((edge) => Math.max(0.08, edge / 2 + 0.04));
    const low = [middle.x - width, middle.y - depth, 0];
    group.add(box(low, [middle.x + width, middle.y + depth, around.min.z], PAINT));
  }
  return group;
}
