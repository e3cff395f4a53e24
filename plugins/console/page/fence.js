// @ts-check
// Editor of a fence on the plan: areas to stay in and to stay out of, polygons and circles, of the
// present fence or drawn anew where there is none; sent as the campaign's geofence. The views show the
// old fence until the runs have answered.

import { showReply } from "./commands.js";
import { campaignOf, hasEnded } from "./flight_state.js";
import { corners as outlineOf } from "./world.js";

/** @typedef {import("./model.js").Model} Model */
/** @typedef {import("./views.js").Views} Views */
/** @typedef {import("./projection.js").Projection} Projection */

/** An area; places are east, north. A circle has no corners.
 * @typedef {{isOut: boolean, corners: number[][] | null, centre: number[], radius: number}} Area */

const GRAB_PX = 14;
const DIGITS = 2;
const AROUND_M = 3;
const LEAST_RADIUS_M = 0.1;

/** @param {string} id */
const by = (id) => /** @type {HTMLInputElement} */ (document.getElementById(id));

export class FenceEditor {
  /** @param {Model} model @param {Views} views */
  constructor(model, views) {
    this.model = model;
    this.views = views;
    this.plan = views.plan;
    /** Null while not editing. @type {Area[] | null} */
    this.areas = null;
    this.chosen = 0;
    this.grabbed = -1;
    this.plan.overlay = (context, projection) => this.draw(context, projection);
    by("fence-edit").addEventListener("click", () => this.begin());
    by("fence-cancel").addEventListener("click", () => this.end());
    by("fence-polygon").addEventListener("click", () => this.add(square(this.middle(), this.step())));
    by("fence-circle").addEventListener("click", () => this.add({ isOut: false, corners: null, centre: this.middle(), radius: this.step() }));
    by("fence-remove").addEventListener("click", () => this.drop());
    by("fence-side").addEventListener("change", () => this.turn());
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
    by("fence-edit").hidden = this.areas !== null || !may;
    if (!may) this.end();
  }

  begin() {
    const fences = Object.values(this.model.run?.view?.fences ?? {});
    const fence = /** @type {any} */ (fences[0]);
    this.areas = fence ? areasOf(fence) : [this.around()];
    by("fence-floor").value = String(fence?.floor_up_m ?? -0.5);
    by("fence-ceiling").value = String(fence?.ceiling_up_m ?? this.ceiling());
    by("fence-form").hidden = false;
    this.plan.canvas.classList.add("held");
    this.choose(0);
  }

  /** A square around all vehicles, where there is no fence yet. */
  around() {
    const places = this.places();
    const [east, north] = [1, 0].map((axis) => places.map((one) => one[axis]));
    const [e0, e1] = [Math.min(...east) - AROUND_M, Math.max(...east) + AROUND_M];
    const [n0, n1] = [Math.min(...north) - AROUND_M, Math.max(...north) + AROUND_M];
    return { isOut: false, corners: [[e0, n0], [e1, n0], [e1, n1], [e0, n1]], centre: [], radius: 0 };
  }

  /** Above the highest vehicle. */
  ceiling() {
    return round(Math.max(...this.places().map((one) => -one[2])) + AROUND_M);
  }

  /** @returns {number[][]} */
  places() {
    const places = (this.model.run?.view?.vehicles ?? []).map((/** @type {any} */ one) => one.position_ned_m).filter(Boolean);
    return places.length ? places : [[0, 0, 0]];
  }

  /** The middle of what the plan shows. */
  middle() {
    return [...(this.plan.projection?.middle ?? [0, 0])];
  }

  /** A tenth of what the plan shows, metres. */
  step() {
    const { projection } = this.plan;
    return projection ? Math.min(...projection.size) / projection.scale / 10 : 1;
  }

  /** @param {Area} area */
  add(area) {
    if (!this.areas) return;
    this.areas.push(area);
    this.choose(this.areas.length - 1);
  }

  drop() {
    if (!this.areas || this.areas.length < 2) return;
    this.areas.splice(this.chosen, 1);
    this.choose(0);
  }

  turn() {
    if (this.areas) this.areas[this.chosen].isOut = by("fence-side").value === "exclude";
    this.views.draw();
  }

  /** @param {number} index */
  choose(index) {
    if (!this.areas) return;
    this.chosen = index;
    by("fence-side").value = this.areas[index].isOut ? "exclude" : "include";
    by("fence-remove").disabled = this.areas.length < 2;
    this.views.draw();
  }

  end() {
    if (this.areas === null) return;
    this.areas = null;
    by("fence-form").hidden = true;
    this.plan.canvas.classList.remove("held");
    this.views.draw();
  }

  async send() {
    if (!this.areas) return;
    const [include, exclude] = [false, true].map((isOut) => (this.areas ?? []).filter((one) => one.isOut === isOut).map(written));
    if (!include.length) return this.model.say(false, "A fence needs an area to stay in.");
    const up_m = [Number(by("fence-floor").value), Number(by("fence-ceiling").value)];
    const geofence = JSON.stringify({ include, ...(exclude.length && { exclude }), up_m });
    const reply = await showReply("/command", { command: "geofence", geofence, seen_s: this.model.status?.sent_s });
    this.model.say(reply.ok, reply.text);
    if (reply.ok) this.end();
  }

  /** @param {PointerEvent} event */
  grab(event) {
    const { areas } = this;
    if (!areas || !this.plan.projection) return;
    // The chosen area first: where two lie on each other, its handles are on top.
    const order = [this.chosen, ...areas.keys()].filter((one, index, all) => all.indexOf(one) === index);
    for (const index of order) {
      const { corners } = areas[index];
      this.grabbed = this.nearest(handles(areas[index]), event);
      if (this.grabbed < 0 && corners) {
        const side = this.nearest(middles(corners), event);
        if (side >= 0) {
          corners.splice(side + 1, 0, middles(corners)[side]);
          this.grabbed = side + 1;
        }
      }
      if (this.grabbed >= 0) {
        this.choose(index);
        this.plan.canvas.setPointerCapture(event.pointerId);
        return;
      }
    }
  }

  /** @param {PointerEvent} event */
  move(event) {
    if (!this.areas || this.grabbed < 0 || !this.plan.projection) return;
    const area = this.areas[this.chosen];
    const place = this.plan.projection.lifted(event.offsetX, event.offsetY);
    if (area.corners) area.corners[this.grabbed] = place;
    else if (this.grabbed === 0) area.centre = place;
    else area.radius = Math.max(LEAST_RADIUS_M, Math.hypot(place[0] - area.centre[0], place[1] - area.centre[1]));
    this.views.draw();
  }

  /** @param {MouseEvent} event */
  remove(event) {
    for (const { corners } of this.areas ?? []) {
      const at = corners && corners.length > 3 ? this.nearest(corners, event) : -1;
      if (at >= 0) corners?.splice(at, 1);
    }
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
    for (const [index, area] of (this.areas ?? []).entries()) {
      const style = getComputedStyle(document.documentElement);
      context.strokeStyle = context.fillStyle = style.getPropertyValue(area.isOut ? "--bad" : "--link");
      context.lineWidth = index === this.chosen ? 3 : 1.5;
      const outline = area.corners ?? outlineOf({ centre_m: [area.centre[1], area.centre[0]], radius_m: area.radius }).map(([n, e]) => [e, n]);
      context.beginPath();
      for (const [east, north] of outline) context.lineTo(...pair(projection.flat([north, east, 0])));
      context.closePath();
      context.stroke();
      this.mark(context, projection, handles(area), 6);
      if (area.corners) this.mark(context, projection, middles(area.corners), 3);
    }
  }

  /** @param {CanvasRenderingContext2D} context @param {Projection} projection @param {number[][]} places
   * @param {number} half */
  mark(context, projection, places, half) {
    for (const [east, north] of places) {
      const [x, y] = projection.flat([north, east, 0]);
      context.fillRect(x - half, y - half, 2 * half, 2 * half);
    }
  }
}

/** The areas of a fence, those to stay in first. @param {any} fence @returns {Area[]} */
function areasOf(fence) {
  const sides = [[fence.inclusions, false], [fence.exclusions, true]];
  return sides.flatMap(([areas, isOut]) =>
    areas.map((/** @type {any} */ one) => ({
      isOut,
      corners: one.corners_m ? one.corners_m.map((/** @type {number[]} */ at) => [at[1], at[0]]) : null,
      centre: one.centre_m ? [one.centre_m[1], one.centre_m[0]] : [],
      radius: one.radius_m ?? 0,
    })),
  );
}

/** An area as a campaign file has it. @param {Area} area */
function written(area) {
  if (area.corners) return { polygon: area.corners.map(([east, north]) => [round(north), round(east)]) };
  const [east_m, north_m] = area.centre.map(round);
  return { circle: { north_m, east_m, radius_m: round(area.radius) } };
}

/** A square around a place. @param {number[]} middle @param {number} half @returns {Area} */
function square([east, north], half) {
  const turns = [[-1, -1], [1, -1], [1, 1], [-1, 1]];
  return { isOut: false, corners: turns.map(([e, n]) => [east + e * half, north + n * half]), centre: [], radius: 0 };
}

/** What of an area is dragged: its corners, or its centre and a point of its edge. @param {Area} area */
function handles(area) {
  return area.corners ?? [area.centre, [area.centre[0] + area.radius, area.centre[1]]];
}

/** @param {number[]} flat @returns {[number, number]} */
function pair([x, y]) {
  return [x, y];
}

/** The middles of a polygon's sides. @param {number[][]} outline */
function middles(outline) {
  return outline.map((one, index) => {
    const next = outline[(index + 1) % outline.length];
    return [(one[0] + next[0]) / 2, (one[1] + next[1]) / 2];
  });
}

/** @param {number} value */
function round(value) {
  return Number(value.toFixed(DIGITS));
}
