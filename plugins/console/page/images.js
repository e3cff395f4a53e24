// @ts-check
// Camera images: the newest of each camera is drawn, with age and rate; and the mixed over the real
// image.

import { hasEnded } from "./flight_state.js";
import { number } from "./panels/dom.js";
import { sinceStart } from "./panels/margins.js";
import { colours } from "./world.js";

/** @typedef {import("./model.js").Model} Model */

const NAMES = ["real", "twin", "mixed"];
const STALE_S = 1.0;
const RATE_S = 3.0;
const OVERLAY_MS = 125;
const KIND = "image/jpeg";
const MOST_RUNS = 8;

/** @typedef {VideoFrame | ImageBitmap} Decoded */
/** @typedef {{head: any, jpeg: Uint8Array<ArrayBuffer>, at: number}} Received */
/** @typedef {{image: Decoded, head: any, at: number, times: number[]}} Shown */

export class Images {
  /** @param {Model} model */
  constructor(model) {
    this.model = model;
    /** @type {Map<string, Shown>} */
    this.shown = new Map();
    this.run = "";
    /** The newest image of each camera. @type {Map<string, any>} */
    this.newest = new Map();
    /** The newest images of each run, to show when a run is chosen again.
     * @type {Map<string, Map<string, Received>>} */
    this.received = new Map();
    /** The running decoding of each camera. @type {Map<string, Promise<unknown>>} */
    this.decoding = new Map();
    this.hasBegun = false;
    this.isOverlayDue = false;
    this.overlaidAt = 0;
    this.blend = /** @type {HTMLInputElement} */ (document.getElementById("blend"));
    this.blend.addEventListener("input", () => this.drawOverlay());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => (this.hasBegun = false));
  }

  /** Draw an image, unless a newer one of its camera arrives before it is decoded.
   * @param {any} head @param {Uint8Array<ArrayBuffer>} jpeg */
  async take(head, jpeg) {
    const at = performance.now();
    this.remember(head, jpeg, at);
    if (head.run === this.model.chosen) await this.present(head, jpeg, at);
  }

  /** @param {any} head @param {Uint8Array<ArrayBuffer>} jpeg @param {number} at */
  remember(head, jpeg, at) {
    const received = this.received.get(head.run) ?? new Map();
    this.received.set(head.run, received);
    received.set(head.name, { head, jpeg, at });
    for (const run of this.received.keys()) {
      if (this.received.size > MOST_RUNS && run !== head.run) this.received.delete(run);
    }
  }

  /** @param {any} head @param {Uint8Array<ArrayBuffer>} jpeg @param {number} at */
  async present(head, jpeg, at) {
    this.newest.set(head.name, head);
    await this.decoding.get(head.name)?.catch(() => null);
    if (this.newest.get(head.name) !== head) return;
    const decoding = decoded(jpeg);
    this.decoding.set(head.name, decoding);
    const image = await decoding;
    if (head.run === this.model.chosen) this.show(head, image, at);
    else image.close();
  }

  /** @param {any} head @param {Decoded} image @param {number} at arrival, ms */
  show(head, image, at) {
    if (this.run !== head.run) this.forget(head.run);
    const before = this.shown.get(head.name);
    const times = [...(before?.times ?? []), at].filter((one) => one > at - RATE_S * 1000);
    before?.image.close();
    this.shown.set(head.name, { image, head, at, times });
    draw(canvas(`image-${head.name}`), [[image, 1]]);
    if (head.name !== "twin") this.refreshOverlay();
  }

  /** @param {string} run */
  forget(run) {
    this.run = run;
    for (const one of this.shown.values()) one.image.close();
    this.shown.clear();
    for (const name of [...NAMES, "overlay"]) {
      const one = canvas(`image-${name}`);
      const context = one.getContext("2d", { alpha: false });
      if (!context) continue;
      context.fillStyle = colours().page;
      context.fillRect(0, 0, one.width, one.height);
    }
  }

  /** Draw the overlay after the images, and less often: it costs as much as they do. */
  refreshOverlay() {
    if (this.isOverlayDue) return;
    this.isOverlayDue = true;
    setTimeout(() => {
      this.isOverlayDue = false;
      this.overlaidAt = performance.now();
      this.drawOverlay();
    }, Math.max(0, this.overlaidAt + OVERLAY_MS - performance.now()));
  }

  drawOverlay() {
    const real = this.shown.get("real");
    const mixed = this.shown.get("mixed");
    /** @type {[Decoded, number][]} */
    const layers = [];
    if (real) layers.push([real.image, 1]);
    if (mixed) layers.push([mixed.image, Number(this.blend.value) / 100]);
    if (layers.length) draw(canvas("image-overlay"), layers);
  }

  refresh() {
    if (!this.hasBegun || this.run !== this.model.chosen) {
      this.hasBegun = true;
      this.forget(this.model.chosen);
      for (const one of this.received.get(this.run)?.values() ?? []) void this.present(one.head, one.jpeg, one.at);
    }
    const { run } = this.model;
    const isEnded = run !== undefined && (hasEnded(this.model, run) || this.model.isOver);
    // Drawn images and mixtures end with the goal; a live camera's go on, and may stall.
    const isLanding = run !== undefined && ["land", "landed"].includes(run.view?.stage);
    const now = performance.now();
    let isOverlayStale = false;
    for (const name of NAMES) {
      const figure = /** @type {HTMLElement} */ (document.querySelector(`.camera[data-age=${name}]`));
      const one = this.shown.get(name);
      const [rate, age] = [figure.querySelector(".rate"), figure.querySelector(".age")];
      if (!rate || !age) continue;
      if (!one) {
        rate.textContent = "";
        age.textContent = isEnded ? "no image of this run" : "no image yet";
        figure.classList.remove("stale");
        continue;
      }
      const hz = one.times.length > 1 ? ((one.times.length - 1) * 1000) / (now - one.times[0]) : 0;
      const old = one.head.age_s + (now - one.at) / 1000;
      rate.textContent = `${hz.toFixed(0)} Hz${one.head.rendered ? ", rendered" : ""}`;
      if (run?.view?.clock === "recorded") {
        rate.textContent = one.head.rendered ? "rendered" : "";
        age.textContent = `at ${number(sinceStart(one.head.t_s, run.view), 1)} s`;
        figure.classList.remove("stale");
        continue;
      }
      const isLast = isEnded || (isLanding && old > STALE_S && (one.head.rendered || name !== "real"));
      age.textContent = isLast ? "last image of the run" : `${old < 10 ? old.toFixed(2) : old.toFixed(0)} s old`;
      if (isLast) rate.textContent = one.head.rendered ? "rendered" : "";
      figure.classList.toggle("stale", !isLast && old > STALE_S);
      figure.classList.toggle("alone", Boolean(one.head.alone));
      if (one.head.alone) rate.textContent = `TWIN MISSING IN THE MIXTURE (${one.head.alone.replaceAll("_", " ")})`;
      isOverlayStale ||= name !== "twin" && !isLast && old > STALE_S;
    }
    canvas("image-overlay").closest("figure")?.classList.toggle("stale", isOverlayStale);
  }
}

/** Decode a JPEG. ImageDecoder reads it in place; a blob passes through the browser process.
 * @param {Uint8Array<ArrayBuffer>} jpeg @returns {Promise<Decoded>} */
async function decoded(jpeg) {
  if (!("ImageDecoder" in window)) return await createImageBitmap(new Blob([jpeg], { type: KIND }));
  const decoder = new ImageDecoder({ data: jpeg, type: KIND });
  try {
    return (await decoder.decode()).image;
  } finally {
    decoder.close();
  }
}

/** @param {string} id */
function canvas(id) {
  return /** @type {HTMLCanvasElement} */ (document.getElementById(id));
}

/** @param {HTMLCanvasElement} target @param {[Decoded, number][]} layers */
function draw(target, layers) {
  const [first] = layers[0];
  const [width, height] = "displayWidth" in first ? [first.displayWidth, first.displayHeight] : [first.width, first.height];
  if (target.width !== width || target.height !== height) {
    target.width = width;
    target.height = height;
    target.style.aspectRatio = `${width} / ${height}`;
  }
  const context = target.getContext("2d", { alpha: false });
  if (!context) return;
  for (const [image, alpha] of layers) {
    context.globalAlpha = alpha;
    context.drawImage(image, 0, 0, target.width, target.height);
  }
  context.globalAlpha = 1;
}
