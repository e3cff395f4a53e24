// @ts-check
// The contents of the 3D view: ground, objects, fences, and per vehicle its body, trail and
// setpoint. The scene's axes are the world's: north, east, down.

import * as THREE from "./vendor/three/three.module.min.js";
import { Bands, dashes, Mark } from "./space_marks.js";
import { boxEdges, corners, downs, extent, grid, isPoint, setpointEnd } from "./world.js";

/** @typedef {import("./model.js").Run} Run */
/** @typedef {Record<string, string>} Colours */

const ARM_M = 0.28;
const LEAST_PX = 9;
const SHARP_DEG = 25;

/** The world around the vehicles: static objects, and those that the world moves. */
export class WorldModel extends THREE.Group {
  /** @param {Run} run @param {Colours} colours */
  constructor(run, colours) {
    super();
    this.colours = colours;
    /** @type {Map<string, THREE.Object3D>} */
    this.things = new Map();
    const { step, lines } = grid(extent(run));
    this.add(thinLines(lines, colours.rule));
    this.label(`grid ${step} m`, lines[0][0], colours.dim);
    for (const thing of run.scene?.objects ?? []) this.addObject(thing);
    for (const fence of Object.values(run.view?.fences ?? {})) this.addFence(fence);
    for (const target of run.scene?.targets ?? []) {
      const mark = Mark.ring(colours.dim, 4);
      mark.position.fromArray(target);
      this.add(mark);
    }
  }

  /** @param {Run} run */
  move(run) {
    for (const [name, pose] of Object.entries(run.view?.moving ?? {})) {
      const thing = this.things.get(name);
      if (thing) place(thing, /** @type {any} */ (pose));
    }
  }

  /** @param {any} thing */
  addObject(thing) {
    const group = new THREE.Group();
    const edge = thing.is_virtual ? this.colours.virtual : this.colours.physical;
    if (thing.is_room) {
      group.add(thinLines(boxEdges(thing.vertices_m), edge));
    } else {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.Float32BufferAttribute(thing.vertices_m.flat(), 3));
      geometry.setIndex(thing.faces.flat());
      const [red, green, blue] = thing.rgb.map((/** @type {number} */ one) => one / 255);
      const color = new THREE.Color().setRGB(red, green, blue, THREE.SRGBColorSpace);
      const glass = thing.is_virtual ? { transparent: true, opacity: 0.85 } : {};
      group.add(new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ color, flatShading: true, side: THREE.DoubleSide, ...glass })));
      group.add(new THREE.LineSegments(new THREE.EdgesGeometry(geometry, SHARP_DEG), new THREE.LineBasicMaterial({ color: edge })));
      const top = thing.vertices_m.reduce((/** @type {number[]} */ one, /** @type {number[]} */ other) => (other[2] < one[2] ? other : one));
      const label = Mark.text(thing.name, edge, this.colours.page);
      label.position.fromArray(top);
      group.add(label);
    }
    place(group, thing.pose);
    this.things.set(thing.name, group);
    this.add(group);
  }

  /** @param {any} fence */
  addFence(fence) {
    const [floor, ceiling] = downs(fence);
    for (const area of [...fence.inclusions, ...fence.exclusions]) {
      const colour = fence.exclusions.includes(area) ? this.colours.bad : this.colours.fence;
      const flat = corners(area);
      const ring = [...flat, flat[0]];
      const bands = new Bands(colour, 1.8);
      const rings = [floor, ceiling].map((down) => ring.map(([n, e]) => [n, e, down]));
      const posts = area.corners_m ? flat.map(([n, e]) => [[n, e, floor], [n, e, ceiling]]) : [];
      const dash_m = Math.max(...rings[0].map((one) => Math.hypot(one[0] - rings[0][0][0], one[1] - rings[0][0][1]))) / 25;
      bands.lines = [...rings, ...posts].flatMap((line) => dashes(line, dash_m));
      this.add(bands, walls(rings[0], rings[1], colour));
    }
  }

  /** @param {string} text @param {number[]} at @param {string} colour */
  label(text, at, colour) {
    const mark = Mark.text(text, colour, this.colours.page);
    mark.position.fromArray(at);
    this.add(mark);
  }
}

/** A vehicle: body, trail, setpoint, and a vertical line to the ground. */
export class VehicleModel extends THREE.Group {
  /** @param {string} name @param {Colours} colours */
  constructor(name, colours) {
    super();
    const colour = colours[name] ?? colours.ink;
    this.body = quadrotor(colour, name === "twin");
    this.trail = new Bands(colour, 2);
    this.pointer = new Bands(colour, 1.6);
    this.plumb = new Bands(colour, 1);
    this.target = Mark.ring(colour, 4);
    this.label = Mark.text(name, colour, colours.page);
    // Labels on opposite sides, for vehicles at the same place.
    if (name === "twin") this.label.center.set(1.3, 0.5);
    if (name === "real") this.label.center.set(-0.3, 0.5);
    this.add(this.body, this.trail, this.pointer, this.plumb, this.target, this.label);
  }

  /** @param {any} vehicle @param {number[][]} trail */
  show(vehicle, trail) {
    const at = vehicle.position_ned_m;
    this.visible = isPoint(at);
    if (!this.visible) return;
    place(this.body, { position_ned_m: at, q_wxyz: vehicle.q_wxyz ?? [1, 0, 0, 0] });
    this.label.position.fromArray(at);
    this.trail.lines = trail.length > 1 ? [trail] : [];
    this.plumb.lines = [[at, [at[0], at[1], 0]]];
    const end = setpointEnd(vehicle);
    this.pointer.lines = end ? dashes([at, end], 0.12) : [];
    this.target.visible = end !== null && vehicle.setpoint_kind === "position";
    if (end) this.target.position.fromArray(end);
  }

  /** Keep the body large enough to be seen. @param {import("./space_marks.js").Eye} eye */
  face(eye) {
    const least_m = LEAST_PX * eye.metresPerPx * eye.position.distanceTo(this.body.position);
    this.body.scale.setScalar(Math.max(1, least_m / ARM_M));
  }
}

/** Free the graphics memory of a part of the scene. @param {THREE.Object3D} part */
export function free(part) {
  part.traverse((one) => {
    const { geometry, material } = /** @type {any} */ (one);
    // All sprites share one geometry, which is the library's.
    if (!(one instanceof THREE.Sprite)) geometry?.dispose();
    material?.map?.dispose();
    material?.dispose();
  });
}

/** @param {THREE.Object3D} thing @param {{position_ned_m: number[], q_wxyz: number[]}} pose */
function place(thing, pose) {
  const [w, x, y, z] = pose.q_wxyz;
  thing.position.fromArray(pose.position_ned_m);
  thing.quaternion.set(x, y, z, w);
}

/** Lines of one pixel. @param {number[][][]} lines @param {string} colour */
function thinLines(lines, colour) {
  const points = lines.flatMap((line) => line.slice(1).flatMap((one, at) => [...line[at], ...one]));
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
  return new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: colour }));
}

/** The walls between two rings, nearly transparent. @param {number[][]} low @param {number[][]} high @param {string} colour */
function walls(low, high, colour) {
  const faces = low.slice(1).flatMap((next, at) => [low[at], next, high[at], next, high[at + 1], high[at]]);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(faces.flat(), 3));
  return new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color: colour, transparent: true, opacity: 0.06, side: THREE.DoubleSide, depthWrite: false }));
}

/** A quadrotor that points north: arms, rotors, and a nose. @param {string} colour @param {boolean} isGhost */
function quadrotor(colour, isGhost) {
  const material = new THREE.MeshLambertMaterial({ color: colour, side: THREE.DoubleSide, ...(isGhost ? { transparent: true, opacity: 0.7 } : {}) });
  const group = new THREE.Group();
  /** @param {THREE.BufferGeometry} geometry @param {number[]} at @param {number} yaw */
  const add = (geometry, at, yaw) => {
    const mesh = new THREE.Mesh(geometry, material);
    mesh.position.fromArray(at);
    mesh.rotation.z = yaw;
    group.add(mesh);
  };
  const length = 2 * Math.SQRT2 * ARM_M;
  for (const yaw of [Math.PI / 4, -Math.PI / 4]) add(new THREE.BoxGeometry(length, 0.05, 0.04), [0, 0, 0], yaw);
  for (const [n, e] of [[1, 1], [1, -1], [-1, 1], [-1, -1]]) add(new THREE.TorusGeometry(0.16, 0.018, 6, 20), [n * ARM_M, e * ARM_M, -0.04], 0);
  add(new THREE.ConeGeometry(0.07, 0.24, 12), [ARM_M * 1.3, 0, 0], -Math.PI / 2);
  add(new THREE.BoxGeometry(0.2, 0.14, 0.08), [0, 0, 0], 0);
  return group;
}
