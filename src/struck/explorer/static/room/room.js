/** The room as a person sees it: bodies, what they stand on, numbers, marks and moving modes. */

import * as THREE from 'three';
import { holderOf } from './furniture.js';
import { Solid } from './solid.js';
import { Stage, still } from './stage.js';
import { Touch } from './touch.js';
import { say } from '../panel/messages.js';

const APART = 24; // pixels between two numbers
const MARKED = 1.2; // s until the ring around a struck point has gone
const NO_PICTURE = 'this browser shows no WebGL, so there is no picture: choose objects in the list and strike them by keys. Another browser, or its setting for hardware acceleration, may bring it back';

export class Room {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {HTMLElement} labels where numbers of points are put
   * @param {object} actions what `Touch` does
   */
  constructor(canvas, labels, actions) {
    this.labels = labels;
    this.solids = new Map();
    this.points = [];
    this.onMoved = () => {};
    try {
      this.stage = new Stage(canvas);
    } catch {
      say(NO_PICTURE, { bad: true });
      this.stage = null;
      return;
    }
    this.touch = new Touch(this.stage, this.solids, actions);
    this.stage.onMoved = () => {
      this.#place();
      this.onMoved(this.stage.head());
    };
    this.#marks();
  }

  /** Whether nothing shall move by itself. */
  get still() {
    return still.matches;
  }

  /** Put an object into the room. */
  add(told, model) {
    if (!this.stage) return;
    const surface = model.vertices && model.faces ? { vertices: model.vertices, faces: model.faces } : null;
    const solid = new Solid(told, surface);
    this.solids.set(told.id, solid);
    const group = new THREE.Group();
    group.add(solid.group, holderOf(told, solid.box()));
    this.#enclose();
    if (told.kind === 'file' && !this.stage.visited) this.stage.home();
    this.stage.add(group);
  }

  /** Let the camera, the light and the wall follow the bodies that are there. */
  #enclose() {
    const solids = [...this.solids.values()];
    const boxes = solids.map((solid) => solid.box());
    const own = solids.some(({ told }) => told.kind === 'file');
    this.stage.enclose(boxes, own);
  }

  /** Show an object of another size or material. */
  change(id, { size, material }) {
    const solid = this.solids.get(id);
    if (!solid) return;
    solid.resize(size);
    solid.wear(material);
    this.#enclose();
    this.stage.moved = true;
    this.stage.refresh();
  }

  /** Come near an object. */
  approach(id) {
    if (this.solids.has(id)) this.stage.approach(this.solids.get(id).box());
  }

  home() {
    this.stage?.home();
  }

  zoom(factor) {
    this.stage?.zoom(factor);
  }

  // Modes

  /** Show a mode of an object in motion, and no other's; null: none. */
  showMode(id, shown) {
    const solid = this.solids.get(id);
    if (!solid) return;
    this.stop?.();
    this.labels.hidden = Boolean(shown); // they would stay where the body is no more
    if (!shown) {
      solid.rests();
      this.stage.refresh();
      return;
    }
    solid.show(shown.mode, shown.shape);
    this.stage.refresh();
    if (still.matches) return;
    let begun = null;
    this.stop = this.stage.tick((time) => {
      begun ??= time;
      solid.swing(Math.cos((2 * Math.PI * (time - begun)) / shown.cycle));
      return solid.mode === shown.mode;
    });
  }

  // Numbers of points, and marks of blows

  /** Number the points of an object that keys strike; it stands out from the others. */
  number(id, points) {
    if (!this.stage) return;
    for (const [each, solid] of this.solids) solid.stand(each === id);
    this.points = points.filter(({ point }) => point).map(({ point, name }, at) => {
      const label = document.createElement('span');
      label.textContent = (at + 1) % 10;
      label.title = name;
      return { id, point, label };
    });
    this.labels.replaceChildren(...this.points.map(({ label }) => label));
    this.#place();
  }

  /** Put the numbers where their points are; where these stand too close, only the first of them. */
  #place() {
    const taken = [];
    for (const { id, point, label } of this.points) {
      const { x, y, front } = this.stage.project(this.solids.get(id).inRoom(point));
      label.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -50%)`;
      label.hidden = !front || taken.some((other) => Math.hypot(x - other.x, y - other.y) < APART);
      if (!label.hidden) taken.push({ x, y });
    }
  }

  #marks() {
    const ring = new THREE.Mesh(
      new THREE.RingGeometry(0.72, 1, 48),
      new THREE.MeshBasicMaterial({ color: 0xe5601d, transparent: true, depthTest: false, side: THREE.DoubleSide }),
    );
    const dot = new THREE.Mesh(new THREE.CircleGeometry(0.3, 32), ring.material.clone());
    this.ring = ring;
    this.dot = dot;
    for (const mesh of [ring, dot]) {
      mesh.visible = false;
      mesh.renderOrder = 5;
      this.stage.scene.add(mesh);
    }
  }

  /** Mark where an object was struck: a dot that stays, and a ring that spreads. */
  mark(id, point) {
    const solid = this.solids.get(id);
    if (!solid) return;
    const at = solid.inRoom(solid.spot ?? point);
    this.marked = at.clone();
    const size = 0.012 * Math.max(0.35, at.distanceTo(this.stage.camera.position) / 3);
    for (const mesh of [this.dot, this.ring]) {
      mesh.visible = true;
      mesh.position.copy(at);
      mesh.quaternion.copy(this.stage.camera.quaternion);
      mesh.scale.setScalar(size);
    }
    this.ring.material.opacity = 1;
    this.stage.invalidate();
    if (still.matches) return;
    let begun = null;
    this.stopMark?.();
    this.stopMark = this.stage.tick((time) => {
      begun ??= time;
      const share = Math.min(1, (time - begun) / MARKED);
      this.ring.scale.setScalar(size * (1 + 4 * share ** 0.6));
      this.ring.material.opacity = (1 - share) ** 1.5;
      this.ring.visible = share < 1;
      return share < 1;
    });
  }
}
