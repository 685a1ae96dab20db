/** Pointers on the picture: which body is under a pixel, and whether it is tapped or held. */

import * as THREE from 'three';

const HELD = 280; // ms after which a press is a hand that stays
const NEAR = [7, 14]; // pixels around a pixel that also count: thin bodies are hard to hit

export class Touch {
  /**
   * @param {import('./stage.js').Stage} stage
   * @param {Map<string, import('./solid.js').Solid>} solids by object
   * @param {{strike: Function, hold: Function, release: Function}} actions
   */
  constructor(stage, solids, actions) {
    this.stage = stage;
    this.solids = solids;
    this.actions = actions;
    this.ray = new THREE.Raycaster();
    const { canvas } = stage;
    canvas.addEventListener('pointerdown', (event) => this.#down(event), { capture: true });
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture']) {
      canvas.addEventListener(name, (event) => this.#up(event), { capture: true });
    }
    canvas.addEventListener('pointermove', (event) => this.#move(event));
    this.presses = new Map();
  }

  /**
   * Return the surface point under a pixel of the canvas, or by it.
   * @returns {{id: string, face: number, point: number[]} | null} in the body's own coordinates
   */
  at(x, y) {
    const found = this.#cast(x, y) ?? this.#tiny(x, y);
    if (found) return found;
    for (const radius of NEAR) {
      for (let turn = 0; turn < 8; turn += 1) {
        const angle = (turn * Math.PI) / 4;
        const near = this.#cast(x + radius * Math.cos(angle), y + radius * Math.sin(angle));
        if (near) return near;
      }
    }
    return null;
  }

  /** Return the middle of a body by a pixel that is so small that the rays around it pass it by. */
  #tiny(x, y) {
    const { camera, canvas } = this.stage;
    const most = NEAR.at(-1);
    const scale = canvas.clientHeight / (2 * Math.tan(THREE.MathUtils.degToRad(camera.fov / 2)));
    const bodies = [...this.solids.values()].map((solid) => {
      const box = solid.box();
      const middle = box.getCenter(new THREE.Vector3());
      const size = (scale * box.getSize(new THREE.Vector3()).length()) / middle.distanceTo(camera.position);
      const pixel = this.stage.project(middle);
      return { id: solid.told.id, size, pixel, away: Math.hypot(pixel.x - x, pixel.y - y) };
    });
    const near = bodies.filter(({ size, pixel, away }) => size < most && pixel.front && away < most);
    for (const { id, pixel } of near.sort((one, other) => one.away - other.away)) {
      const hit = this.#cast(pixel.x, pixel.y);
      if (hit?.id === id) return hit;
    }
    return null;
  }

  #cast(x, y) {
    const { clientWidth, clientHeight } = this.stage.canvas;
    const pixel = new THREE.Vector2((x / clientWidth) * 2 - 1, 1 - (y / clientHeight) * 2);
    this.ray.setFromCamera(pixel, this.stage.camera);
    const meshes = [...this.solids.values()].map((solid) => solid.mesh);
    const [hit] = this.ray.intersectObjects(meshes, false);
    if (!hit) return null;
    const solid = this.solids.get(hit.object.userData.id);
    const point = solid.mesh.worldToLocal(hit.point.clone());
    return { id: solid.told.id, face: hit.faceIndex, point: solid.atRest(hit.faceIndex, point) };
  }

  #down(event) {
    if (event.button !== 0) return;
    const hit = this.at(event.offsetX, event.offsetY);
    if (!hit) return;
    event.stopImmediatePropagation(); // the camera stays
    this.stage.canvas.focus({ preventScroll: true });
    this.stage.canvas.setPointerCapture(event.pointerId);
    const press = { hit, held: false };
    this.actions.strike(hit, event.pointerType === 'pen' ? event.pressure : null);
    press.timer = setTimeout(() => {
      press.held = true;
      this.actions.hold(hit);
    }, HELD);
    this.presses.set(event.pointerId, press);
  }

  #up(event) {
    const press = this.presses.get(event.pointerId);
    if (!press) return;
    clearTimeout(press.timer);
    this.presses.delete(event.pointerId);
    if (press.held) this.actions.release(press.hit);
  }

  #move(event) {
    if (event.pointerType !== 'mouse' || event.buttons) return;
    const now = performance.now();
    if (now - (this.looked ?? 0) < 40) return;
    this.looked = now;
    this.stage.canvas.classList.toggle('over', this.#cast(event.offsetX, event.offsetY) !== null);
  }
}
