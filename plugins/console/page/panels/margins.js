// @ts-check
// Margins: the worst value of each oracle so far, its limit, and the margin between the two.

import { by, make, number, plain } from "./dom.js";

/** @typedef {import("../model.js").Run} Run */

const NEAR = 0.2;
const SAME = 1e-6;

/** Seconds since the run began. @param {number} t_s @param {any} view */
export function sinceStart(t_s, view) {
  const entered = Object.values(view?.entered_s ?? {});
  return t_s - (view?.entered_s?.start ?? (entered.length ? Math.min(...entered) : 0));
}

/** Whether an oracle has not passed yet, and may: it has not failed either. @param {any} one @param {Run | undefined} run */
function isOpen(one, run) {
  return one.verdict === "FAIL" && !one.has_failed && run?.view?.stage !== "end";
}

/** What has failed, else the required margin with the smallest share left. @param {Run | undefined} run @returns {{text: string, kind: string}} */
export function nearestOf(run) {
  const required = (run?.view?.margins ?? []).filter((/** @type {any} */ one) => one.required && !isOpen(one, run) && (one.margin !== null || one.verdict === "FAIL"));
  const [nearest] = required
    .map((/** @type {any} */ one) => ({ one, ...shareOf(one, run) }))
    .toSorted((/** @type {any} */ one, /** @type {any} */ other) => Number(other.one.verdict === "FAIL") - Number(one.one.verdict === "FAIL") || one.share - other.share);
  if (!nearest) return { text: "nothing measured", kind: "" };
  const { one, share } = nearest;
  if (one.margin === null) return { text: `${titleOf(one)}: ${one.detail || "failed"}`, kind: "over" };
  const limit = limitText(one);
  const left = share < 0 ? "beyond its limit" : "left";
  const text = `${titleOf(one)}: ${number(Math.abs(one.margin))} ${one.unit} ${left}${limit ? ` (${limit})` : ""}`;
  return { text, kind: share < 0 ? "over" : share < NEAR ? "near" : "" };
}

/** @param {Run | undefined} run */
export function showMargins(run) {
  const margins = run?.view?.margins ?? [];
  if (run?.view?.clock === "recorded") by("margins-note").textContent = "the worst values of the flight, each from its moment on";
  const sorted = margins.toSorted((/** @type {any} */ one, /** @type {any} */ other) => Number(other.required) - Number(one.required));
  const rows = sorted.map((/** @type {any} */ one) => {
    const row = make("tr", "", one.required ? "" : "minor");
    const name = make("th", titleOf(one));
    name.setAttribute("scope", "row");
    if (!one.required) name.append(make("small", " not required"));
    row.append(name, valueCell(one), barCell(one, run), sparkCell(run?.margins.get(keyOf(one)) ?? []));
    row.title = one.detail;
    return row;
  });
  const head = make("tr");
  for (const title of ["oracle", "worst so far, and limit", "margin left", "history"]) {
    const cell = make("th", title);
    cell.setAttribute("scope", "col");
    head.append(cell);
  }
  by("margins").replaceChildren(...(rows.length ? [head, ...rows] : [make("caption", "no oracle has a value yet")]));
}

/** The name of a margin. @param {any} one */
function titleOf(one) {
  return `${one.name.replaceAll("_", " ")} of ${one.vehicle}`;
}

/** @param {any} one */
function keyOf(one) {
  return `${one.name} ${one.vehicle}`;
}

/** The share of a margin that is left, and the whole: its largest value in this run.
 * @param {any} one @param {Run | undefined} run */
function shareOf(one, run) {
  const whole = Math.max(1e-9, run?.largest.get(keyOf(one)) ?? 0, Math.abs(one.margin));
  return { share: one.margin / whole, whole };
}

/** @param {any} one */
function valueCell(one) {
  const value = one.actual !== null ? `${number(one.actual)} ${one.unit}` : isEvent(one) ? "–" : "not measured";
  const cell = make("td", value);
  const limit = limitText(one);
  if (limit) cell.append(make("small", ` ${limit}`));
  return cell;
}

/** Whether an oracle checks an event and measures no value. @param {any} one */
function isEvent(one) {
  return one.limits.every((/** @type {any} */ limit) => limit === null);
}

/** A limit as text; the margin shows whether it is a lower or upper limit. @param {any} one */
function limitText(one) {
  const [low, high] = one.limits;
  if (low !== null && high !== null) return `allowed: ${plain(low)} to ${plain(high)} ${one.unit}`;
  const limit = low ?? high;
  if (limit === null) return "";
  const isLeast = low !== null || (one.margin !== null && Math.abs(one.actual - limit - one.margin) < SAME);
  const isMost = one.margin !== null && Math.abs(limit - one.actual - one.margin) < SAME;
  return `${isLeast ? "at least" : isMost ? "at most" : "limit"} ${plain(limit)} ${one.unit}`;
}

/** @param {any} one @param {Run | undefined} run */
function barCell(one, run) {
  const cell = make("td");
  if (isOpen(one, run)) {
    const missing = one.margin === null ? "" : `${number(Math.abs(one.margin))} ${one.unit} beyond`;
    cell.append(make("small", `not yet: ${one.detail || missing}`));
    return cell;
  }
  if (one.margin === null) {
    const open = isEvent(one) ? "no violation" : one.actual === null ? "not measured yet" : "judged at the end";
    cell.append(make("small", one.detail || (one.verdict === "FAIL" ? "failed" : open)));
    return cell;
  }
  const { share, whole } = shareOf(one, run);
  const bar = make("span", "", `bar ${share < 0 ? "over" : share < NEAR ? "near" : ""}`);
  bar.setAttribute("aria-hidden", "true");
  const fill = make("i");
  fill.style.width = `${Math.max(0, share * 100)}%`;
  bar.append(fill);
  if (run?.view?.clock === "recorded") {
    cell.append(`${number(Math.abs(one.margin))} ${one.unit} ${one.margin < 0 ? "beyond" : "left"}`);
    return cell;
  }
  const text = share < 0 ? `${number(-one.margin)} ${one.unit} beyond` : `${number(one.margin)} ${one.unit} left, ${number(whole)} at most`;
  cell.append(make("span", text), bar);
  return cell;
}

/** @param {number[]} history */
function sparkCell(history) {
  const cell = make("td");
  if (history.length < 2) return cell;
  const spark = /** @type {HTMLCanvasElement} */ (document.createElement("canvas"));
  spark.width = 180;
  spark.height = 48;
  spark.setAttribute("aria-hidden", "true");
  const context = spark.getContext("2d");
  if (context) {
    const low = Math.min(0, ...history);
    const high = Math.max(...history, low + 1e-9);
    context.strokeStyle = getComputedStyle(document.body).color;
    context.lineWidth = 2;
    context.beginPath();
    history.forEach((value, index) => {
      const [x, y] = [(index / (history.length - 1)) * 178 + 1, 46 - ((value - low) / (high - low)) * 44];
      if (index) context.lineTo(x, y);
      else context.moveTo(x, y);
    });
    context.stroke();
  }
  cell.append(spark);
  return cell;
}
