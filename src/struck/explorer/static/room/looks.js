/** How materials look: colour, gloss and metal of what a body is made of. */

import * as THREE from 'three';

const METAL = { metalness: 1, roughness: 0.28 };
const WOOD = { metalness: 0, roughness: 0.62 };

/** By name of `struck materials`; all others by their group. */
const LOOKS = {
  bronze: { ...METAL, color: 0xb07a3c, roughness: 0.3 },
  brass: { ...METAL, color: 0xd1a84b },
  copper: { ...METAL, color: 0xc07048 },
  steel: { ...METAL, color: 0xa9b0b6 },
  'stainless steel': { ...METAL, color: 0xbec4c8, roughness: 0.2 },
  'music wire': { ...METAL, color: 0x8f979d },
  aluminium: { ...METAL, color: 0xd4d8da, roughness: 0.34 },
  gold: { ...METAL, color: 0xe3b23c, roughness: 0.2 },
  silver: { ...METAL, color: 0xe6e6e3, roughness: 0.16 },
  lead: { ...METAL, color: 0x6e737a, roughness: 0.55 },
  iron: { ...METAL, color: 0x5c6166, roughness: 0.5 },
  'cast iron': { ...METAL, color: 0x4b4f53, roughness: 0.65 },
  oak: { ...WOOD, color: 0xb98a55 },
  spruce: { ...WOOD, color: 0xdcb983 },
  maple: { ...WOOD, color: 0xd2a574 },
  rosewood: { ...WOOD, color: 0x6b3a2a },
  beech: { ...WOOD, color: 0xc99b6c },
  ebony: { ...WOOD, color: 0x33291f },
  'polyester film': { metalness: 0, roughness: 0.45, color: 0xfffaf0, emissive: 0x2a2822 },
};
const GROUPS = {
  metal: { ...METAL, color: 0xaab0b4 },
  wood: { ...WOOD, color: 0xb98d5e },
  glass: { metalness: 0, roughness: 0.05, color: 0xa9d3cf, opacity: 0.62, transparent: true },
  ceramic: { metalness: 0, roughness: 0.22, color: 0xf4f1ea },
  stone: { metalness: 0, roughness: 0.85, color: 0x9a958c },
  plastic: { metalness: 0, roughness: 0.4, color: 0x5b8fb0 },
  other: { metalness: 0, roughness: 0.6, color: 0xd8c8ac },
};

let simple = false;

/** Draw surfaces made from now on without reflections, or with them. */
export function plain(wanted) {
  simple = wanted;
}

/** Adjust a surface to whether there are reflections: a metal without them would be black. */
export function adjust(surface) {
  const { metalness } = surface.userData;
  if (metalness === undefined) return;
  surface.metalness = simple ? 0.25 * metalness : metalness;
  surface.needsUpdate = true;
}

/**
 * Return the surface of a material.
 * @param {{name: string, group: string} | null} material
 * @returns {THREE.MeshStandardMaterial}
 */
export function surfaceOf(material) {
  const look = LOOKS[material?.name] ?? GROUPS[material?.group] ?? GROUPS.other;
  const userData = { glow: look.emissive ?? 0, metalness: look.metalness };
  const surface = new THREE.MeshStandardMaterial({ ...look, side: THREE.DoubleSide, envMapIntensity: 0.9, userData });
  adjust(surface);
  return surface;
}

/** Return the surfaces of a record: its label and its grooves. */
export function recordSurfaces() {
  return [
    { color: 0xb4541f, roughness: 0.7 },
    { color: 0x2b3238, roughness: 0.35 },
  ].map((look) => new THREE.MeshStandardMaterial({ ...look, metalness: 0, side: THREE.DoubleSide }));
}

/** The surface of a body that shows a mode, coloured at its vertices. */
export function modeSurface() {
  return new THREE.MeshStandardMaterial({
    vertexColors: true, roughness: 0.6, metalness: 0, side: THREE.DoubleSide, envMapIntensity: 0.45,
  });
}

const INWARD = new THREE.Color(0x1c6ea4);
const STILL = new THREE.Color(0xf6f1e7);
const OUTWARD = new THREE.Color(0xd9531e);

/** Return the colour of a displacement between -1, inward, and 1, outward, into `target`. */
export function displacementColour(share, target) {
  const strength = Math.min(1, Math.abs(share)) ** 0.65;
  return target.copy(STILL).lerp(share < 0 ? INWARD : OUTWARD, strength);
}
