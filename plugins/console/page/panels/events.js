// @ts-check
// Events of the shown run, or of all runs, the newest first; always with commands.

import { runName } from "../flight_state.js";
import { by, clock, make, number } from "./dom.js";
import { sinceStart } from "./margins.js";

/** @typedef {import("../model.js").Model} Model */

const SHOWN_EVENTS = 150;

/** @param {Model} model */
export function showEvents(model) {
  const ofAll = /** @type {HTMLInputElement} */ (document.getElementById("events-all")).checked;
  const wanted = model.events.filter((one) => ofAll || !one.run || one.run === model.chosen);
  const sorted = model.mode === "recorded" ? wanted : wanted.toSorted((one, other) => one.when - other.when);
  by("events-of").textContent = ofAll ? "of all runs" : model.chosen ? `of ${runName(model.chosen)}` : "";
  by("events").replaceChildren(...sorted.slice(-SHOWN_EVENTS).toReversed().map((one) => line(one, model, ofAll)));
}

/** @param {any} one @param {Model} model @param {boolean} ofAll */
function line(one, model, ofAll) {
  const isCommand = one.kind === "command";
  const own = isCommand ? `${one.command} by ${one.who}: ${one.texts.join("; ")}` : [one.vehicle, one.word, one.text].filter(Boolean).join(" · ");
  const text = ofAll && one.run ? `${runName(one.run)}: ${own}` : own;
  const isSevere = one.severity !== null && one.severity !== undefined && one.severity <= 3;
  const item = make("li", "", `${one.kind}${isSevere ? " severe" : ""}`);
  const run_s = one.t_s === null ? "" : `${number(sinceStart(one.t_s, model.runs.get(one.run)?.view), 1)} s`;
  const time = make("time", model.mode === "recorded" ? run_s : clock(one.when));
  const kind = make("b", one.kind);
  if (run_s && model.mode !== "recorded") kind.append(make("small", ` ${run_s}`));
  item.append(time, kind, make("span", text));
  return item;
}
