// @ts-check
// Vehicles, the figures of mixing, and the connected pages.

import { button, by, make, number } from "./dom.js";

/** @typedef {import("../model.js").Model} Model */

const LOW = 0.2;

/** @type {[string, (one: any) => [string, string] | string][]} */
const ROWS = [
  ["mode", (one) => one.mode || "–"],
  ["armed", (one) => (one.armed ? "armed" : "disarmed")],
  ["state", (one) => one.landed.replace("_", " ") || "–"],
  ["link", (one) => (one.silent_s === null ? ["no data received", "bad"] : one.link_up ? `${one.silent_s.toFixed(2)} s ago` : [`LOST, ${one.silent_s.toFixed(1)} s ago`, "bad"])],
  ["battery", (one) => battery(one)],
  ["estimator", (one) => (one.failsafe ? ["FAILSAFE", "bad"] : one.faults.length ? [one.faults.join("; "), "bad"] : "no fault reported")],
  ["north, east, up", (one) => place(one.position_ned_m, "m")],
  ["speed", (one) => (one.velocity_ned_m_s ? `${Math.hypot(...one.velocity_ned_m_s).toFixed(2)} m/s` : "–")],
  ["setpoint", (one) => (one.setpoint ? `${one.setpoint_kind} ${place(one.setpoint, one.setpoint_kind === "velocity" ? "m/s" : "m")}` : "–")],
  ["autonomy", (one) => one.note || "–"],
];

/** @param {Model} model */
export function showVehicles(model) {
  const view = model.run?.view;
  const vehicles = view?.vehicles ?? [];
  const kinds = model.run?.scene?.kinds ?? {};
  const head = make("tr");
  head.append(make("td"), ...vehicles.map((/** @type {any} */ one) => {
    const cell = make("th", one.name, one.name);
    cell.setAttribute("scope", "col");
    cell.append(make("small", kinds[one.name] ?? "unknown kind", "kind"));
    return cell;
  }));
  const body = ROWS.map(([title, cellOf]) => {
    const row = make("tr");
    const name = make("th", title);
    name.setAttribute("scope", "row");
    row.append(name);
    for (const one of vehicles) {
      const found = cellOf(one);
      row.append(typeof found === "string" ? make("td", found) : badgeCell(found));
    }
    return row;
  });
  by("vehicles").replaceChildren(...(vehicles.length ? [head, ...body] : [make("caption", "none yet")]));
  by("mixing").textContent = (view?.mixings ?? []).map(mixingText).join(" · ");
}

/** @param {Model} model */
export function showPeople(model) {
  const { people, you } = model;
  const items = people.people.map((/** @type {any} */ one) => {
    const marks = [one.role, people.in_control === one.number ? "has control" : "", you && you.number === one.number ? "this page" : ""];
    return make("li", `${one.name} (${marks.filter(Boolean).join(", ")})`);
  });
  by("people").replaceChildren(...items);
  const control = people.holder ? `${people.holder} has control. Every operator may abort.` : "Nobody has control.";
  by("control").textContent = model.isOver ? "The console has ended." : control;
  const isOperator = you?.role === "operator" && !model.isOver;
  button("take").disabled = !isOperator || model.hasControl;
  button("invite-viewer").disabled = !isOperator;
  button("invite-operator").disabled = !isOperator;
}

/** @param {[string, string]} found */
function badgeCell(found) {
  const cell = make("td");
  cell.append(make("span", found[0], `badge ${found[1]}`));
  return cell;
}

/** @param {any} one @returns {[string, string] | string} */
function battery(one) {
  if (one.battery_fraction === null) return "unknown";
  const volts = one.battery_v === null ? "" : `, ${one.battery_v.toFixed(1)} V`;
  const text = `${(one.battery_fraction * 100).toFixed(0)} %${volts}`;
  return one.battery_fraction < LOW ? [text, "bad"] : text;
}

/** @param {number[] | null} ned @param {string} unit */
function place(ned, unit) {
  if (!ned || ned.some((one) => one === null)) return "–";
  return `${number(ned[0])}, ${number(ned[1])}, ${number(0 - ned[2])} ${unit}`;
}

/** @param {any} one */
function mixingText(one) {
  if (one.skew_ms === null) return `${one.name}: no mixture yet`;
  const error = one.registration_error_px === null ? "not measured" : `${number(one.registration_error_px)} px`;
  return `Newest mixture of ${one.name}: ${number(one.rate_hz, 1)} Hz; exposures ${number(one.skew_ms, 1)} ms apart; ${number(one.latency_ms, 1)} ms from exposure to delivery; registration error of virtual objects ${error}; ${one.missed} missed so far`;
}
