// @ts-check
// Geometry and colours shared by the views of the world; pure except for the colours.

import { rotate } from "./projection.js";

/** @typedef {import("./model.js").Run} Run */

const PAD_M = 0.7;
const SAMPLES = 40;

/** Points that a view of a run has to contain. @param {Run} run @returns {number[][]} */
export function extent(run) {
  /** @type {number[][]} */
  const points = [[-PAD_M, -PAD_M, 0], [PAD_M, PAD_M, 0]];
  for (const thing of run.scene?.objects ?? []) {
    const pose = run.view?.moving?.[thing.name] ?? thing.pose;
    const step = Math.max(1, Math.floor(thing.vertices_m.length / SAMPLES));
    thing.vertices_m.forEach((/** @type {number[]} */ one, /** @type {number} */ index) => {
      if (index % step === 0) points.push(rotate(pose.q_wxyz, one, pose.position_ned_m));
    });
  }
  for (const fence of Object.values(run.view?.fences ?? {})) {
    for (const area of /** @type {any} */ (fence).inclusions) {
      for (const [n, e] of corners(area)) for (const down of downs(fence)) points.push([n, e, down]);
    }
  }
  for (const trail of run.trails.values()) if (trail.length) points.push(trail[0], trail[trail.length - 1]);
  return points;
}

/** Floor and ceiling of a fence, metres down. @param {any} fence @returns {number[]} */
export function downs(fence) {
  return [fence.floor_up_m, fence.ceiling_up_m].map((up) => -(up ?? 0));
}

/** The corners of an area of a fence, north and east; of a circle many.
 * @param {any} area @returns {number[][]} */
export function corners(area) {
  if (area.corners_m) return area.corners_m;
  return Array.from({ length: 36 }, (_, index) => {
    const turn = (index / 36) * 2 * Math.PI;
    return [area.centre_m[0] + area.radius_m * Math.cos(turn), area.centre_m[1] + area.radius_m * Math.sin(turn)];
  });
}

/** The lines of the ground's grid, and the metres between two of them.
 * @param {number[][]} points @returns {{step: number, lines: number[][][]}} */
export function grid(points) {
  const [north, east] = [0, 1].map((axis) => points.map((one) => one[axis]));
  const [n0, n1] = [Math.floor(Math.min(...north)), Math.ceil(Math.max(...north))];
  const [e0, e1] = [Math.floor(Math.min(...east)), Math.ceil(Math.max(...east))];
  const step = 10 ** Math.max(0, Math.ceil(Math.log10(Math.max(n1 - n0, e1 - e0) / 30)));
  const lines = [];
  for (let n = n0; n <= n1; n += step) lines.push([[n, e0, 0], [n, e1, 0]]);
  for (let e = e0; e <= e1; e += step) lines.push([[n0, e, 0], [n1, e, 0]]);
  return { step, lines };
}

/** The edges of the box around points. @param {number[][]} vertices @returns {number[][][]} */
export function boxEdges(vertices) {
  const low = [0, 1, 2].map((axis) => Math.min(...vertices.map((one) => one[axis])));
  const high = [0, 1, 2].map((axis) => Math.max(...vertices.map((one) => one[axis])));
  const flat = [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]];
  const rings = [low[2], high[2]].map((down) => [...flat, flat[0]].map(([n, e]) => [n, e, down]));
  return [...rings, ...flat.map(([n, e]) => [[n, e, low[2]], [n, e, high[2]]])];
}

/** The end of a vehicle's setpoint: its position, or the place after a second of its velocity.
 * @param {any} vehicle @returns {number[] | null} */
export function setpointEnd(vehicle) {
  if (!isPoint(vehicle.setpoint) || !isPoint(vehicle.position_ned_m)) return null;
  if (vehicle.setpoint_kind === "position") return vehicle.setpoint;
  return vehicle.position_ned_m.map((/** @type {number} */ one, /** @type {number} */ axis) => one + vehicle.setpoint[axis]);
}

/** @param {any} point */
export function isPoint(point) {
  return Array.isArray(point) && point.every((one) => typeof one === "number");
}

/** The page's colours, which follow light and dark. @returns {Record<string, string>} */
export function colours() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "dim", "rule", "grid", "real", "twin", "fence", "bad", "virtual", "physical", "page"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}
