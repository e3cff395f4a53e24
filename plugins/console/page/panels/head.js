// @ts-check
// The head: state, verdict, and progress of an abort. Its size is constant, so that ABORT never
// moves.

import { airText, abortText, campaignOf, finalOf, hasEnded, isIdle, nextText, runName, shownVerdict, stateText, verdictOf } from "../flight_state.js";
import { button, by, clock, number, write } from "./dom.js";
import { nearestOf, sinceStart } from "./margins.js";

/** @typedef {import("../model.js").Model} Model */

/** How long a reply that a command was obeyed is shown; a refusal stays. */
const REPLY_MS = 20000;

export class Head {
  /** @param {Model} model @param {() => void} redraw the views: another run is shown */
  constructor(model, redraw) {
    this.model = model;
    this.listed = "";
    this.runs = /** @type {HTMLSelectElement} */ (document.getElementById("runs"));
    this.runs.addEventListener("change", () => {
      model.choose(this.runs.value);
      redraw();
    });
  }

  /** The campaign of the run that is shown; the newest where none is. @returns {any} */
  campaign() {
    return campaignOf(this.model, this.model.chosen) ?? this.model.status?.campaigns?.at(-1);
  }

  show() {
    const { model } = this;
    const view = model.run?.view;
    const campaign = this.campaign();
    write("campaign", campaign?.name ?? this.title());
    write("state", stateText(model, campaign));
    write("stage", view?.stage.replaceAll("_", " ") ?? "–");
    write("next", nextText(campaign));
    const verdict = verdictOf(model, model.run);
    write("verdict-label", verdict.label);
    write("verdict", verdict.text, `badge ${verdict.kind}`);
    const reason = verdict.reason ? `${runName(model.chosen)} is ${verdict.text}${verdict.isFinal ? "" : " so far"}: ${verdict.reason}` : "";
    write("reason", reason, `reason ${verdict.kind}`);
    write("air", airText(model));
    write("hardware", this.hardwareText());
    const nearest = nearestOf(model.run);
    write("nearest", nearest.text, nearest.kind);
    this.showRuns();
    this.showCommands(campaign);
    this.showReply();
  }

  title() {
    if (this.model.mode === "recorded") return "Recorded run";
    return this.model.you ? "No campaign in flight" : "Console";
  }

  /** Refresh the texts that depend on time. */
  showTime() {
    const view = this.model.run?.view;
    const kind = view?.clock === "wall" ? "" : `, ${view?.clock}`;
    write("time", view ? `${number(sinceStart(view.t_s, view), 1)} s${kind}${leftText(view)}` : "–");
    write("time-label", `Run time · ${clock(Date.now())}`);
    write("air", airText(this.model));
    this.showReply();
  }

  /** The vehicles that may be hardware. */
  hardwareText() {
    const kinds = this.model.run?.scene?.kinds ?? {};
    const attached = Object.keys(kinds).filter((name) => kinds[name].startsWith("attached"));
    if (attached.length) return `${attached.join(" and ")} MAY BE HARDWARE`;
    return Object.keys(kinds).length ? "none: all vehicles are simulated" : "–";
  }

  /** @param {any} campaign */
  showCommands(campaign) {
    const { model } = this;
    const isOperator = model.you?.role === "operator" && model.mode === "live" && !model.isOver;
    const isDone = Boolean(campaign?.stopped || campaign?.is_over);
    const idle = isIdle(model);
    button("abort").disabled = !isOperator;
    button("abort").classList.toggle("idle", idle);
    const word = !model.you ? "join first" : model.isOver || idle ? "nothing in flight" : isOperator ? "land all vehicles (Esc)" : "for operators";
    write("abort-word", word);
    button("hold").disabled = !isOperator || !model.hasControl || isDone || Boolean(campaign?.held);
    button("resume").disabled = !isOperator || !model.hasControl || !campaign?.held;
  }

  /** The newest reply; after an abort, its progress. */
  showReply() {
    const { model } = this;
    const abort = abortText(model);
    const isRecent = model.reply && (!model.reply.ok || Date.now() - model.reply.at < REPLY_MS);
    const reply = model.reply && isRecent && (!abort || model.reply.at > (model.abort?.at ?? 0)) ? model.reply : abort;
    const ended = model.isOver && reply === null ? { ok: true, text: "The campaign, its guards and its console have ended. A guard ends only when its vehicles are down." } : reply;
    write("reply", ended?.text ?? "", ended ? `reply ${ended.ok ? "good" : "bad"}` : "reply");
  }

  showRuns() {
    const { model } = this;
    const campaigns = model.status?.campaigns ?? [];
    const several = campaigns.length > 1;
    /** @type {[string, string, boolean][]} */
    const lines = [...model.runs.values()].map((run) => {
      const campaign = campaignOf(model, run.key);
      const name = `${several && campaign ? `${campaign.name}: ` : ""}${runName(run.key)}`;
      const final = finalOf(model, run);
      const isLive = model.mode === "live" && !hasEnded(model, run);
      return [run.key, final && run.key !== model.chosen ? `${name} · ${verdictOf(model, run).text}` : isLive ? `● ${name}${run.key === model.chosen ? "" : ` · ${run.view?.stage ?? "begins"}`}` : name, false];
    });
    for (const campaign of campaigns) {
      for (const name of Object.keys(campaign.finished ?? {})) {
        const key = `${campaign.folder}/${name}`;
        if (!model.runs.has(key)) lines.push([key, `${several ? `${campaign.name}: ` : ""}${name} · ${shownVerdict(campaign, name)?.text} (see its report)`, true]);
      }
    }
    const listed = JSON.stringify(lines);
    if (listed !== this.listed) {
      this.listed = listed;
      this.runs.replaceChildren(...lines.map(([key, text, isGone]) => {
        const option = new Option(text, key);
        option.disabled = isGone;
        return option;
      }));
    }
    if (this.runs.value !== model.chosen) this.runs.value = model.chosen;
    by("runs").title = this.runs.selectedOptions[0]?.text ?? "";
  }
}

/** The time left until the required time limit. @param {any} view */
function leftText(view) {
  const limit = view.margins.find((/** @type {any} */ one) => one.name === "time_limit" && one.required);
  const [, high] = limit?.limits ?? [null, null];
  if (high === null || limit.actual === null || view.stage !== "goal") return "";
  return `, ${Math.max(0, high - limit.actual).toFixed(0)} s left`;
}
