// @ts-check
// Tables and lists: vehicles, guard, margins, campaign, events, people. Text only, never markup.

/** @typedef {import("./model.js").Model} Model */

const STALE_S = 1.5;
const NEAR = 0.2;
const SHOWN_EVENTS = 150;
const PANELS_MS = 400;

/** @param {string} id */
const by = (id) => /** @type {HTMLElement} */ (document.getElementById(id));

/** @param {string} tag @param {string} [text] @param {string} [kind] */
function make(tag, text = "", kind = "") {
  const made = document.createElement(tag);
  if (text) made.textContent = text;
  if (kind) made.className = kind;
  return made;
}

/** @param {any} value @param {number} [digits] */
function number(value, digits = 2) {
  return typeof value === "number" ? value.toFixed(digits) : "–";
}

export class Panels {
  /** @param {Model} model */
  constructor(model) {
    this.model = model;
    this.drawn = -1;
    this.drawnAt = 0;
    this.runs = by("runs");
    this.runs.addEventListener("change", () => {
      model.chosen = /** @type {HTMLSelectElement} */ (this.runs).value;
      model.isChosenByHand = true;
      model.changes += 1;
    });
  }

  /** @param {string} text @param {boolean} isLost */
  lost(text, isLost) {
    by("lost").hidden = !isLost;
    by("lost").classList.toggle("over", this.model.isOver);
    by("lost-title").textContent = this.model.isOver ? "The campaign has ended" : "No connection to the console";
    by("lost-hint").hidden = this.model.isOver;
    if (isLost) by("lost-text").textContent = text;
  }

  refresh() {
    this.showAges();
    const now = performance.now();
    if (this.drawn === this.model.changes || now - this.drawnAt < PANELS_MS) return;
    this.drawn = this.model.changes;
    this.drawnAt = now;
    this.showHead();
    this.showVehicles();
    this.showGuards();
    this.showMargins();
    this.showMatrix();
    this.showEvents();
    this.showPeople();
  }

  showAges() {
    const now = performance.now();
    const run = this.model.run;
    const ages = { run: run?.view ? (now - run.at) / 1000 : null, status: this.statusAge(now) };
    for (const [key, age] of Object.entries(ages)) {
      for (const one of document.querySelectorAll(`.aged[data-age=${key}]`)) {
        one.classList.toggle("stale", age !== null && age > STALE_S);
        const text = one.querySelector(".age");
        const isOver = key === "run" && run?.view?.stage === "end";
        if (text) text.textContent = age === null ? "" : isOver ? "the run has ended" : `${age.toFixed(1)} s old`;
      }
    }
  }

  /** @param {number} now */
  statusAge(now) {
    return this.model.status ? (now - this.model.statusAt) / 1000 : null;
  }

  showHead() {
    const { model } = this;
    const view = model.run?.view;
    const campaign = this.campaign();
    by("campaign").textContent = campaign?.name ?? (model.mode === "recorded" ? "Recorded run" : "No campaign in flight");
    by("state").textContent = this.stateText(campaign);
    by("stage").textContent = view?.stage ?? "–";
    by("time").textContent = view ? `${sinceStart(view.t_s, view).toFixed(1)} s, ${view.clock} clock${leftText(view)}` : "–";
    const verdict = by("verdict");
    verdict.textContent = view?.verdict_so_far || "–";
    verdict.className = `badge ${view?.verdict_so_far ?? ""}`;
    by("air").textContent = view ? airText(view.vehicles, model.run?.scene?.kinds ?? {}) : "–";
    this.showNearest();
    by("reason").textContent = view?.reason ?? "";
    by("reason").hidden = !view?.reason;
    this.showRuns();
    const isOperator = model.you?.role === "operator" && model.mode === "live";
    const isDone = Boolean(campaign?.stopped || campaign?.is_over);
    button("abort").disabled = !isOperator;
    button("hold").disabled = !isOperator || !model.hasControl || isDone || Boolean(campaign?.held);
    button("resume").disabled = !isOperator || !model.hasControl || !campaign?.held;
  }

  /** Name the required margin of which the least share is left. */
  showNearest() {
    const run = this.model.run;
    const required = (run?.view?.margins ?? []).filter((/** @type {any} */ one) => one.required && one.margin !== null);
    const [nearest] = required
      .map((/** @type {any} */ one) => ({ one, share: shareLeft(one, run?.largest.get(`${one.name} ${one.vehicle}`) ?? 0) }))
      .toSorted((/** @type {any} */ one, /** @type {any} */ other) => one.share - other.share);
    by("nearest").textContent = nearest ? `${titleOf(nearest.one)}: ${number(nearest.one.margin)} ${nearest.one.unit}` : "–";
    by("nearest").className = nearest && nearest.share < NEAR ? "near" : "";
  }

  campaign() {
    const all = this.model.status?.campaigns ?? [];
    const run = this.model.chosen;
    return all.find((/** @type {any} */ one) => run.startsWith(`${one.folder}/`)) ?? all.at(-1);
  }

  /** @param {any} campaign */
  stateText(campaign) {
    if (!campaign && this.model.mode === "recorded") return "nothing flies: this was flown";
    if (!campaign) return this.model.isOfMachine ? "waiting for a flight on this machine" : "waiting for its first flight";
    const done = Object.keys(campaign.finished ?? {}).length;
    const guards = this.model.status?.guards ?? [];
    const isGuarded = guards.some((/** @type {any} */ one) => one.folder.startsWith(`${campaign.folder}/`));
    if (campaign.is_over && isGuarded) return "the program has ended; its guard lands what it flew";
    if (campaign.is_over) return `ended: ${done} of ${campaign.total} runs finished`;
    if (!campaign.is_answering) return `the campaign does not answer: ${campaign.problem}`;
    const word = campaign.stopped ? "landing, nothing more is flown" : campaign.held ? "HELD by the operator" : "flying";
    return `${word}; ${done} of ${campaign.total} runs finished`;
  }

  showRuns() {
    const keys = [...this.model.runs.keys()];
    const names = keys.map((key) => key.split("/").slice(-3).join("/"));
    const select = /** @type {HTMLSelectElement} */ (this.runs);
    if ([...select.options].map((one) => one.value).join("\n") !== keys.join("\n")) {
      select.replaceChildren(...keys.map((key, index) => new Option(names[index], key)));
    }
    if (select.value !== this.model.chosen) select.value = this.model.chosen;
  }

  showVehicles() {
    const view = this.model.run?.view;
    const vehicles = view?.vehicles ?? [];
    /** @type {[string, (one: any) => [string, string] | string][]} */
    const rows = [
      ["what it is", (one) => this.model.run?.scene?.kinds?.[one.name] ?? "–"],
      ["mode", (one) => one.mode || "–"],
      ["armed", (one) => (one.armed ? "armed" : "disarmed")],
      ["state", (one) => one.landed.replace("_", " ") || "–"],
      ["link", (one) => (one.silent_s === null ? ["never heard", "bad"] : one.link_up ? `${one.silent_s.toFixed(2)} s ago` : [`LOST, ${one.silent_s.toFixed(1)} s ago`, "bad"])],
      ["battery", (one) => battery(one)],
      ["estimator", (one) => (one.failsafe ? ["FAILSAFE", "bad"] : one.faults.length ? [one.faults.join("; "), "bad"] : "no fault reported")],
      ["north, east, up", (one) => place(one.position_ned_m, "m")],
      ["speed", (one) => (one.velocity_ned_m_s ? `${Math.hypot(...one.velocity_ned_m_s).toFixed(2)} m/s` : "–")],
      ["setpoint", (one) => (one.setpoint ? `${one.setpoint_kind} ${place(one.setpoint, one.setpoint_kind === "velocity" ? "m/s" : "m")}` : "–")],
      ["autonomy", (one) => one.note || "–"],
    ];
    const head = make("tr");
    head.append(make("td"), ...vehicles.map((/** @type {any} */ one) => make("th", one.name, one.name)));
    const body = rows.map(([title, cell]) => {
      const row = make("tr");
      row.append(make("th", title));
      for (const one of vehicles) {
        const found = cell(one);
        row.append(typeof found === "string" ? make("td", found) : badgeCell(found));
      }
      return row;
    });
    by("vehicles").replaceChildren(head, ...(vehicles.length ? body : []));
    const texts = (view?.mixings ?? []).map((/** @type {any} */ one) => mixingText(one));
    by("mixing").textContent = texts.join(" · ");
  }

  showGuards() {
    const guards = this.model.status?.guards ?? [];
    const made = guards.map((/** @type {any} */ one) => {
      const row = make("div");
      row.append(make("p", String(one.run ?? one.name)));
      if (!one.is_answering) {
        row.append(make("span", "does not answer", "badge FAIL"));
        return row;
      }
      const state = one.latched ? [`has taken over: ${one.latched}`, "FAIL"] : one.held ? ["holds all vehicles", "INVALID"] : ["passes setpoints on", "PASS"];
      row.append(make("span", state[0], `badge ${state[1]}`));
      if (one.orchestrator === "lost") row.append(make("span", "its program is lost", "badge FAIL"));
      const list = Object.entries(one.vehicles ?? {}).map(([name, phase]) => `${name}: ${phase}`);
      if (one.latched || one.held) row.append(make("p", list.join(", ")));
      return row;
    });
    const none = this.model.run?.view?.clock === "virtual" ? "under the virtual clock the guard is in the run's process: see its events" : "no guard on this machine";
    by("guards").replaceChildren(...(made.length ? made : [make("p", none, "hint")]));
  }

  showMargins() {
    const run = this.model.run;
    const margins = run?.view?.margins ?? [];
    const sorted = margins.toSorted((/** @type {any} */ one, /** @type {any} */ other) => Number(other.required) - Number(one.required));
    const rows = sorted.map((/** @type {any} */ one) => {
      const history = run?.margins.get(`${one.name} ${one.vehicle}`) ?? [];
      const row = make("tr", "", one.required ? "" : "minor");
      const name = make("th", titleOf(one));
      if (!one.required) name.append(make("small", " not required"));
      const value = make("td", `${number(one.actual)} ${one.unit}${limitText(one.limits)}`);
      row.append(name, value, barCell(one, run?.largest.get(`${one.name} ${one.vehicle}`) ?? 0), sparkCell(history));
      row.title = one.detail;
      return row;
    });
    by("margins").replaceChildren(...(rows.length ? rows : [make("caption", "none yet")]));
  }

  showMatrix() {
    const campaign = this.campaign();
    if (!campaign) return by("matrix").replaceChildren(make("p", "none", "hint"));
    const names = new Set([...(campaign.planned ?? []), ...Object.keys(campaign.finished ?? {}), ...Object.keys(campaign.flying ?? {})]);
    /** @type {Map<string, HTMLElement[]>} */
    const rows = new Map();
    for (const name of names) {
      const [group, rep] = [name.split("/").slice(0, 2).join("/"), name.split("/")[2]];
      const verdict = campaign.finished?.[name];
      const flying = campaign.flying?.[name];
      const badge = make("span", `${rep} ${verdict ?? (flying ? flying.stage : "planned")}`, `badge ${verdict ?? (flying ? "flying" : "planned")}`);
      badge.title = campaign.reasons?.[name] ?? "";
      rows.set(group, [...(rows.get(group) ?? []), badge]);
    }
    const table = make("table");
    for (const [group, badges] of rows) {
      const row = make("tr");
      const cell = make("td");
      for (const badge of badges) cell.append(badge, " ");
      row.append(make("th", group), cell);
      table.append(row);
    }
    by("matrix").replaceChildren(table);
  }

  showEvents() {
    const { events } = this.model;
    const shown = events.slice(-SHOWN_EVENTS).toReversed();
    const lines = shown.map((one) => {
      const isCommand = one.kind === "command";
      const text = isCommand ? `${one.command} by ${one.who}: ${one.texts.join("; ")}` : [one.vehicle, one.word, one.text].filter(Boolean).join(" · ");
      const severe = one.severity !== null && one.severity !== undefined && one.severity <= 3;
      const line = make("li", "", `${one.kind}${severe ? " severe" : ""}`);
      line.append(make("time", timeText(one, this.model)), make("b", one.kind), make("span", text));
      return line;
    });
    by("events").replaceChildren(...lines);
  }

  showPeople() {
    const { people, you } = this.model;
    const items = people.people.map((/** @type {any} */ one) => {
      const marks = [one.role, people.in_control === one.number ? "has control" : "", you && you.number === one.number ? "this page" : ""];
      return make("li", `${one.name} (${marks.filter(Boolean).join(", ")})`);
    });
    by("people").replaceChildren(...items);
    by("control").textContent = people.holder ? `${people.holder} has control. Abort is every operator's.` : "Nobody has control.";
    const isOperator = you?.role === "operator";
    button("take").disabled = !isOperator || this.model.hasControl;
    button("invite-viewer").disabled = !isOperator;
    button("invite-operator").disabled = !isOperator;
  }
}

/** Seconds since the run began. @param {number} t_s @param {any} view */
function sinceStart(t_s, view) {
  return t_s - (view?.entered_s?.start ?? 0);
}

/** The time that the required limit leaves. @param {any} view */
function leftText(view) {
  const limit = view.margins.find((/** @type {any} */ one) => one.name === "time_limit" && one.required);
  const [, high] = limit?.limits ?? [null, null];
  if (high === null || limit.actual === null || view.stage !== "goal") return "";
  return `, ${Math.max(0, high - limit.actual).toFixed(0)} s left`;
}

/** @param {any} event @param {Model} model */
function timeText(event, model) {
  if (event.t_s === null) return event.at ?? "";
  return `${number(sinceStart(event.t_s, model.runs.get(event.run)?.view), 1)} s`;
}

/** @param {string} id */
function button(id) {
  return /** @type {HTMLButtonElement} */ (document.getElementById(id));
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
  return one.battery_fraction < NEAR ? [text, "bad"] : text;
}

/** @param {number[] | null} ned @param {string} unit */
function place(ned, unit) {
  if (!ned || ned.some((one) => one === null)) return "–";
  return `${ned[0].toFixed(2)}, ${ned[1].toFixed(2)}, ${(0 - ned[2]).toFixed(2)} ${unit}`;
}

/** @param {any} one */
function mixingText(one) {
  const error = one.registration_error_px === null ? "not measured" : `${one.registration_error_px.toFixed(2)} px`;
  return `${one.name}: ${number(one.rate_hz, 1)} Hz, skew ${number(one.skew_ms, 1)} ms, latency ${number(one.latency_ms, 1)} ms, registration error ${error}, ${one.missed} missed`;
}

/** @param {(number | null)[]} limits */
function limitText(limits) {
  const [low, high] = limits;
  if (low === null && high === null) return "";
  if (low === null) return `, limit ${number(high)}`;
  return high === null ? `, limit ${number(low)}` : `, ${number(low)} to ${number(high)}`;
}

/** The name of a margin. @param {any} one */
function titleOf(one) {
  return `${one.name.replaceAll("_", " ")} of ${one.vehicle}`;
}

/** How much of a margin is left, of the largest that it was or its limit. @param {any} one @param {number} largest */
function shareLeft(one, largest) {
  const known = one.limits.filter((/** @type {any} */ limit) => limit !== null).map(Math.abs);
  return one.margin / Math.max(1e-9, largest, ...known, Math.abs(one.margin));
}

/** @param {any} one */
function isUp(one) {
  return one.landed ? one.landed !== "on_ground" : one.armed;
}

/** What is off the ground, and what of it may be hardware. @param {any[]} vehicles @param {Record<string, string>} kinds */
function airText(vehicles, kinds) {
  const up = vehicles.filter(isUp).map((one) => `${one.name}${kinds[one.name]?.startsWith("attached") ? " (may be hardware)" : ""}`);
  const armed = vehicles.filter((one) => one.armed && !isUp(one)).map((one) => one.name);
  if (up.length) return up.join(" and ");
  return armed.length ? `nothing; ${armed.join(" and ")} armed` : "nothing";
}

/** @param {any} one @param {number} largest that the margin was */
function barCell(one, largest) {
  const cell = make("td");
  if (one.margin === null) {
    cell.append(make("small", one.verdict === "FAIL" ? `not yet: ${one.detail}` : one.detail || "no margin"));
    return cell;
  }
  const share = shareLeft(one, largest);
  const bar = make("span", "", `bar ${share < 0 ? "over" : share < NEAR ? "near" : ""}`);
  const fill = make("i");
  fill.style.width = `${Math.max(0, share * 100)}%`;
  bar.append(fill);
  cell.append(make("span", `${number(one.margin)} ${one.unit}`), bar);
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
