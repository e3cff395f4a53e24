// @ts-check
// Marks of the 3D view with a constant size on the screen: wide lines, texts and rings.

import * as THREE from "./vendor/three/three.module.min.js";

/** @typedef {{position: THREE.Vector3, metresPerPx: number}} Eye
 * metresPerPx: at one metre from the eye */

/** Polylines as bands that face the viewer; WebGL lines are only one pixel wide. */
export class Bands extends THREE.Mesh {
  /** @param {string} colour @param {number} width_px */
  constructor(colour, width_px) {
    const geometry = new THREE.BufferGeometry();
    super(geometry, new THREE.MeshBasicMaterial({ color: colour, side: THREE.DoubleSide }));
    /** @type {THREE.BufferGeometry} */
    this.geometry = geometry;
    this.width_px = width_px;
    /** @type {number[][][]} */
    this.lines = [];
    this.capacity = 0;
    this.frustumCulled = false;
  }

  /** Turn the bands to the eye. @param {Eye} eye */
  face(eye) {
    const count = this.lines.reduce((sum, line) => sum + line.length, 0);
    this.reserve(count);
    const position = /** @type {THREE.BufferAttribute} */ (this.geometry.getAttribute("position"));
    const index = /** @type {THREE.BufferAttribute} */ (this.geometry.getIndex());
    let [vertex, corner] = [0, 0];
    for (const line of this.lines) {
      line.forEach((point, at) => {
        const side = sideways(line[Math.max(0, at - 1)], line[Math.min(line.length - 1, at + 1)], point, eye, this.width_px / 2);
        for (const sign of [1, -1]) position.setXYZ(vertex++, point[0] + sign * side[0], point[1] + sign * side[1], point[2] + sign * side[2]);
        if (at === 0) return;
        for (const back of [4, 3, 2, 3, 1, 2]) index.setX(corner++, vertex - back);
      });
    }
    position.needsUpdate = index.needsUpdate = true;
    this.geometry.setDrawRange(0, corner);
  }

  /** @param {number} count */
  reserve(count) {
    if (count <= this.capacity && this.geometry.getIndex()) return;
    this.capacity = Math.max(8, 2 * count);
    this.geometry.dispose();
    this.geometry = new THREE.BufferGeometry();
    this.geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(this.capacity * 6), 3));
    this.geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(this.capacity * 6), 1));
  }
}

/** Half the width of a band at a point, across the line and the sight, metres.
 * @param {number[]} before @param {number[]} after @param {number[]} point @param {Eye} eye @param {number} half_px */
function sideways(before, after, point, eye, half_px) {
  const along = [0, 1, 2].map((axis) => after[axis] - before[axis]);
  const sight = [eye.position.x - point[0], eye.position.y - point[1], eye.position.z - point[2]];
  const across = [
    along[1] * sight[2] - along[2] * sight[1],
    along[2] * sight[0] - along[0] * sight[2],
    along[0] * sight[1] - along[1] * sight[0],
  ];
  const scale = (half_px * eye.metresPerPx * Math.hypot(...sight)) / (Math.hypot(...across) || 1);
  return across.map((one) => one * scale);
}

/** A line cut into dashes. @param {number[][]} line @param {number} dash_m @returns {number[][][]} */
export function dashes(line, dash_m) {
  const cut = [];
  for (let at = 1; at < line.length; at += 1) {
    const [from, to] = [line[at - 1], line[at]];
    const count = Math.min(200, Math.max(1, Math.round(Math.hypot(...from.map((one, axis) => to[axis] - one)) / dash_m)));
    const between = (/** @type {number} */ share) => from.map((one, axis) => one + (to[axis] - one) * share);
    for (let dash = 0; dash < count; dash += 1) cut.push([between(dash / count), between((dash + 0.55) / count)]);
  }
  return cut;
}

const TEXT_PX = 12;
const SHARPER = 2;

/** A sprite of constant screen size, drawn over everything: a text or a ring. */
export class Mark extends THREE.Sprite {
  /** @param {HTMLCanvasElement} canvas @param {[number, number]} centre */
  constructor(canvas, centre) {
    const map = new THREE.CanvasTexture(canvas);
    map.colorSpace = THREE.SRGBColorSpace;
    super(new THREE.SpriteMaterial({ map, depthTest: false, sizeAttenuation: false, transparent: true }));
    this.size_px = [canvas.width / SHARPER, canvas.height / SHARPER];
    this.center.set(centre[0], centre[1]);
    this.renderOrder = 2;
  }

  /** @param {string} text @param {string} colour @param {string} around */
  static text(text, colour, around) {
    const font = `600 ${TEXT_PX * SHARPER}px system-ui, sans-serif`;
    const measure = canvasContext(1, 1);
    measure.font = font;
    const context = canvasContext(Math.ceil(measure.measureText(text).width) + 12, TEXT_PX * SHARPER + 12);
    context.font = font;
    context.textBaseline = "middle";
    context.lineWidth = 5;
    context.lineJoin = "round";
    context.strokeStyle = around;
    context.fillStyle = colour;
    const middle = context.canvas.height / 2;
    context.strokeText(text, 6, middle);
    context.fillText(text, 6, middle);
    return new Mark(context.canvas, [0.5, -0.25]);
  }

  /** @param {string} colour @param {number} radius_px */
  static ring(colour, radius_px) {
    const middle = (radius_px + 2) * SHARPER;
    const context = canvasContext(2 * middle, 2 * middle);
    context.strokeStyle = colour;
    context.lineWidth = 3 * SHARPER;
    context.beginPath();
    context.arc(middle, middle, radius_px * SHARPER, 0, 2 * Math.PI);
    context.stroke();
    return new Mark(context.canvas, [0.5, 0.5]);
  }

  /** @param {Eye} eye */
  face(eye) {
    this.scale.set(this.size_px[0] * eye.metresPerPx, this.size_px[1] * eye.metresPerPx, 1);
  }
}

/** @param {number} width @param {number} height */
function canvasContext(width, height) {
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  return /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
}
