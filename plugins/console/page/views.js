// @ts-check
// Views of the world from above and from the side, and the 3D view in browsers without WebGL: one
// drawing with three directions.

import { Orbit } from "./orbit.js";
import { axes, Projection, rotate } from "./projection.js";
import { boxEdges, colours, corners, downs, extent, grid, isPoint, setpointEnd } from "./world.js";

/** @typedef {import("./model.js").Model} Model */
/** @typedef {import("./model.js").Run} Run */
/** @typedef {[number, number, number]} Point */

const LIGHT = [-0.35, 0.25, -0.9];
const ARM_M = 0.28;
const DRAW_MS = 80;
const NAME_PX = 14;

class View {
  /** @param {Model} model @param {string} id @param {"plan" | "side" | "space"} kind */
  constructor(model, id, kind) {
    this.model = model;
    this.kind = kind;
    this.canvas = /** @type {HTMLCanvasElement} */ (document.getElementById(id));
    this.orbit = kind === "space" ? new Orbit(this.canvas, () => requestAnimationFrame(() => this.draw())) : null;
    /** @type {Projection | null} */
    this.projection = null;
    /** @type {((context: CanvasRenderingContext2D, projection: Projection) => void) | null} */
    this.overlay = null;
  }

  draw() {
    const run = this.model.run;
    const context = this.canvas.getContext("2d");
    if (!context) return;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (this.canvas.width !== width * ratio || this.canvas.height !== height * ratio) {
      this.canvas.width = width * ratio;
      this.canvas.height = height * ratio;
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    if (!run || !width) return;
    const points = extent(run);
    const { azimuth, elevation, zoom } = this.orbit ?? { azimuth: 0, elevation: 0, zoom: 1 };
    const directions = axes(this.kind, points, azimuth, elevation);
    const projection = Projection.fitting(directions, points, width, height, zoom);
    this.projection = projection;
    new Drawing(context, projection, this.kind, colours()).run(run);
    this.overlay?.(context, projection);
  }
}

class Drawing {
  /** @param {CanvasRenderingContext2D} context @param {Projection} projection
   * @param {string} kind @param {Record<string, string>} palette */
  constructor(context, projection, kind, palette) {
    this.context = context;
    this.projection = projection;
    this.kind = kind;
    this.colours = palette;
    /** Where names stand: left, top, right, bottom. @type {number[][]} */
    this.names = [];
    /** Names of objects, which are drawn after the vehicles. @type {{place: number[], name: string, colour: string}[]} */
    this.labels = [];
  }

  /** @param {Run} run */
  run(run) {
    this.ground(run);
    this.objects(run);
    for (const fence of Object.values(run.view?.fences ?? {})) this.fence(fence);
    if (this.kind === "side") this.soil();
    for (const target of run.scene?.targets ?? []) this.cross(target, this.colours.dim, 4);
    for (const [name, trail] of run.trails) this.line(trail, this.colours[name] ?? this.colours.ink, 1.5);
    for (const place of run.contacts) this.ring(place, this.colours.bad, 9, 3);
    // The twin first, and wider: both stay visible at the same place.
    const vehicles = (run.view?.vehicles ?? []).filter((/** @type {any} */ one) => isPoint(one.position_ned_m));
    const boxes = vehicles.toSorted((/** @type {any} */ one) => (one.name === "twin" ? -1 : 1)).map((/** @type {any} */ one) => this.vehicle(one));
    this.names.push(...boxes.map((/** @type {any} */ one) => one.box));
    // The left one has its name on its left: names stand clear of both vehicles.
    boxes.toSorted((/** @type {any} */ one, /** @type {any} */ other) => one.box[0] - other.box[0]).forEach((/** @type {any} */ one, /** @type {number} */ index) => {
      const { name, place, colour, box } = one;
      const [x] = this.projection.flat(place);
      const isLeft = index === 0 && boxes.length > 1;
      this.text(place, name, colour, -8, isLeft ? box[0] - x - 3 - this.context.measureText(name).width : box[2] - x + 3);
    });
    for (const one of this.labels) this.text(one.place, one.name, one.colour);
  }

  /** @param {Run} run */
  ground(run) {
    if (this.kind === "side") {
      const [low, high] = this.projection.span;
      this.line([low, high], this.colours.rule, 1);
      return;
    }
    const { step, lines } = grid(extent(run));
    for (const line of lines) this.line(line, this.colours.grid, 1);
    this.corner(step);
  }

  /** The grid size and the directions of north and east, in a corner of the view.
   * @param {number} step */
  corner(step) {
    const [width, height] = this.projection.size;
    this.context.fillStyle = this.colours.dim;
    this.context.font = "12px system-ui, sans-serif";
    this.context.fillText(`grid ${step} m`, 6, height - 6);
    if (this.kind !== "plan") return;
    this.context.strokeStyle = this.colours.dim;
    this.context.lineWidth = 1.5;
    const [x, y] = [width - 44, 40];
    this.context.beginPath();
    for (const [dx, dy] of [[0, -22], [22, 0]]) {
      this.context.moveTo(x, y);
      this.context.lineTo(x + dx, y + dy);
    }
    this.context.stroke();
    this.context.fillText("N", x - 4, y - 25);
    this.context.fillText("E", x + 25, y + 4);
  }

  /** Shade the area below the ground, whatever the fence's floor is. */
  soil() {
    const [, height] = this.projection.size;
    const [, y] = this.projection.flat([0, 0, 0]);
    const [[x0], [x1]] = this.projection.span.map((one) => this.projection.flat(one));
    this.context.globalAlpha = 0.75;
    this.context.fillStyle = this.colours.rule;
    this.context.fillRect(x0 - 12, y, x1 - x0 + 24, height - y);
    this.context.globalAlpha = 1;
    this.context.fillStyle = this.colours.ink;
    this.context.font = "12px system-ui, sans-serif";
    const text = "ground, 0 m";
    this.context.fillText(text, this.within(x1 + 16, this.context.measureText(text).width), y + 4);
  }

  /** @param {Run} run */
  objects(run) {
    /** @type {{depth: number, points: number[][], fill: string, alpha: number}[]} */
    const faces = [];
    for (const thing of run.scene?.objects ?? []) {
      const pose = run.view?.moving?.[thing.name] ?? thing.pose;
      const vertices = thing.vertices_m.map((/** @type {number[]} */ one) => rotate(pose.q_wxyz, one, pose.position_ned_m));
      const edge = thing.is_virtual ? this.colours.virtual : this.colours.physical;
      if (thing.is_room) {
        for (const line of boxEdges(vertices)) this.line(line, edge, 1);
        continue;
      }
      for (const face of thing.faces) faces.push(this.face(face.map((/** @type {number} */ i) => vertices[i]), thing));
      this.labels.push({ place: vertices[0], name: thing.name, colour: edge });
    }
    faces.sort((one, other) => one.depth - other.depth);
    for (const face of faces) {
      this.context.globalAlpha = face.alpha;
      this.context.fillStyle = this.context.strokeStyle = face.fill;
      this.context.lineWidth = 0.6;
      this.path(face.points);
      this.context.closePath();
      this.context.fill();
      this.context.stroke();
    }
    this.context.globalAlpha = 1;
  }

  /** @param {number[][]} points @param {any} thing */
  face(points, thing) {
    const [a, b, c] = points;
    const [u, v] = [b, c].map((one) => one.map((value, axis) => value - a[axis]));
    const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const length = Math.hypot(...normal) || 1;
    const shade = 0.55 + 0.45 * Math.max(0, normal.reduce((sum, value, axis) => sum + value * LIGHT[axis], 0) / length);
    const [red, green, blue] = thing.rgb.map((/** @type {number} */ one) => Math.round(one * shade));
    const depth = (this.projection.depth(a) + this.projection.depth(b) + this.projection.depth(c)) / 3;
    return { depth, points, fill: `rgb(${red} ${green} ${blue})`, alpha: thing.is_virtual ? 0.85 : 1 };
  }

  /** @param {any} fence */
  fence(fence) {
    const heights = downs(fence);
    this.context.setLineDash([6, 4]);
    for (const area of [...fence.inclusions, ...fence.exclusions]) {
      const flat = corners(area);
      for (const down of heights) {
        const points = flat.map((one) => [one[0], one[1], down]);
        this.line([...points, points[0]], this.colours.fence, 1.8);
      }
      if (this.kind === "plan" || flat.length > 12) continue;
      for (const [n, e] of flat) this.line([[n, e, heights[0]], [n, e, heights[1]]], this.colours.fence, 1);
    }
    this.context.setLineDash([]);
  }

  /** Draw a vehicle; return its name, place, colour, and the box in which it is drawn.
   * @param {any} vehicle */
  vehicle(vehicle) {
    const place = vehicle.position_ned_m;
    const colour = this.colours[vehicle.name] ?? this.colours.ink;
    if (this.kind === "space") this.line([place, [place[0], place[1], 0]], colour, 0.7);
    this.setpoint(vehicle, place, colour);
    const q = vehicle.q_wxyz ?? [1, 0, 0, 0];
    const arms = [[1, 1, 0], [-1, -1, 0], [1, -1, 0], [-1, 1, 0]].map((one) => rotate(q, one.map((x) => x * ARM_M), place));
    this.line([arms[0], arms[1]], colour, 3);
    this.line([arms[2], arms[3]], colour, 3);
    this.line([place, rotate(q, [ARM_M * 1.9, 0, 0], place)], colour, 2);
    const isTwin = vehicle.name === "twin";
    for (const arm of arms) this.ring(arm, colour, isTwin ? 6 : 3, 1.5);
    const flat = arms.map((one) => this.projection.flat(one));
    const [low, high] = [Math.min, Math.max].map((end, side) => [0, 1].map((axis) => end(...flat.map((one) => one[axis])) + (isTwin ? 7 : 4) * (side ? 1 : -1)));
    return { name: vehicle.name, place, colour, box: [...low, ...high] };
  }

  /** @param {any} vehicle @param {number[]} place @param {string} colour */
  setpoint(vehicle, place, colour) {
    const end = setpointEnd(vehicle);
    if (!end) return;
    this.context.setLineDash([2, 3]);
    this.line([place, end], colour, 1.2);
    this.context.setLineDash([]);
    if (vehicle.setpoint_kind === "position") this.ring(end, colour, 5, 1.5);
    else this.cross(end, colour, 3);
    const [x, y] = this.projection.flat(end);
    this.names.push([x - 6, y - 6, x + 6, y + 6]);
  }

  /** @param {number[][]} points */
  path(points) {
    this.context.beginPath();
    points.forEach((one, index) => {
      const [x, y] = this.projection.flat(one);
      if (index) this.context.lineTo(x, y);
      else this.context.moveTo(x, y);
    });
  }

  /** @param {number[][]} points @param {string} colour @param {number} width */
  line(points, colour, width) {
    this.context.strokeStyle = colour;
    this.context.lineWidth = width;
    this.path(points);
    this.context.stroke();
  }

  /** @param {number[]} point @param {string} colour @param {number} radius @param {number} width */
  ring(point, colour, radius, width) {
    const [x, y] = this.projection.flat(point);
    this.context.strokeStyle = colour;
    this.context.lineWidth = width;
    this.context.beginPath();
    this.context.arc(x, y, radius, 0, 2 * Math.PI);
    this.context.stroke();
  }

  /** @param {number[]} point @param {string} colour @param {number} size */
  cross(point, colour, size) {
    const [x, y] = this.projection.flat(point);
    this.context.strokeStyle = colour;
    this.context.lineWidth = 1.5;
    this.context.beginPath();
    this.context.moveTo(x - size, y - size);
    this.context.lineTo(x + size, y + size);
    this.context.moveTo(x - size, y + size);
    this.context.lineTo(x + size, y - size);
    this.context.stroke();
  }

  /** @param {number[]} point @param {string} text @param {string} colour @param {number} [lift]
   * @param {number} [beside] */
  text(point, text, colour, lift = 0, beside = 10) {
    const [x, y] = this.projection.flat(point);
    this.context.fillStyle = colour;
    this.context.font = "12px system-ui, sans-serif";
    const left = this.within(x + beside, this.context.measureText(text).width);
    this.context.fillText(text, left, this.freeLine(text, left, y - 4 - lift));
  }

  /** Where a name begins so that it ends in the view. @param {number} left @param {number} width */
  within(left, width) {
    return Math.max(2, Math.min(left, this.projection.size[0] - width - 2));
  }

  /** The line nearest to a wanted one at which a name meets no other. @param {string} text
   * @param {number} left @param {number} wanted */
  freeLine(text, left, wanted) {
    const right = left + this.context.measureText(text).width;
    for (const lines of [0, -1, 1, -2, 2, -3, 3, -4, 4]) {
      const y = wanted + lines * NAME_PX;
      const box = [left, y - NAME_PX, right, y];
      const meets = this.names.some((one) => one[0] < box[2] && box[0] < one[2] && one[1] < box[3] && box[1] < one[3]);
      if (meets || y < NAME_PX || y > this.projection.size[1]) continue;
      this.names.push(box);
      return y;
    }
    return wanted;
  }
}

export class Views {
  /** @param {Model} model */
  constructor(model) {
    this.plan = new View(model, "plan", "plan");
    /** @type {{draw: () => void}[]} */
    this.views = [this.plan, new View(model, "side", "side")];
    void this.openSpace(model);
    this.isDue = false;
    this.drawnAt = 0;
    new ResizeObserver(() => this.draw()).observe(this.plan.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      model.changes += 1;
      this.draw();
    });
  }

  /** Add the 3D view; the other views and the commands do not wait for its library. @param {Model} model */
  async openSpace(model) {
    const canvas = /** @type {HTMLCanvasElement} */ (document.getElementById("space"));
    const note = /** @type {HTMLElement} */ (document.getElementById("space-note"));
    const context = canvas.getContext("webgl2", { antialias: true, powerPreference: "low-power" });
    if (context) {
      const { SpaceView } = await import("./space_view.js");
      const view = new SpaceView(model, canvas, context);
      this.views.push(view);
      this.standIn(model, view, note);
    } else {
      note.textContent = "no WebGL in this browser: drawn without perspective";
      this.views.push(new View(model, "space", "space"));
    }
    this.draw();
  }

  /** Draw without WebGL while its context is lost, which may be for ever.
   * @param {Model} model @param {import("./space_view.js").SpaceView} view @param {HTMLElement} note */
  standIn(model, view, note) {
    const { canvas } = view;
    const other = /** @type {HTMLCanvasElement} */ (canvas.cloneNode());
    other.id = "space-flat";
    other.hidden = true;
    canvas.after(other);
    const flat = new View(model, other.id, "space");
    this.views.push(flat);
    const show = (/** @type {boolean} */ isLost) => {
      canvas.hidden = isLost;
      other.hidden = !isLost;
      note.textContent = isLost ? "the browser lost its graphics: drawn without perspective" : "";
      this.draw();
    };
    canvas.addEventListener("webglcontextlost", () => {
      view.forget();
      show(true);
    });
    canvas.addEventListener("webglcontextrestored", () => show(false));
    if (view.context.isContextLost()) show(true);
  }

  /** Draw at the next frame of the screen. */
  draw() {
    if (this.isDue) return;
    this.isDue = true;
    const wait = Math.max(0, this.drawnAt + DRAW_MS - performance.now());
    setTimeout(() => requestAnimationFrame(() => {
      this.isDue = false;
      this.drawnAt = performance.now();
      for (const view of this.views) view.draw();
    }), wait);
  }
}
