// @ts-check
// Editor of a fence on the plan: drag its corners, send it as the campaign's geofence. The views show
// the old fence until the runs have answered.

import { showReply } from "./commands.js";
import { campaignOf, hasEnded } from "./flight_state.js";

/** @typedef {import("./model.js").Model} Model */
/** @typedef {import("./views.js").Views} Views */
/** @typedef {import("./projection.js").Projection} Projection */

const GRAB_PX = 14;
const DIGITS = 2;

/** @param {string} id */
const by = (id) => /** @type {HTMLInputElement} */ (document.getElementById(id));

export class FenceEditor {
  /** @param {Model} model @param {Views} views */
  constructor(model, views) {
    this.model = model;
    this.views = views;
    this.plan = views.plan;
    /** Corners as east, north; null while not editing. @type {number[][] | null} */
    this.corners = null;
    this.grabbed = -1;
    this.plan.overlay = (context, projection) => this.draw(context, projection);
    by("fence-edit").addEventListener("click", () => this.begin());
    by("fence-cancel").addEventListener("click", () => this.end());
    by("fence-form").addEventListener("submit", (event) => {
      event.preventDefault();
      void this.send();
    });
    const { canvas } = this.plan;
    canvas.addEventListener("pointerdown", (event) => this.grab(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", () => (this.grabbed = -1));
    canvas.addEventListener("dblclick", (event) => this.remove(event));
  }

  refresh() {
    const { run } = this.model;
    const may = this.model.hasControl && this.model.mode === "live" && !this.model.isOver && run !== undefined && !hasEnded(this.model, run) && !campaignOf(this.model, run.key)?.stopped;
    const present = Object.keys(this.model.run?.view?.fences ?? {}).length > 0;
    by("fence-edit").hidden = this.corners !== null || !may || !present;
    if (!may) this.end();
  }

  begin() {
    const fences = Object.values(this.model.run?.view?.fences ?? {});
    const fence = /** @type {any} */ (fences[0]);
    const [drawn, ...more] = fence?.inclusions ?? [];
    if (!drawn?.corners_m || more.length || fence.exclusions.length) {
      this.model.say(false, "The present fence is not a single polygon: use wil-campaign fence.");
      return;
    }
    this.corners = drawn.corners_m.map((/** @type {number[]} */ one) => [one[1], one[0]]);
    by("fence-floor").value = String(fence.floor_up_m ?? -0.5);
    by("fence-ceiling").value = String(fence.ceiling_up_m ?? 3);
    by("fence-form").hidden = false;
    this.plan.canvas.classList.add("held");
    this.views.draw();
  }

  end() {
    if (this.corners === null) return;
    this.corners = null;
    by("fence-form").hidden = true;
    this.plan.canvas.classList.remove("held");
    this.views.draw();
  }

  async send() {
    if (!this.corners) return;
    const polygon = this.corners.map(([east, north]) => [round(north), round(east)]);
    const up = [Number(by("fence-floor").value), Number(by("fence-ceiling").value)];
    const geofence = JSON.stringify({ include: [{ polygon }], up_m: up });
    const reply = await showReply("/command", { command: "geofence", geofence });
    this.model.say(reply.ok, reply.text);
    if (reply.ok) this.end();
  }

  /** @param {PointerEvent} event */
  grab(event) {
    const { corners } = this;
    if (!corners || !this.plan.projection) return;
    this.grabbed = this.nearest(corners, event);
    if (this.grabbed < 0) {
      const side = this.nearest(middles(corners), event);
      if (side >= 0) {
        corners.splice(side + 1, 0, middles(corners)[side]);
        this.grabbed = side + 1;
      }
    }
    if (this.grabbed >= 0) this.plan.canvas.setPointerCapture(event.pointerId);
  }

  /** @param {PointerEvent} event */
  move(event) {
    if (!this.corners || this.grabbed < 0 || !this.plan.projection) return;
    this.corners[this.grabbed] = this.plan.projection.lifted(event.offsetX, event.offsetY);
    this.views.draw();
  }

  /** @param {MouseEvent} event */
  remove(event) {
    if (!this.corners || this.corners.length <= 3) return;
    const at = this.nearest(this.corners, event);
    if (at >= 0) this.corners.splice(at, 1);
    this.views.draw();
  }

  /** @param {number[][]} points @param {MouseEvent} event */
  nearest(points, event) {
    const { projection } = this.plan;
    if (!projection) return -1;
    return points.findIndex(([east, north]) => {
      const [x, y] = projection.flat([north, east, 0]);
      return Math.hypot(x - event.offsetX, y - event.offsetY) < GRAB_PX;
    });
  }

  /** @param {CanvasRenderingContext2D} context @param {Projection} projection */
  draw(context, projection) {
    if (!this.corners) return;
    const flat = this.corners.map(([east, north]) => projection.flat([north, east, 0]));
    context.strokeStyle = context.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--link");
    context.lineWidth = 2.5;
    context.beginPath();
    flat.forEach(([x, y], index) => (index ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.closePath();
    context.stroke();
    for (const [x, y] of flat) context.fillRect(x - 6, y - 6, 12, 12);
    for (const [east, north] of middles(this.corners)) {
      const [x, y] = projection.flat([north, east, 0]);
      context.fillRect(x - 3, y - 3, 6, 6);
    }
  }
}

/** The middles of a polygon's sides. @param {number[][]} corners */
function middles(corners) {
  return corners.map((one, index) => {
    const next = corners[(index + 1) % corners.length];
    return [(one[0] + next[0]) / 2, (one[1] + next[1]) / 2];
  });
}

/** @param {number} value */
function round(value) {
  return Number(value.toFixed(DIGITS));
}
