// @ts-check
// The bar of a finished run: pause, speed, and a time line with the events that decided it.

import { showReply } from "./commands.js";
import { button, by, make, number } from "./panels/dom.js";
import { sinceStart } from "./panels/margins.js";

/** @typedef {import("./model.js").Model} Model */

const STEP_S = 1;
const MARKED = ["contact", "decisive", "flag", "guard", "operator"];
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 10, 100];

export class PlaybackBar {
  /** @param {Model} model */
  constructor(model) {
    this.model = model;
    this.speed = /** @type {HTMLSelectElement} */ (by("playback-speed"));
    this.line = /** @type {HTMLInputElement} */ (by("playback-line"));
    this.isDragged = false;
    this.marked = "";
    button("playback-pause").addEventListener("click", () => void this.send({ paused: !model.playback?.paused }));
    this.speed.addEventListener("change", () => void this.send({ speed: Number(this.speed.value) }));
    this.line.addEventListener("pointerdown", () => (this.isDragged = true));
    this.line.addEventListener("input", () => this.showTime(Number(this.line.value)));
    this.line.addEventListener("change", () => {
      this.isDragged = false;
      void this.send({ t_s: Number(this.line.value) });
    });
    for (const [name, steps] of /** @type {[string, number][]} */ ([["back", -STEP_S], ["forward", STEP_S]])) {
      button(`playback-${name}`).addEventListener("click", () => void this.send({ t_s: this.now() + steps }));
    }
  }

  /** @param {Record<string, number | boolean>} wanted */
  async send(wanted) {
    const reply = await showReply("/playback", wanted);
    if (!reply.ok) this.model.say(false, reply.text);
  }

  /** The time of the run that is shown, on its clock. */
  now() {
    const { playback, run } = this.model;
    return run?.view?.t_s ?? playback?.t_s ?? 0;
  }

  refresh() {
    const { playback, you } = this.model;
    by("playback").hidden = !playback;
    if (!playback) return;
    const isOperator = you?.role === "operator";
    for (const id of ["playback-pause", "playback-back", "playback-forward"]) button(id).disabled = !isOperator;
    this.line.disabled = this.speed.disabled = !isOperator;
    by("playback-pause").textContent = playback.paused ? "Play" : "Pause";
    this.showSpeed(playback.speed);
    this.line.min = String(playback.first_s);
    this.line.max = String(playback.last_s);
    if (!this.isDragged) {
      const t_s = Math.max(playback.first_s, this.now());
      this.line.value = String(t_s);
      this.showTime(t_s);
    }
    this.showMarks();
  }

  /** @param {number} speed */
  showSpeed(speed) {
    const speeds = [...new Set([...SPEEDS, speed])].toSorted((one, other) => one - other);
    if (this.speed.options.length !== speeds.length) this.speed.replaceChildren(...speeds.map((one) => new Option(`${one} ×`, String(one))));
    if (this.speed !== document.activeElement || this.speed.value === "") this.speed.value = String(speed);
  }

  /** @param {number} t_s */
  showTime(t_s) {
    const { playback, run } = this.model;
    const [now, whole] = [t_s, playback?.last_s ?? 0].map((one) => number(sinceStart(one, run?.view), 1));
    by("playback-time").textContent = `${now} of ${whole} s`;
    this.line.setAttribute("aria-valuetext", `${now} of ${whole} seconds`);
  }

  /** Mark the events of note that the page has seen. */
  showMarks() {
    const { playback, events, chosen } = this.model;
    const times = events.filter((one) => one.run === chosen && MARKED.includes(one.kind)).map((one) => one.t_s);
    const listed = times.join();
    if (listed === this.marked) return;
    this.marked = listed;
    const whole = Math.max(1e-9, playback.last_s - playback.first_s);
    by("playback-marks").replaceChildren(...times.map((t_s) => {
      const mark = make("i");
      mark.style.left = `${((t_s - playback.first_s) / whole) * 100}%`;
      return mark;
    }));
  }
}
