// @ts-check
// All panels of the page; they are refreshed when their data changes.

import { hasEnded } from "./flight_state.js";
import { showCampaign, showGuards } from "./panels/campaign.js";
import { by } from "./panels/dom.js";
import { showEvents } from "./panels/events.js";
import { Head } from "./panels/head.js";
import { showMargins } from "./panels/margins.js";
import { showPeople, showVehicles } from "./panels/vehicles.js";

/** @typedef {import("./model.js").Model} Model */

const STALE_S = 1.5;
const PANELS_MS = 400;

export class Panels {
  /** @param {Model} model @param {() => void} redraw the views: another run is shown */
  constructor(model, redraw) {
    this.model = model;
    this.head = new Head(model, redraw);
    this.drawn = -1;
    this.drawnAt = 0;
    by("events-all").addEventListener("change", () => (model.changes += 1));
  }

  /** Show a lost connection; not after the console has ended with its campaign. @param {string} text @param {boolean} isLost */
  lost(text, isLost) {
    by("lost").hidden = !isLost || this.model.isOver;
    if (isLost) by("lost-text").textContent = text;
    // Of a recorded run nothing flies on.
    by("lost-hint").hidden = this.model.mode === "recorded";
    by("lost-recorded").hidden = this.model.mode !== "recorded";
  }

  refresh() {
    this.showAges();
    this.head.showTime();
    const now = performance.now();
    if (this.drawn === this.model.changes || now - this.drawnAt < PANELS_MS) return;
    this.drawn = this.model.changes;
    this.drawnAt = now;
    this.head.show();
    showVehicles(this.model);
    showGuards(this.model);
    showMargins(this.model.run);
    showCampaign(this.head.campaign());
    showEvents(this.model);
    showPeople(this.model);
  }

  showAges() {
    const now = performance.now();
    const { model } = this;
    const { run } = model;
    const isEnded = run ? hasEnded(model, run) || model.isOver : false;
    const isRecorded = model.mode === "recorded";
    const ages = { run: run?.view ? (now - run.at) / 1000 : null, status: model.status ? (now - model.statusAt) / 1000 : null };
    for (const [key, age] of Object.entries(ages)) {
      const isOver = key === "run" ? isEnded : model.isOver;
      for (const one of document.querySelectorAll(`.aged[data-age=${key}]`)) {
        one.classList.toggle("ended", isOver);
        one.classList.toggle("stale", !isOver && !isRecorded && age !== null && age > STALE_S);
        const text = one.querySelector(".age");
        if (text) text.textContent = age === null ? "" : isOver ? "as at the end" : isRecorded ? (model.playback?.paused ? "paused" : "") : `${age.toFixed(1)} s old`;
      }
    }
  }
}
