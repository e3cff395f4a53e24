// @ts-check
// The 3D view of the chosen run, drawn by WebGL.

import * as THREE from "./vendor/three/three.module.min.js";
import { DrawPace } from "./draw_pace.js";
import { Orbit } from "./orbit.js";
import { axes } from "./projection.js";
import { Bands, Mark } from "./space_marks.js";
import { free, WorldModel, VehicleModel } from "./space_scene.js";
import { colours, extent } from "./world.js";

/** @typedef {import("./model.js").Model} Model */
/** @typedef {import("./model.js").Run} Run */

const FIELD = (35 * Math.PI) / 180;
const LIGHT = [-0.35, 0.25, -0.9];
const FILLS = 0.94;
const ROUNDS = 3;
const LOOK_MS = 5;
const LATER_MS = 150;

export class SpaceView {
  /** @param {Model} model @param {HTMLCanvasElement} canvas @param {WebGL2RenderingContext} context */
  constructor(model, canvas, context) {
    this.model = model;
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, context, alpha: true, antialias: true });
    this.renderer.setClearColor(0, 0);
    this.context = context;
    this.pace = new DrawPace();
    this.fitted = "";
    this.scene = new THREE.Scene();
    const sun = new THREE.DirectionalLight("white", 2.2);
    sun.position.fromArray(LIGHT);
    this.scene.add(sun, new THREE.AmbientLight("white", 1.5));
    this.camera = new THREE.PerspectiveCamera((FIELD * 180) / Math.PI);
    this.camera.up.set(0, 0, -1);
    /** The data behind the present parts; they are rebuilt when it changes. */
    this.madeOf = "";
    /** @type {WorldModel | null} */
    this.world = null;
    /** @type {Map<string, VehicleModel>} */
    this.vehicles = new Map();
    this.contacts = new THREE.Group();
    this.scene.add(this.contacts);
    this.box = new THREE.Box3();
    this.isTurned = false;
    this.later = 0;
    this.observe = document.getElementById(`${canvas.id}-observer`);
    /** @type {any} */ this.shownScene = null;
    this.shownRun = "";
    this.orbit = new Orbit(canvas, () => {
      if (!this.isTurned) requestAnimationFrame(() => this.draw());
      this.isTurned = true;
    });
  }

  draw() {
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    const now = performance.now();
    if (!width || this.context.isContextLost()) return;
    if (!this.pace.isDue(now, this.isTurned)) return this.drawLater();
    this.pace.begin(now);
    this.isTurned = false;
    const { run } = this.model;
    if (run) this.show(run);
    const observer = run?.scene?.observer;
    if (this.observe) this.observe.hidden = !observer;
    this.fit(width, height, (window.devicePixelRatio || 1) * this.pace.scale);
    if (observer && this.orbit.isObserver) this.stand(observer, width, height);
    else this.aim(width, height);
    this.renderer.render(this.scene, this.camera);
    this.awaitDrawn();
  }

  /** Draw again later, so that the newest state is drawn even if the graphics are busy now. */
  drawLater() {
    if (this.later) return;
    this.later = setTimeout(() => {
      this.later = 0;
      this.draw();
    }, LATER_MS);
  }

  /** Set the size only when it changes: that recreates all buffers. @param {number} width @param {number} height @param {number} ratio */
  fit(width, height, ratio) {
    const fitted = `${width} ${height} ${ratio}`;
    if (fitted === this.fitted) return;
    this.fitted = fitted;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
  }

  /** Measure the drawing time of the graphics without blocking. */
  awaitDrawn() {
    const fence = this.context.fenceSync(this.context.SYNC_GPU_COMMANDS_COMPLETE, 0);
    if (!fence) return this.pace.end(performance.now());
    this.context.flush();
    const look = () => {
      // For a lost context the status is neither signaled nor unsignaled.
      if (this.context.getSyncParameter(fence, this.context.SYNC_STATUS) === this.context.UNSIGNALED) {
        setTimeout(look, LOOK_MS);
        return;
      }
      this.context.deleteSync(fence);
      this.pace.end(performance.now());
      if (this.isTurned) requestAnimationFrame(() => this.draw());
    };
    setTimeout(look, 0);
  }

  /** @param {Run} run */
  show(run) {
    const page = colours();
    const madeOf = JSON.stringify([run.key, run.view?.fences ?? null, page]);
    if (madeOf !== this.madeOf || run.scene !== this.shownScene) {
      if (run.key !== this.shownRun) this.box.makeEmpty();
      this.madeOf = madeOf;
      this.shownScene = run.scene;
      this.shownRun = run.key;
      this.clear();
      this.world = new WorldModel(run, page);
      this.scene.add(this.world);
    }
    this.world?.move(run);
    for (const point of extent(run)) this.box.expandByPoint(new THREE.Vector3(...point));
    for (const vehicle of run.view?.vehicles ?? []) {
      let shown = this.vehicles.get(vehicle.name);
      if (!shown) {
        shown = new VehicleModel(vehicle.name, page);
        this.vehicles.set(vehicle.name, shown);
        this.scene.add(shown);
      }
      shown.show(vehicle, run.trails.get(vehicle.name) ?? []);
    }
    this.markContacts(run, page);
  }

  /** @param {Run} run @param {Record<string, string>} page */
  markContacts(run, page) {
    if (run.contacts.length < this.contacts.children.length) this.empty(this.contacts);
    for (const place of run.contacts.slice(this.contacts.children.length)) {
      const mark = Mark.ring(page.bad, 9);
      mark.position.fromArray(place);
      this.contacts.add(mark);
    }
  }

  /** Forget all parts, which a lost context had, so that the next drawing makes them anew. */
  forget() {
    this.clear();
    this.madeOf = "";
  }

  clear() {
    for (const part of [this.world, ...this.vehicles.values()]) {
      if (!part) continue;
      free(part);
      this.scene.remove(part);
    }
    this.vehicles.clear();
    this.empty(this.contacts);
  }

  /** @param {THREE.Group} group */
  empty(group) {
    free(group);
    group.clear();
  }

  /** Look at everything from the orbit's direction. @param {number} width @param {number} height */
  aim(width, height) {
    const directions = axes("space", [], this.orbit.azimuth, this.orbit.elevation);
    const [right, up, near] = [directions.right, directions.up, directions.near].map((one) => new THREE.Vector3(...one));
    const middle = this.box.isEmpty() ? new THREE.Vector3() : this.box.getCenter(new THREE.Vector3());
    const half = Math.tan(FIELD / 2);
    const slopes = [half * FILLS * (width / height), half * FILLS];
    let away = 1;
    for (let round = 0; round < ROUNDS; round += 1) {
      const points = boxCorners(this.box).map((one) => one.sub(middle)).map((one) => [one.dot(right), one.dot(up), one.dot(near)]);
      away = Math.max(1, ...points.map(([x, y, z]) => z + Math.max(Math.abs(x) / slopes[0], Math.abs(y) / slopes[1])));
      // Perspective: the middle of the image is not that of the box.
      const [x, y] = [0, 1].map((axis) => centre(points.map((one) => one[axis] / (away - one[2]))) * away);
      middle.addScaledVector(right, x).addScaledVector(up, y);
    }
    away /= this.orbit.zoom;
    this.camera.position.copy(middle).addScaledVector(near, away);
    this.camera.up.set(0, 0, -1);
    this.camera.lookAt(middle);
    this.camera.fov = (FIELD * 180) / Math.PI;
    this.camera.near = away / 200;
    this.camera.far = away * 20;
    this.face(width, height, half);
  }

  /** Look as the campaign's observer does. @param {any} observer @param {number} width @param {number} height */
  stand(observer, width, height) {
    const place = new THREE.Vector3(...observer.position_ned_m);
    const half = (Math.tan(observer.fov_rad / 2) * height) / width;
    this.camera.position.copy(place);
    this.camera.up.fromArray(observer.up_ned);
    this.camera.lookAt(place.add(new THREE.Vector3(...observer.ahead_ned)));
    this.camera.fov = (2 * Math.atan(half) * 180) / Math.PI;
    this.camera.near = 0.05;
    this.camera.far = 1000;
    this.face(width, height, half);
  }

  /** Turn labels and marks to the camera. @param {number} width @param {number} height @param {number} half tangent of half the field of view */
  face(width, height, half) {
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    const eye = { position: this.camera.position, metresPerPx: (2 * half) / height };
    this.scene.traverse((one) => {
      if (one instanceof Bands || one instanceof Mark || one instanceof VehicleModel) one.face(eye);
    });
  }
}

/** The middle between the least and the largest value. @param {number[]} values */
function centre(values) {
  return values.length ? (Math.min(...values) + Math.max(...values)) / 2 : 0;
}

/** @param {THREE.Box3} box */
function boxCorners(box) {
  if (box.isEmpty()) return [];
  const { min, max } = box;
  return [min.x, max.x].flatMap((x) => [min.y, max.y].flatMap((y) => [min.z, max.z].map((z) => new THREE.Vector3(x, y, z))));
}
