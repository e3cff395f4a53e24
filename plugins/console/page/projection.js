// @ts-check
// From the world (north, east, down; metres) to the screen, without perspective; pure.

const MARGIN_PX = 22;

/** @typedef {{right: number[], up: number[], near: number[]}} Axes */

/** The directions of a view: right, up, and towards the viewer.
 * @param {string} kind @param {number[][]} points @param {number} azimuth @param {number} elevation
 * @returns {Axes} */
export function axes(kind, points, azimuth, elevation) {
  if (kind === "plan") return { right: [0, 1, 0], up: [1, 0, 0], near: [0, 0, -1] };
  if (kind === "side") {
    const [north, east] = [0, 1].map((axis) => spread(points, axis));
    return east > north
      ? { right: [0, 1, 0], up: [0, 0, -1], near: [-1, 0, 0] }
      : { right: [1, 0, 0], up: [0, 0, -1], near: [0, 1, 0] };
  }
  const [flat, high] = [Math.cos(elevation), Math.sin(elevation)];
  const near = [flat * Math.cos(azimuth), flat * Math.sin(azimuth), -high];
  const right = [Math.sin(azimuth), -Math.cos(azimuth), 0];
  return { right, up: cross(near, right), near };
}

export class Projection {
  /** @param {Axes} directions @param {number} scale @param {number[]} middle @param {number[]} size
   * @param {number[][]} span */
  constructor(directions, scale, middle, size, span) {
    this.directions = directions;
    this.scale = scale;
    this.middle = middle;
    this.size = size;
    this.span = span;
  }

  /** A projection that shows all points. @param {Axes} directions @param {number[][]} points
   * @param {number} width @param {number} height @param {number} zoom */
  static fitting(directions, points, width, height, zoom) {
    const [xs, ys] = [directions.right, directions.up].map((axis) => points.map((one) => dot(one, axis)));
    const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    const scale = zoom * Math.min((width - 2 * MARGIN_PX) / Math.max(0.5, x1 - x0), (height - 2 * MARGIN_PX) / Math.max(0.5, y1 - y0));
    const span = [x0, x1].map((x) => directions.right.map((one) => one * x));
    return new Projection(directions, scale, [(x0 + x1) / 2, (y0 + y1) / 2], [width, height], span);
  }

  /** @param {number[]} point */
  flat(point) {
    const [x, y] = [dot(point, this.directions.right), dot(point, this.directions.up)];
    return [this.size[0] / 2 + (x - this.middle[0]) * this.scale, this.size[1] / 2 - (y - this.middle[1]) * this.scale];
  }

  /** The place of a screen point on the axes right and up. @param {number} x @param {number} y */
  lifted(x, y) {
    return [this.middle[0] + (x - this.size[0] / 2) / this.scale, this.middle[1] - (y - this.size[1] / 2) / this.scale];
  }

  /** How near a point is to the viewer. @param {number[]} point */
  depth(point) {
    return dot(point, this.directions.near);
  }
}

/** A vector turned by a quaternion (wxyz), and moved. @param {number[]} q @param {number[]} v
 * @param {number[]} place */
export function rotate(q, v, place) {
  const [w, x, y, z] = q;
  const t = [2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])];
  return [
    place[0] + v[0] + w * t[0] + y * t[2] - z * t[1],
    place[1] + v[1] + w * t[1] + z * t[0] - x * t[2],
    place[2] + v[2] + w * t[2] + x * t[1] - y * t[0],
  ];
}

/** @param {number[]} a @param {number[]} b */
function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** @param {number[]} a @param {number[]} b */
function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

/** @param {number[][]} points @param {number} axis */
function spread(points, axis) {
  const values = points.map((one) => one[axis]);
  return Math.max(...values) - Math.min(...values);
}
