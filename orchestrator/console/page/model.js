// @ts-check
// What the page knows: runs, their newest states, events and trails; no drawing here.

const TRAIL_POINTS = 1500;
const TRAIL_STEP_M = 0.02;
const HISTORY = 120;
const MOST_EVENTS = 400;

/** @typedef {{key: string, scene: any, view: any, at: number, trails: Map<string, number[][]>,
 *   margins: Map<string, number[]>, largest: Map<string, number>, contacts: number[][], poses: Map<string, number[]>}} Run */

export class Model {
  constructor() {
    /** @type {any} */ this.you = null;
    this.mode = "live";
    /** Whether commands go to all that flies on the machine, or to one program's or folder's. */
    this.isOfMachine = true;
    /** @type {Map<string, Run>} */ this.runs = new Map();
    this.chosen = "";
    this.isChosenByHand = false;
    /** @type {any} */ this.status = null;
    this.statusAt = 0;
    /** @type {any} */ this.people = { people: [], in_control: null, holder: "" };
    /** @type {any[]} */ this.events = [];
    /** @type {Set<string>} */ this.answered = new Set();
    /** The newest answer of a run, until it is shown. @type {{ok: boolean, text: string} | null} */
    this.answer = null;
    this.isOver = false;
    this.changes = 0;
  }

  /** Forget everything: the server sends it anew. */
  clear() {
    const changes = this.changes + 1;
    Object.assign(this, new Model(), { changes });
  }

  /** @returns {Run | undefined} */
  get run() {
    return this.runs.get(this.chosen);
  }

  get hasControl() {
    return this.you !== null && this.people.in_control === this.you.number;
  }

  /** @param {any} message */
  take(message) {
    this.changes += 1;
    switch (message.type) {
      case "hello":
        this.you = message.you;
        this.mode = message.mode;
        this.isOfMachine = message.whole_machine !== false;
        break;
      case "people":
        this.people = message;
        break;
      case "status":
        this.status = message;
        this.statusAt = performance.now();
        this.takeAnswers(message);
        break;
      case "scene":
        this.record(message.run).scene = message;
        break;
      case "run":
        this.takeView(message);
        break;
      case "event":
        this.takeEvent(message);
        break;
      case "goodbye":
        this.isOver = true;
        break;
      case "command":
        this.note({ ...message, kind: "command", t_s: null, at: new Date().toLocaleTimeString() });
        break;
    }
  }

  /** Note what runs answered to a change of the fence. @param {any} status */
  takeAnswers(status) {
    for (const campaign of status.campaigns) {
      for (const answer of campaign.answers ?? []) {
        const key = `${answer.id} ${answer.run}`;
        if (this.answered.has(key)) continue;
        this.answered.add(key);
        const word = answer.ok ? "done" : "refused";
        this.note({ kind: "answer", run: "", t_s: null, at: new Date().toLocaleTimeString(), vehicle: answer.run, word, text: answer.text });
        this.answer = { ok: answer.ok, text: `${answer.run}: ${answer.text}` };
      }
    }
  }

  /** @param {string} key @returns {Run} */
  record(key) {
    let run = this.runs.get(key);
    if (!run) {
      run = {
        key,
        scene: null,
        view: null,
        at: 0,
        trails: new Map(),
        margins: new Map(),
        largest: new Map(),
        contacts: [],
        poses: new Map(),
      };
      this.runs.set(key, run);
      if (!this.isChosenByHand || !this.runs.has(this.chosen)) this.chosen = key;
    }
    return run;
  }

  /** @param {any} view */
  takeView(view) {
    const run = this.record(view.run);
    if (run.view && view.t_s < run.view.t_s - 1) {
      run.trails.clear();
      run.margins.clear();
      run.largest.clear();
      run.contacts = [];
    }
    run.view = view;
    run.at = performance.now();
    for (const vehicle of view.vehicles) {
      const place = vehicle.position_ned_m;
      if (!place || place.some((/** @type {any} */ one) => one === null)) continue;
      run.poses.set(vehicle.name, place);
      const trail = run.trails.get(vehicle.name) ?? [];
      run.trails.set(vehicle.name, trail);
      const last = trail[trail.length - 1];
      if (!last || distance(last, place) > TRAIL_STEP_M) trail.push(place);
      if (trail.length > TRAIL_POINTS) trail.shift();
    }
    for (const margin of view.margins) {
      const key = `${margin.name} ${margin.vehicle}`;
      const history = run.margins.get(key) ?? [];
      run.margins.set(key, history);
      if (margin.margin !== null) {
        history.push(margin.margin);
        run.largest.set(key, Math.max(run.largest.get(key) ?? 0, Math.abs(margin.margin)));
      }
      if (history.length > HISTORY) history.shift();
    }
  }

  /** @param {any} event */
  takeEvent(event) {
    const run = this.record(event.run);
    if (event.kind === "contact") {
      const place = run.poses.get(event.vehicle);
      if (place) run.contacts.push(place);
    }
    // The newest state may be from just before the run's end.
    if (event.kind === "stage" && run.view && event.t_s >= run.view.t_s) run.view.stage = event.word;
    this.note(event);
  }

  /** @param {any} event */
  note(event) {
    this.events.push(event);
    if (this.events.length > MOST_EVENTS) this.events.shift();
  }
}

/** @param {number[]} a @param {number[]} b */
function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}
