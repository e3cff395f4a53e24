// @ts-check
// Three views of the world: from above, from the side, in space. One drawing, three directions.

import { axes, Projection, rotate } from "./projection.js";

/** @typedef {import("./model.js").Model} Model */
/** @typedef {import("./model.js").Run} Run */
/** @typedef {[number, number, number]} Point */

const LIGHT = [-0.35, 0.25, -0.9];
const PAD_M = 0.7;
const ARM_M = 0.28;
const DRAW_MS = 80;

class View {
  /** @param {Model} model @param {string} id @param {"plan" | "side" | "space"} kind */
  constructor(model, id, kind) {
    this.model = model;
    this.kind = kind;
    this.canvas = /** @type {HTMLCanvasElement} */ (document.getElementById(id));
    this.azimuth = (205 * Math.PI) / 180;
    this.elevation = (32 * Math.PI) / 180;
    this.zoom = 1;
    /** @type {number[] | null} */
    this.grabbed = null;
    /** @type {Projection | null} */
    this.projection = null;
    /** @type {((context: CanvasRenderingContext2D, projection: Projection) => void) | null} */
    this.overlay = null;
    if (kind === "space") this.listen();
  }

  listen() {
    this.canvas.addEventListener("pointerdown", (event) => {
      this.grabbed = [event.clientX, event.clientY];
      this.canvas.setPointerCapture(event.pointerId);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!this.grabbed) return;
      this.azimuth += (event.clientX - this.grabbed[0]) * 0.01;
      const elevation = this.elevation + (event.clientY - this.grabbed[1]) * 0.01;
      this.elevation = Math.min(1.55, Math.max(0.02, elevation));
      this.grabbed = [event.clientX, event.clientY];
      this.draw();
    });
    this.canvas.addEventListener("pointerup", () => (this.grabbed = null));
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom = Math.min(20, Math.max(0.2, this.zoom * Math.exp(-event.deltaY * 0.001)));
      this.draw();
    }, { passive: false });
    this.canvas.addEventListener("dblclick", () => {
      this.azimuth = (205 * Math.PI) / 180;
      this.elevation = (32 * Math.PI) / 180;
      this.zoom = 1;
      this.draw();
    });
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
    const directions = axes(this.kind, points, this.azimuth, this.elevation);
    const projection = Projection.fitting(directions, points, width, height, this.zoom);
    this.projection = projection;
    new Drawing(context, projection, this.kind, colours()).run(run);
    this.overlay?.(context, projection);
  }
}

class Drawing {
  /** @param {CanvasRenderingContext2D} context @param {Projection} projection
   * @param {string} kind @param {Record<string, string>} colours */
  constructor(context, projection, kind, colours) {
    this.context = context;
    this.projection = projection;
    this.kind = kind;
    this.colours = colours;
  }

  /** @param {Run} run */
  run(run) {
    this.ground(run);
    this.objects(run);
    for (const fence of Object.values(run.view?.fences ?? {})) this.fence(fence);
    for (const target of run.scene?.targets ?? []) this.cross(target, this.colours.dim, 4);
    for (const [name, trail] of run.trails) this.line(trail, this.colours[name] ?? this.colours.ink, 1.5);
    for (const place of run.contacts) this.ring(place, this.colours.bad, 9, 3);
    for (const vehicle of run.view?.vehicles ?? []) this.vehicle(vehicle);
  }

  /** @param {Run} run */
  ground(run) {
    if (this.kind === "side") {
      const [low, high] = this.projection.span;
      this.line([low, high], this.colours.rule, 1);
      return;
    }
    const points = extent(run);
    const [north, east] = [0, 1].map((axis) => points.map((one) => one[axis]));
    const [n0, n1] = [Math.floor(Math.min(...north)), Math.ceil(Math.max(...north))];
    const [e0, e1] = [Math.floor(Math.min(...east)), Math.ceil(Math.max(...east))];
    const step = 10 ** Math.max(0, Math.ceil(Math.log10(Math.max(n1 - n0, e1 - e0) / 30)));
    for (let n = n0; n <= n1; n += step) this.line([[n, e0, 0], [n, e1, 0]], this.colours.grid, 1);
    for (let e = e0; e <= e1; e += step) this.line([[n0, e, 0], [n1, e, 0]], this.colours.grid, 1);
    this.text([n0, e0, 0], `grid ${step} m`, this.colours.dim);
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
        this.box(vertices, edge);
        continue;
      }
      for (const face of thing.faces) faces.push(this.face(face.map((/** @type {number} */ i) => vertices[i]), thing));
      this.text(vertices[0], thing.name, edge);
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

  /** @param {number[][]} corners @param {any} thing */
  face(corners, thing) {
    const [a, b, c] = corners;
    const [u, v] = [b, c].map((one) => one.map((value, axis) => value - a[axis]));
    const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const length = Math.hypot(...normal) || 1;
    const shade = 0.55 + 0.45 * Math.max(0, normal.reduce((sum, value, axis) => sum + value * LIGHT[axis], 0) / length);
    const [red, green, blue] = thing.rgb.map((/** @type {number} */ one) => Math.round(one * shade));
    const depth = (this.projection.depth(a) + this.projection.depth(b) + this.projection.depth(c)) / 3;
    return { depth, points: corners, fill: `rgb(${red} ${green} ${blue})`, alpha: thing.is_virtual ? 0.85 : 1 };
  }

  /** @param {number[][]} vertices @param {string} colour */
  box(vertices, colour) {
    const low = [0, 1, 2].map((axis) => Math.min(...vertices.map((one) => one[axis])));
    const high = [0, 1, 2].map((axis) => Math.max(...vertices.map((one) => one[axis])));
    for (const down of [low[2], high[2]]) {
      this.line([[low[0], low[1], down], [high[0], low[1], down], [high[0], high[1], down], [low[0], high[1], down], [low[0], low[1], down]], colour, 1);
    }
    for (const [n, e] of [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]]) {
      this.line([[n, e, low[2]], [n, e, high[2]]], colour, 1);
    }
  }

  /** @param {any} fence */
  fence(fence) {
    const downs = [fence.floor_up_m, fence.ceiling_up_m].map((up) => -(up ?? 0));
    this.context.setLineDash([6, 4]);
    for (const area of [...fence.inclusions, ...fence.exclusions]) {
      const corners = area.corners_m ?? circle(area);
      for (const down of downs) {
        const points = corners.map((/** @type {number[]} */ one) => [one[0], one[1], down]);
        this.line([...points, points[0]], this.colours.fence, 1.8);
      }
      if (this.kind === "plan" || corners.length > 12) continue;
      for (const [n, e] of corners) this.line([[n, e, downs[0]], [n, e, downs[1]]], this.colours.fence, 1);
    }
    this.context.setLineDash([]);
  }

  /** @param {any} vehicle */
  vehicle(vehicle) {
    const place = vehicle.position_ned_m;
    if (!isPoint(place)) return;
    const colour = this.colours[vehicle.name] ?? this.colours.ink;
    if (this.kind === "space") this.line([place, [place[0], place[1], 0]], colour, 0.7);
    this.setpoint(vehicle, place, colour);
    const q = vehicle.q_wxyz ?? [1, 0, 0, 0];
    const arms = [[1, 1, 0], [-1, -1, 0], [1, -1, 0], [-1, 1, 0]].map((one) => rotate(q, one.map((x) => x * ARM_M), place));
    this.line([arms[0], arms[1]], colour, 3);
    this.line([arms[2], arms[3]], colour, 3);
    this.line([place, rotate(q, [ARM_M * 1.9, 0, 0], place)], colour, 2);
    for (const arm of arms) this.ring(arm, colour, 3, 1.5);
    this.text(place, vehicle.name, colour, vehicle.name === "twin" ? -22 : 12);
  }

  /** @param {any} vehicle @param {number[]} place @param {string} colour */
  setpoint(vehicle, place, colour) {
    if (!isPoint(vehicle.setpoint)) return;
    const isPosition = vehicle.setpoint_kind === "position";
    const end = isPosition ? vehicle.setpoint : place.map((one, axis) => one + vehicle.setpoint[axis]);
    this.context.setLineDash([2, 3]);
    this.line([place, end], colour, 1.2);
    this.context.setLineDash([]);
    if (isPosition) this.ring(end, colour, 5, 1.5);
    else this.cross(end, colour, 3);
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

  /** @param {number[]} point @param {string} text @param {string} colour @param {number} [lift] */
  text(point, text, colour, lift = 0) {
    const [x, y] = this.projection.flat(point);
    this.context.fillStyle = colour;
    this.context.font = "12px system-ui, sans-serif";
    this.context.fillText(text, x + 10, y - 4 - lift);
  }
}

export class Views {
  /** @param {Model} model */
  constructor(model) {
    this.plan = new View(model, "plan", "plan");
    /** @type {View[]} */
    this.views = [this.plan, new View(model, "side", "side"), new View(model, "space", "space")];
    this.isDue = false;
    this.drawnAt = 0;
    new ResizeObserver(() => this.draw()).observe(this.views[0].canvas);
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

/** Where everything of a run is that has to be seen. @param {Run} run @returns {number[][]} */
function extent(run) {
  /** @type {number[][]} */
  const points = [[-PAD_M, -PAD_M, 0], [PAD_M, PAD_M, 0]];
  for (const thing of run.scene?.objects ?? []) {
    const pose = run.view?.moving?.[thing.name] ?? thing.pose;
    const step = Math.max(1, Math.floor(thing.vertices_m.length / 40));
    thing.vertices_m.forEach((/** @type {number[]} */ one, /** @type {number} */ index) => {
      if (index % step === 0) points.push(rotate(pose.q_wxyz, one, pose.position_ned_m));
    });
  }
  for (const fence of Object.values(run.view?.fences ?? {})) {
    const downs = [/** @type {any} */ (fence).floor_up_m ?? 0, /** @type {any} */ (fence).ceiling_up_m ?? 0];
    for (const area of /** @type {any} */ (fence).inclusions) {
      for (const [n, e] of area.corners_m ?? circle(area)) for (const up of downs) points.push([n, e, -up]);
    }
  }
  for (const trail of run.trails.values()) if (trail.length) points.push(trail[0], trail[trail.length - 1]);
  return points;
}

/** @param {any} area */
function circle(area) {
  return Array.from({ length: 36 }, (_, index) => {
    const turn = (index / 36) * 2 * Math.PI;
    return [area.centre_m[0] + area.radius_m * Math.cos(turn), area.centre_m[1] + area.radius_m * Math.sin(turn)];
  });
}

/** @param {any} point */
function isPoint(point) {
  return Array.isArray(point) && point.every((one) => typeof one === "number");
}

function colours() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "dim", "rule", "grid", "real", "twin", "fence", "bad", "virtual", "physical"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}
