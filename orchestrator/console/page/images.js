// @ts-check
// Camera images: drawn as they come, with age and rate; real and mixed one over the other.

/** @typedef {import("./model.js").Model} Model */

const NAMES = ["real", "twin", "mixed"];
const STALE_S = 1.0;
const RATE_S = 3.0;

/** @typedef {{bitmap: ImageBitmap, head: any, at: number, times: number[]}} Shown */

export class Images {
  /** @param {Model} model */
  constructor(model) {
    this.model = model;
    /** @type {Map<string, Shown>} */
    this.shown = new Map();
    this.run = "";
    this.blend = /** @type {HTMLInputElement} */ (document.getElementById("blend"));
    this.blend.addEventListener("input", () => this.drawOverlay());
  }

  /** @param {any} head @param {Blob} jpeg */
  async take(head, jpeg) {
    if (head.run !== this.model.chosen) return;
    const bitmap = await createImageBitmap(jpeg);
    if (this.run !== head.run) this.forget(head.run);
    const before = this.shown.get(head.name);
    const at = performance.now();
    const times = [...(before?.times ?? []), at].filter((one) => one > at - RATE_S * 1000);
    before?.bitmap.close();
    this.shown.set(head.name, { bitmap, head, at, times });
    draw(canvas(`image-${head.name}`), [[bitmap, 1]]);
    if (head.name !== "twin") this.drawOverlay();
  }

  /** @param {string} run */
  forget(run) {
    this.run = run;
    for (const one of this.shown.values()) one.bitmap.close();
    this.shown.clear();
    for (const name of [...NAMES, "overlay"]) {
      const one = canvas(`image-${name}`);
      one.getContext("2d")?.clearRect(0, 0, one.width, one.height);
    }
  }

  drawOverlay() {
    const real = this.shown.get("real");
    const mixed = this.shown.get("mixed");
    /** @type {[ImageBitmap, number][]} */
    const layers = [];
    if (real) layers.push([real.bitmap, 1]);
    if (mixed) layers.push([mixed.bitmap, Number(this.blend.value) / 100]);
    if (layers.length) draw(canvas("image-overlay"), layers);
  }

  refresh() {
    if (this.run !== this.model.chosen) this.forget(this.model.chosen);
    const now = performance.now();
    let isOverlayStale = false;
    for (const name of NAMES) {
      const figure = /** @type {HTMLElement} */ (document.querySelector(`.picture[data-age=${name}]`));
      const one = this.shown.get(name);
      const [rate, age] = [figure.querySelector(".rate"), figure.querySelector(".age")];
      if (!rate || !age) continue;
      if (!one) {
        rate.textContent = "";
        age.textContent = "no image yet";
        continue;
      }
      const hz = one.times.length > 1 ? ((one.times.length - 1) * 1000) / (now - one.times[0]) : 0;
      const old = one.head.age_s + (now - one.at) / 1000;
      rate.textContent = `${hz.toFixed(0)} Hz${one.head.rendered ? ", rendered" : ""}`;
      age.textContent = `${old < 10 ? old.toFixed(2) : old.toFixed(0)} s old`;
      figure.classList.toggle("stale", old > STALE_S);
      isOverlayStale ||= name !== "twin" && old > STALE_S;
    }
    canvas("image-overlay").closest("figure")?.classList.toggle("stale", isOverlayStale);
  }
}

/** @param {string} id */
function canvas(id) {
  return /** @type {HTMLCanvasElement} */ (document.getElementById(id));
}

/** @param {HTMLCanvasElement} target @param {[ImageBitmap, number][]} layers */
function draw(target, layers) {
  const [first] = layers[0];
  if (target.width !== first.width || target.height !== first.height) {
    target.width = first.width;
    target.height = first.height;
    target.style.aspectRatio = `${first.width} / ${first.height}`;
  }
  const context = target.getContext("2d");
  if (!context) return;
  for (const [bitmap, alpha] of layers) {
    context.globalAlpha = alpha;
    context.drawImage(bitmap, 0, 0, target.width, target.height);
  }
  context.globalAlpha = 1;
}
