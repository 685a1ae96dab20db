/** The picture: light, camera and renderer; it is drawn anew only where something has changed. */

import * as THREE from 'three';
import { OrbitControls } from 'three/addons/OrbitControls.js';
import { RoomEnvironment } from 'three/addons/RoomEnvironment.js';
import { backdrop } from './furniture.js';
import { adjust, plain } from './looks.js';

const HOME = { from: [0.12, -4.25, 2.1], to: [0.14, 0.4, 0.7] };
const ROOM = new THREE.Box3(new THREE.Vector3(-2, -0.5, 0), new THREE.Vector3(2.1, 1.3, 1.7)); // of the eighteen objects
const WAY = [0.2, -1, 0.34]; // from bodies to a person who looks at them
const [LEAST, NEAREST] = [0.25, 0.15]; // m that the camera stays away by itself, and at all
const FARTHEST = 7; // m, of the camera from what it looks at, and more where bodies need it
const FILLED = 0.72; // share of the picture that a body takes when the camera comes near it
const ALL_FILLED = 0.88; // and that all of a person's own take
const WALL = 1.36; // m: where the wall of the room is
const LIGHT = { from: [-2.2, -2.6, 4.2], to: [0.1, 0.5, 0.5] };
const FIELD = 30; // degrees, from bottom to top of a wide picture
const FLIGHT = 0.5; // s of a move of the camera
const LARGEST_RATIO = 2; // of pixels of the picture to those of the page
const SIMPLE_RATIO = 0.7;

export const still = matchMedia('(prefers-reduced-motion: reduce)');

/** Return whether the browser draws without a graphics processor. */
function isSoftware() {
  const context = document.createElement('canvas').getContext('webgl2');
  if (!context) return false;
  const names = context.getExtension('WEBGL_debug_renderer_info');
  const name = names ? context.getParameter(names.UNMASKED_RENDERER_WEBGL) : '';
  context.getExtension('WEBGL_lose_context')?.loseContext();
  return /swiftshader|llvmpipe|softpipe|basic render/i.test(name);
}

export class Stage {
  /**
   * @param {HTMLCanvasElement} canvas
   * @throws {Error} where the browser has no WebGL
   */
  constructor(canvas) {
    THREE.Object3D.DEFAULT_UP.set(0, 0, 1);
    this.canvas = canvas;
    this.simple = isSoftware();
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !this.simple });
    this.renderer.toneMapping = THREE.NeutralToneMapping;
    this.renderer.toneMappingExposure = 1.05;
    this.renderer.shadowMap.enabled = !this.simple;
    this.renderer.shadowMap.type = THREE.PCFShadowMap;
    this.renderer.shadowMap.autoUpdate = false;
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(0xe6dfd3);
    this.camera = new THREE.PerspectiveCamera(FIELD, 1, 0.02, 40);
    this.#light();
    this.controls = new OrbitControls(this.camera, canvas);
    Object.assign(this.controls, { enableDamping: false, maxPolarAngle: 1.62, zoomSpeed: 0.7 });
    this.controls.addEventListener('change', () => { this.moved = true; this.invalidate(); });
    this.controls.addEventListener('start', () => { this.visited = true; });
    this.visited = false; // whether the person has moved the camera
    this.tickers = new Set(); // called before each picture with its time, s; true: once more
    this.moved = true;
    this.onMoved = () => {};
    this.own = null; // the box around a person's own bodies, if these are what stands there
    this.all = null; // the box around all bodies, where they need more than the room has
    this.enclose([], false);
    this.home();
    new ResizeObserver(() => this.#resize()).observe(canvas.parentElement);
    this.#resize();
    canvas.addEventListener('webglcontextrestored', () => this.refresh());
  }

  /** Draw simply, for slow machines: fewer pixels, and neither shadows nor reflections. */
  simplify(simple) {
    this.simple = simple;
    this.renderer.shadowMap.enabled = !simple;
    this.#reflections();
    plain(simple);
    this.scene.traverse(({ material }) => {
      for (const surface of [material ?? []].flat()) adjust(surface);
    });
    this.#resize();
    this.refresh();
  }

  #reflections() {
    if (!this.simple && !this.scene.environment) {
      const generator = new THREE.PMREMGenerator(this.renderer);
      this.reflected = generator.fromScene(new RoomEnvironment(), 0.03).texture;
      generator.dispose();
    }
    this.scene.environment = this.simple ? null : this.reflected;
    this.sky.intensity = this.simple ? 1.5 : 0.35;
    this.sun.intensity = this.simple ? 2.3 : 2.1;
  }

  #light() {
    this.scene.environmentIntensity = 0.62;
    const sun = new THREE.DirectionalLight(0xfff3e0, 2.1);
    sun.castShadow = true;
    sun.shadow.mapSize.set(2048, 2048);
    sun.shadow.radius = 5;
    sun.shadow.bias = -0.0004;
    sun.shadow.normalBias = 0.01;
    this.sun = sun;
    this.sky = new THREE.HemisphereLight(0xffffff, 0xcfc4b2, 0.35);
    this.scene.add(sun, sun.target, this.sky);
    plain(this.simple);
    this.#reflections();
  }

  #resize() {
    const { clientWidth, clientHeight } = this.canvas.parentElement;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setPixelRatio(this.simple ? SIMPLE_RATIO : Math.min(devicePixelRatio, LARGEST_RATIO));
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / clientHeight;
    // The whole width of the room stays in view on narrow screens.
    this.camera.fov = 2 * THREE.MathUtils.radToDeg(Math.atan(Math.tan(THREE.MathUtils.degToRad(FIELD / 2)) * Math.max(1, 1.55 / this.camera.aspect)));
    this.camera.updateProjectionMatrix();
    this.#limit();
    this.invalidate();
  }

  /** Add something to the room, and draw it. */
  add(object) {
    this.scene.add(object);
    this.refresh();
  }

  /** Draw anew, shadows too. */
  refresh() {
    this.renderer.shadowMap.needsUpdate = true;
    this.invalidate();
  }

  /** Draw anew, soon. */
  invalidate() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame((time) => this.#draw(time / 1000));
  }

  #draw(time) {
    this.waiting = false;
    let again = false;
    for (const ticker of this.tickers) again = ticker(time) || again;
    this.renderer.render(this.scene, this.camera);
    if (this.moved) {
      this.moved = false;
      this.onMoved();
    }
    if (again) this.invalidate();
  }

  /** Call a function before each picture, until it returns false. */
  tick(ticker) {
    const once = (time) => ticker(time) || (this.tickers.delete(once), false);
    this.tickers.add(once);
    this.invalidate();
    return () => this.tickers.delete(once);
  }

  /**
   * Let the limits of the camera, the light's shadow and the wall follow what is there.
   * @param {THREE.Box3[]} boxes around the bodies
   * @param {boolean} own whether they are a person's own, and not those of the room
   */
  enclose(boxes, own) {
    const all = new THREE.Box3();
    for (const each of own ? boxes : [ROOM, ...boxes]) all.union(each);
    this.own = own ? all.clone() : null;
    const edges = boxes.map((each) => Math.max(...each.getSize(new THREE.Vector3()).toArray()));
    this.controls.minDistance = Math.min(NEAREST, 3 * Math.min(...edges, NEAREST));
    this.camera.near = Math.min(0.02, this.controls.minDistance / 3); // a small body is not cut
    this.camera.updateProjectionMatrix();
    const steady = !own && ROOM.containsBox(all); // the room's own limits, light and wall
    this.all = steady ? null : all.clone();
    all.expandByPoint(new THREE.Vector3(all.min.x, all.min.y, 0));
    this.#limit();
    const middle = all.getCenter(new THREE.Vector3());
    const reach = all.getSize(new THREE.Vector3()).length() / 2;
    const [from, to] = [new THREE.Vector3(...LIGHT.from), new THREE.Vector3(...LIGHT.to)];
    const away = from.clone().sub(to).setLength(reach + 4);
    this.sun.position.copy(steady ? from : middle.clone().add(away));
    this.sun.target.position.copy(steady ? to : middle);
    const [side, up, down] = steady ? [3, 2.6, 2.2] : [reach + 0.3, reach + 0.3, reach + 0.3];
    Object.assign(this.sun.shadow.camera, { left: -side, right: side, top: up, bottom: -down, near: 1, far: steady ? 9 : 2 * reach + 6 });
    this.sun.shadow.camera.updateProjectionMatrix();
    this.sun.target.updateMatrixWorld();
    const { maxDistance } = this.controls;
    const size = {
      wall: steady ? WALL : Math.max(WALL, all.max.y + 0.4), front: Math.max(7, maxDistance - all.min.y), side: Math.max(9, reach + maxDistance), top: Math.max(6, 1.2 * maxDistance),
    };
    const same = this.sheet && Object.keys(size).every((key) => this.sheet.userData[key] === size[key]);
    if (!same) {
      this.sheet?.removeFromParent();
      this.sheet?.geometry.dispose();
      this.sheet = backdrop(size);
      this.sheet.userData = size;
      this.scene.add(this.sheet);
    }
    this.refresh();
  }

  /** Let the camera go as far away as the picture of all bodies needs. */
  #limit() {
    const [way, size] = [new THREE.Vector3(...WAY).normalize(), new THREE.Vector3()];
    const needed = this.all ? this.#distance(this.all, way, FILLED) : 0;
    this.controls.maxDistance = Math.max(FARTHEST, 1.5 * needed);
    const far = Math.max(40, 2 * this.controls.maxDistance + 2 * (this.all?.getSize(size).length() ?? 0));
    if (this.camera.far === far) return;
    this.camera.far = far;
    this.camera.updateProjectionMatrix();
  }

  /**
   * Return how far from the middle of a box the camera has to be, m, so that the box takes a share
   * of the picture.
   * @param {THREE.Box3} box
   * @param {THREE.Vector3} way unit vector from the box to the camera
   * @param {number} share
   */
  #distance(box, way, share) {
    const middle = box.getCenter(new THREE.Vector3());
    const right = new THREE.Vector3(0, 0, 1).cross(way).normalize();
    const up = way.clone().cross(right);
    const tall = share * Math.tan(THREE.MathUtils.degToRad(this.camera.fov / 2));
    const wide = tall * this.camera.aspect;
    let distance = 0;
    for (const x of [box.min.x, box.max.x]) {
      for (const y of [box.min.y, box.max.y]) {
        for (const z of [box.min.z, box.max.z]) {
          const corner = new THREE.Vector3(x, y, z).sub(middle);
          const aside = Math.max(Math.abs(corner.dot(right)) / wide, Math.abs(corner.dot(up)) / tall);
          distance = Math.max(distance, corner.dot(way) + aside);
        }
      }
    }
    return distance;
  }

  /** Show the whole room, or all bodies of a person's own. */
  home() {
    if (this.own) this.#near(this.own, ALL_FILLED);
    else this.#fly(new THREE.Vector3(...HOME.from), new THREE.Vector3(...HOME.to));
  }

  /** Come near a box, for a person who asked for it. */
  approach(box) {
    this.visited = true;
    this.#near(box);
  }

  #near(box, share = FILLED) {
    const middle = box.getCenter(new THREE.Vector3());
    const left = !this.own && middle.x > 1.2; // at the right end of the room
    const way = new THREE.Vector3(left ? -0.25 : WAY[0], WAY[1], WAY[2]).normalize();
    const away = Math.max(LEAST, this.#distance(box, way, share));
    this.#fly(middle.clone().addScaledVector(way, away), middle);
  }

  #fly(from, to) {
    const [start, target] = [this.camera.position.clone(), this.controls.target.clone()];
    let begun = null;
    this.stopFlight?.();
    const arrive = (share) => {
      const eased = share * share * (3 - 2 * share);
      this.camera.position.lerpVectors(start, from, eased);
      this.controls.target.lerpVectors(target, to, eased);
      this.controls.update();
      this.moved = true;
    };
    if (still.matches || !this.drawnOnce) {
      this.drawnOnce = true;
      arrive(1);
      this.invalidate();
      return;
    }
    this.stopFlight = this.tick((time) => {
      begun ??= time;
      const share = Math.min(1, (time - begun) / FLIGHT);
      arrive(share);
      return share < 1;
    });
  }

  /** Come nearer by a factor below 1, or go away. */
  zoom(factor) {
    this.visited = true;
    this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
    this.controls.update();
    this.moved = true;
    this.invalidate();
  }

  /** Return where the listener's head is: the camera. */
  head() {
    const forward = this.camera.getWorldDirection(new THREE.Vector3());
    const up = new THREE.Vector3(0, 1, 0).applyQuaternion(this.camera.quaternion);
    return { position: this.camera.position.toArray(), forward: forward.toArray(), up: up.toArray() };
  }

  /** Return where a point of the room is in the picture, pixels, and whether it is in front. */
  project(point) {
    const at = point.clone().project(this.camera);
    const { clientWidth, clientHeight } = this.canvas;
    return { x: ((at.x + 1) / 2) * clientWidth, y: ((1 - at.y) / 2) * clientHeight, front: at.z < 1 };
  }
}
