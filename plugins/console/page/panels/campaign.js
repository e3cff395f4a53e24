// @ts-check
// The campaign's runs with their verdicts and reasons, and its guards.

import { countsText, shownVerdict } from "../flight_state.js";
import { by, make } from "./dom.js";

/** @typedef {import("../model.js").Model} Model */

const SHOWN_REASONS = 40;
const MEANINGS = {
  PASS: "all required oracles passed",
  FAIL: "an oracle failed: a contact, a breach, a limit",
  INVALID: "mixing or synchronisation exceeded its limits, or an operator held: the flight proves nothing",
  ERROR: "the vehicles, the machine or the program failed: nothing was tested",
  ABORTED: "an operator or pilot ended it",
};
/** Texts of the guard's phases. @type {Record<string, string>} */
const PHASES = {
  down: "is down: landed and disarmed",
  holding: "is being stopped in the air, before it lands",
  "not needed": "needs no landing by the guard",
  "on the ground": "is on the ground, being disarmed",
  descending: "is descending",
};

/** @param {any} campaign */
export function showCampaign(campaign) {
  if (!campaign) return by("matrix").replaceChildren(make("p", "none", "hint"));
  const names = new Set([...(campaign.planned ?? []), ...Object.keys(campaign.finished ?? {}), ...Object.keys(campaign.flying ?? {})]);
  /** @type {Map<string, HTMLElement[]>} */
  const rows = new Map();
  for (const name of names) {
    const [group, rep] = [name.split("/").slice(0, 2).join("/"), name.split("/")[2]];
    const verdict = shownVerdict(campaign, name);
    const flying = campaign.flying?.[name];
    const word = verdict?.text ?? (flying ? flying.stage : campaign.is_over || campaign.stopped ? "not flown" : "planned");
    const badge = make("span", `${rep} ${word}`, `badge ${verdict?.kind ?? (flying ? "flying" : "planned")}`);
    badge.title = campaign.reasons?.[name] ?? "";
    rows.set(group, [...(rows.get(group) ?? []), badge]);
  }
  const table = make("table");
  for (const [group, badges] of rows) {
    const row = make("tr");
    const cell = make("td");
    for (const badge of badges) cell.append(badge, " ");
    const title = make("th", group);
    title.setAttribute("scope", "row");
    row.append(title, cell);
    table.append(row);
  }
  const results = make("p", campaign.is_over ? "Report and results: " : "Results: ", "hint");
  results.append(make("code", campaign.is_over ? `${campaign.folder}/report.html` : campaign.folder));
  by("matrix").replaceChildren(make("p", `${campaign.name}: ${countsText(campaign)}`), table, reasons(campaign), meanings(campaign), results);
}

/** The reasons of runs that are not PASS. @param {any} campaign */
function reasons(campaign) {
  const list = make("ul", "", "reasons");
  // It scrolls: the keyboard reaches it.
  list.tabIndex = 0;
  list.setAttribute("aria-label", "Reasons of runs that did not pass");
  const why = Object.entries(campaign.finished ?? {}).filter(([name, verdict]) => verdict !== "PASS" && campaign.reasons?.[name]);
  for (const [name, verdict] of why.slice(-SHOWN_REASONS)) {
    const item = make("li");
    item.append(make("b", `${name} ${verdict}: `), campaign.reasons[name]);
    list.append(item);
  }
  return list;
}

/** The meanings of the verdicts that the campaign has. @param {any} campaign */
function meanings(campaign) {
  const present = new Set(Object.values(campaign.finished ?? {}));
  const texts = Object.entries(MEANINGS).filter(([kind]) => present.has(kind)).map(([kind, text]) => `${kind}: ${text}.`);
  return make("p", texts.join(" "), "hint");
}

/** @param {Model} model */
export function showGuards(model) {
  const guards = model.isOver ? [] : (model.status?.guards ?? []);
  const rows = guards.map((/** @type {any} */ one) => {
    const row = make("div");
    row.append(make("p", String(one.run ?? one.name)));
    if (!one.is_answering) {
      row.append(make("span", "does not answer", "badge FAIL"));
      return row;
    }
    const state = one.latched ? [`has taken over: ${one.latched}`, "FAIL"] : one.held ? ["holds all vehicles", "INVALID"] : ["forwards setpoints", "PASS"];
    row.append(make("span", state[0], `badge ${state[1]}`));
    if (one.orchestrator === "lost") row.append(make("span", "its orchestrator is lost", "badge FAIL"));
    const list = Object.entries(one.vehicles ?? {}).map(([name, phase]) => make("li", `${name} ${PHASES[String(phase)] ?? phase}`));
    if (one.latched || one.held) {
      const phases = make("ul");
      phases.append(...list);
      row.append(phases);
    }
    return row;
  });
  by("guards").replaceChildren(...(rows.length ? rows : [make("p", whyNone(model), "hint")]));
}

/** @param {Model} model */
function whyNone(model) {
  const view = model.run?.view;
  if (model.mode === "recorded") return "recorded run: the guard's actions are among the events";
  if (view?.clock === "virtual") return "under the virtual clock the guard is in the run's process: see its events";
  if (view?.stage === "end" || model.isOver) return "the run and its guard have ended; the guard's actions are among the events";
  return "no guard runs now: each run starts one before its vehicles";
}
