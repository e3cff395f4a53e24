// @ts-check
// Derives texts from the model: verdict, vehicles in the air, progress of an abort; no drawing.

import { clock } from "./panels/dom.js";

/** @typedef {import("./model.js").Model} Model */
/** @typedef {import("./model.js").Run} Run */
/** @typedef {{label: string, text: string, kind: string, reason: string, isFinal: boolean}} Verdict */

const OLD_S = 3;
const BEFORE_ABORT_MS = 5000;

/** Case, mode and repetition. @param {string} key */
export function runName(key) {
  return key.split("/").slice(-3).join("/");
}

/** The campaign of a run. @param {Model} model @param {string} key @returns {any} */
export function campaignOf(model, key) {
  return (model.status?.campaigns ?? []).find((/** @type {any} */ one) => key.startsWith(`${one.folder}/`));
}

/** Whether a run has ended, with a verdict or before it has one. @param {Model} model @param {Run} run */
export function hasEnded(model, run) {
  return run.view?.stage === "end" || finalOf(model, run) !== "";
}

/** The final verdict of a run; empty before it has one. @param {Model} model @param {Run} run @returns {string} */
export function finalOf(model, run) {
  // A recorded run has its verdict in its last view alone, in whatever stage it ended.
  if (model.mode === "recorded") return run.view?.verdict_so_far ?? "";
  const campaign = campaignOf(model, run.key);
  const name = campaign ? run.key.slice(campaign.folder.length + 1) : "";
  return campaign?.flying?.[name] ? "" : (campaign?.finished?.[name] ?? "");
}

/** A finished run's verdict with its colour. A control must not pass: its PASS is red, and the FAIL that it must have is not.
 * @param {any} campaign @param {string} name @returns {{text: string, kind: string} | undefined} */
export function shownVerdict(campaign, name) {
  const verdict = campaign.finished?.[name];
  const isMet = campaign.controls?.[name];
  if (!verdict || isMet === undefined) return verdict && { text: verdict, kind: verdict };
  return isMet ? { text: `${verdict}, as a control must`, kind: "planned" } : { text: `${verdict}: control NOT met`, kind: "FAIL" };
}

/** The verdict in the head; never PASS before the verdict is final.
 * @param {Model} model @param {Run | undefined} run @returns {Verdict} */
export function verdictOf(model, run) {
  const view = run?.view;
  const final = run ? finalOf(model, run) : "";
  const campaign = run && campaignOf(model, run.key);
  if (run && final) {
    const reason = campaign?.reasons?.[run.key.slice(campaign.folder.length + 1)] || view?.reason || "";
    const shown = campaign && shownVerdict(campaign, run.key.slice(campaign.folder.length + 1));
    return { label: "Verdict, final", text: shown?.text ?? final, kind: shown?.kind ?? final, reason, isFinal: true };
  }
  const open = { label: "Verdict so far", kind: "planned", reason: view?.reason ?? "", isFinal: false };
  if (!view) return { ...open, text: "–" };
  if (view.verdict_so_far && view.verdict_so_far !== "PASS") return { ...open, text: view.verdict_so_far, kind: view.verdict_so_far };
  if (model.mode === "recorded") return { ...open, text: "at the end" };
  if (view.stage === "end") return { ...open, text: campaign?.is_over || model.isOver ? "no verdict" : "being judged" };
  const isMeasured = view.margins.some((/** @type {any} */ one) => one.required && one.actual !== null);
  return { ...open, text: isMeasured ? "no failure so far" : "not measured" };
}

/** @typedef {{run: Run, name: string, isUp: boolean, armed: boolean, hasLink: boolean, age_s: number}} Aloft */

/** The known states of a run's vehicles, in the order of its newest state.
 * @param {Run} run */
function flownOf(run) {
  const names = (run.view?.vehicles ?? []).map((/** @type {any} */ one) => one.name);
  return [...run.flown].toSorted(([one], [other]) => names.indexOf(one) - names.indexOf(other));
}

/** All vehicles of all runs that are known to be off the ground or armed. @param {Model} model @returns {Aloft[]} */
export function aloft(model) {
  const now = performance.now();
  const runs = model.mode === "recorded" ? [model.run].filter((one) => one !== undefined) : [...model.runs.values()];
  return runs.flatMap((run) =>
    flownOf(run).flatMap(([name, one]) =>
      one.isUp || one.armed ? [{ run, name, isUp: one.isUp, armed: one.armed, hasLink: one.hasLink, age_s: (now - run.at) / 1000 }] : []));
}

/** Where a run flies that this page does not see, and its stage by the campaign's status.
 * @typedef {{folder: string, place: string, stage: string}} Unseen */

/** The runs in flight whose present state this page does not see, as on other nodes. @param {Model} model @returns {Unseen[]} */
function unseen(model) {
  const now = performance.now();
  const campaigns = (model.status?.campaigns ?? []).filter((/** @type {any} */ one) => !one.is_over);
  return campaigns.flatMap((/** @type {any} */ campaign) =>
    Object.entries(campaign.flying ?? {}).flatMap(([name, one]) => {
      const run = model.runs.get(`${campaign.folder}/${name}`);
      const isSeen = run?.view && (run.view.stage === "end" || now - run.at < OLD_S * 1000 || isDownSince(run));
      return isSeen ? [] : [{ folder: campaign.folder, place: one.place ?? "", stage: one.stage }];
    }));
}

/** Whether all vehicles of a run came down after its newest state, by their guard. @param {Run} run */
function isDownSince(run) {
  const flown = [...run.flown.values()];
  return flown.length > 0 && !silentOf(run).length && flown.every((one) => !one.isUp && !one.armed && one.downAt > run.seenAt);
}

/** The number of runs that are not seen, and their stages, per place; empty without any. @param {Unseen[]} runs */
function unseenText(runs) {
  const places = [...new Set(runs.map((one) => one.place))];
  return places.map((place) => {
    const there = runs.filter((one) => one.place === place);
    const where = place && (place.startsWith("bench ") ? ` on ${place}` : ` on node ${place}`);
    const stages = [...new Set(there.map((one) => one.stage))].join(", ");
    return `${there.length} ${there.length === 1 ? "run" : "runs"}${where}, state not seen here: stage ${stages}`;
  }).join("; ");
}

/** The vehicles in the air over all runs of this console, as text. @param {Model} model */
export function airText(model) {
  const notSeen = unseenText(unseen(model));
  if (!model.runs.size) return notSeen || "no data";
  const all = aloft(model);
  const up = all.filter((one) => one.isUp);
  if (!up.length) {
    const armed = all.length ? `on the ground, armed: ${all.map((one) => nameOf(model, one)).join(", ")}` : "";
    return [notSeen || "nothing", armed].filter(Boolean).join("; ");
  }
  const runs = new Set(up.map((one) => one.run));
  const texts = [...runs].map((run) => {
    const names = up.filter((one) => one.run === run).map((one) => nameOf(model, one)).join(" and ");
    return runs.size > 1 || run !== model.run ? `${names} of ${runName(run.key)}` : names;
  });
  return `${model.mode === "recorded" ? "then: " : ""}${[...texts, notSeen].filter(Boolean).join("; ")}`;
}

/** A vehicle's name with warnings: hardware, a lost link, or old data.
 * @param {Model} model @param {Aloft} one */
function nameOf(model, one) {
  const isAttached = one.run.scene?.kinds?.[one.name]?.startsWith("attached");
  const isOld = model.mode === "live" && one.age_s > OLD_S;
  const marks = [isAttached && "may be hardware", isOld ? `data ${one.age_s.toFixed(0)} s old` : !one.hasLink && "link LOST"];
  const text = marks.filter(Boolean).join(", ");
  return text ? `${one.name} (${text})` : one.name;
}

/** Whether nothing flies for certain, so that an abort has nothing to land. @param {Model} model */
export function isIdle(model) {
  if (model.isOver || model.mode === "recorded") return true;
  const { status } = model;
  if (!status || aloft(model).some((one) => one.age_s < OLD_S)) return false;
  return !status.guards.length && status.campaigns.every((/** @type {any} */ one) => one.is_over);
}

/** The progress of an abort, per vehicle; null without one. ALL DOWN only where each flight has confirmed it, and is seen.
 * @param {Model} model @returns {{ok: boolean, text: string} | null} */
export function abortText(model) {
  const { abort } = model;
  if (!abort) return null;
  const by = `ABORT by ${abort.who} at ${clock(abort.at)}`;
  if (!abort.isObeyed) return { ok: false, text: `${by} FAILED: ${abort.texts.join("; ")}` };
  const missing = unconfirmedNames(model, abort);
  const ok = !missing.length;
  const notSeen = unseenText(unseen(model));
  const also = notSeen && `; ${notSeen}`;
  const lead = ok ? ": " : ` NOT CONFIRMED by ${missing.join(", ")}: press ABORT again, or land by the transmitter; `;
  const land = ok ? "all vehicles land; " : "";
  const runs = runsSince(model, abort.at - BEFORE_ABORT_MS);
  const several = runs.length > 1;
  const all = runs.flatMap((run) => flownOf(run).map(([name, one]) => ({ name: several ? `${runName(run.key)} ${name}` : name, one, run })));
  const up = all.filter(({ one }) => one.isUp).map(({ name, run }) => name + oldText(run));
  const armed = all.filter(({ one }) => !one.isUp && one.armed).map(({ name, run }) => name + oldText(run));
  if (up.length) return { ok, text: `${by}${lead}${land}still in the air: ${up.join(", ")}${also}` };
  if (armed.length) return { ok, text: `${by}${lead}on the ground, still armed: ${armed.join(", ")}${also}` };
  if (!all.length) return { ok, text: `${by}${lead}${land}this page has seen none in the air${also}` };
  const silent = runs.flatMap((run) => silentOf(run));
  if (silent.length) return { ok, text: `${by}${lead}${all.map(({ name }) => name).join(", ")} down; no data was ever received from ${silent.join(", ")}${also}` };
  const at = Math.max(...all.map(({ one }) => one.downAt));
  const each = all.map(({ name, one }) => `${name} ${one.downAt < abort.at ? "was down before" : clock(one.downAt)}`).join(", ");
  if (!ok || notSeen) return { ok, text: `${by}${lead}down: ${each}${also}` };
  return { ok, text: at < abort.at ? `${by}: all vehicles were down already` : `${by}. ALL DOWN at ${clock(at)} (${each})` };
}

/** What has not confirmed an abort, and does not land by its own status. @param {Model} model @param {import("./model.js").Abort} abort */
function unconfirmedNames(model, abort) {
  const landing = (model.status?.campaigns ?? []).filter((/** @type {any} */ one) => one.stopped || one.is_over).map((/** @type {any} */ one) => one.folder);
  return abort.unconfirmed.filter((one) => !landing.includes(one.folder)).map((one) => one.name);
}

/** The runs that an abort concerns: seen since a time, or with a vehicle that was not seen to come down before it.
 * @param {Model} model @param {number} since ms since 1970 */
function runsSince(model, since) {
  const isOpen = (/** @type {import("./model.js").Flown} */ one) => one.isUp || one.armed || one.downAt >= since;
  return [...model.runs.values()].filter((run) =>
    run.flown.size && (run.seenAt >= since || ([...run.flown.values()].some(isOpen) && !isOverAndSimulated(model, run))));
}

/** Whether a run of simulated vehicles has ended with all its processes: it is not in flight, and has no guard.
 * @param {Model} model @param {Run} run */
function isOverAndSimulated(model, run) {
  const campaign = (model.status?.campaigns ?? []).find((/** @type {any} */ one) => run.key.startsWith(`${one.folder}/`));
  if (!campaign || campaign.flying?.[run.key.slice(campaign.folder.length + 1)]) return false;
  if ((model.status?.guards ?? []).some((/** @type {any} */ one) => one.folder === run.key)) return false;
  const kinds = run.scene?.kinds ?? {};
  const names = new Set([...run.flown.keys(), ...silentOf(run), ...Object.keys(kinds)]);
  return [...names].every((name) => kinds[name] && !kinds[name].startsWith("attached"));
}

/** The vehicles of a run without any message so far. @param {Run} run @returns {string[]} */
function silentOf(run) {
  return run.view.vehicles.map((/** @type {any} */ one) => one.name).filter((/** @type {string} */ name) => !run.flown.has(name));
}

/** The time of a run's newest state, if it is old. @param {Run} run */
function oldText(run) {
  return performance.now() - run.at > OLD_S * 1000 ? ` (as of ${clock(run.seenAt)})` : "";
}

/** The number of runs by verdict. @param {any} campaign */
export function countsText(campaign) {
  const finished = Object.keys(campaign.finished ?? {});
  const verdicts = finished.map((name) => {
    const isMet = campaign.controls?.[name];
    return isMet === undefined ? campaign.finished[name] : `control ${isMet ? "met" : "NOT met"}`;
  });
  const kinds = [...new Set(verdicts)].map((kind) => `${verdicts.filter((one) => one === kind).length} ${kind}`);
  return `${verdicts.length} of ${campaign.total ?? "?"} runs judged${kinds.length ? `: ${kinds.join(", ")}` : ""}`;
}

/** The next run of a campaign in flight, in the order of its plan; empty after the last. @param {any} campaign */
export function nextText(campaign) {
  if (!campaign || campaign.is_over || campaign.stopped) return "";
  const planned = campaign.planned ?? [];
  const begun = (/** @type {string} */ name) => name in (campaign.finished ?? {}) || name in (campaign.flying ?? {});
  const last = planned.findLastIndex(begun);
  const next = planned.slice(last + 1).find((/** @type {string} */ name) => !begun(name)) ?? planned.find((/** @type {string} */ name) => !begun(name));
  return next ? `next: ${next}` : planned.length ? "the last run" : "";
}

/** The present state of the campaign, as text. @param {Model} model @param {any} campaign @returns {string} */
export function stateText(model, campaign) {
  if (!model.you) return "not joined: this page has no data yet";
  if (!campaign && model.mode === "recorded") return "recorded run, nothing in flight";
  if (!campaign) return model.isOfMachine ? "waiting for a flight on this machine" : "waiting for its first flight";
  const flying = (model.status?.campaigns ?? []).filter((/** @type {any} */ one) => !one.is_over);
  const more = flying.length > 1 ? `${flying.length} campaigns on this console (${flying.map((/** @type {any} */ one) => one.name).join(", ")}); shown: ` : "";
  return `${more}${wordOf(model, campaign)}; ${countsText(campaign)}`;
}

/** @param {Model} model @param {any} campaign */
function wordOf(model, campaign) {
  const isGuarded = (model.status?.guards ?? []).some((/** @type {any} */ one) => one.folder.startsWith(`${campaign.folder}/`));
  if (campaign.is_over && isGuarded) return "the program has ended; its guard lands the vehicles";
  if (campaign.is_over || model.isOver) return campaign.stopped ? "ended, aborted" : "ended";
  if (!campaign.is_answering) return `the campaign does not answer: ${campaign.problem}`;
  const isUp = aloft(model).some((one) => one.isUp && one.run.key.startsWith(`${campaign.folder}/`));
  const notSeen = unseenText(unseen(model).filter((one) => one.folder === campaign.folder));
  const also = notSeen && `; ${notSeen}`;
  if (campaign.stopped && isUp) return `aborted: landing, no further runs${also}`;
  if (campaign.stopped) return notSeen ? `aborted: ${notSeen}` : "aborted, nothing in the air";
  if (campaign.held) return `HELD by the operator${also}`;
  if (isUp) return `flying${also}`;
  if (notSeen) return notSeen;
  return Object.keys(campaign.flying ?? {}).length ? "on the ground, nothing in the air" : "between runs, nothing in the air";
}
