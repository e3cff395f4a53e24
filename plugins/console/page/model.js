// @ts-check
// The page's data: runs, their newest states, events and trails; no drawing.

const TRAIL_POINTS = 1500;
const TRAIL_STEP_M = 0.02;
const HISTORY = 120;
const MOST_EVENTS = 400;
const MOST_RUNS = 24;
const LATE_MS = 5000;

/** The known state of a vehicle; downAt: since when it is down (ms since 1970).
 * @typedef {{isUp: boolean, armed: boolean, hasLink: boolean, downAt: number}} Flown */

/** at: reception of the newest state, on the page's clock; seenAt: the same by the server's clock, ms since 1970.
 * @typedef {{key: string, scene: any, view: any, at: number, seenAt: number, flown: Map<string, Flown>, trails: Map<string, number[][]>,
 *   margins: Map<string, number[]>, largest: Map<string, number>, contacts: number[][], poses: Map<string, number[]>}} Run */

/** isObeyed: by one flight at least. unconfirmed: the campaigns, and guards without one, that did not confirm it.
 * @typedef {{who: string, at: number, ok: boolean, isObeyed: boolean, texts: string[], unconfirmed: {name: string, folder: string}[]}} Abort */

export class Model {
  constructor() {
    /** @type {any} */ this.you = null;
    this.mode = "live";
    /** Whether commands go to all flights on the machine, or to those of one program or folder. */
    this.isOfMachine = true;
    /** @type {Map<string, Run>} */ this.runs = new Map();
    this.chosen = "";
    this.isChosenByHand = false;
    /** @type {any} */ this.status = null;
    this.statusAt = 0;
    /** @type {any} */ this.people = { people: [], in_control: null, holder: "" };
    /** Pause, speed and time of a finished run; null for runs in flight. @type {any} */ this.playback = null;
    /** @type {any[]} */ this.events = [];
    /** @type {Set<string>} */ this.answered = new Set();
    /** The newest answer of a run, until it is shown. @type {{ok: boolean, text: string} | null} */
    this.answer = null;
    /** The newest reply to this page. @type {{ok: boolean, text: string, at: number} | null} */
    this.reply = null;
    /** The newest abort by this console. @type {Abort | null} */
    this.abort = null;
    this.isOver = false;
    this.changes = 0;
  }

  /** Clear all data: the server sends it again. */
  clear() {
    const { reply, chosen, isChosenByHand } = this;
    const changes = this.changes + 1;
    Object.assign(this, new Model(), { changes, reply, chosen, isChosenByHand });
  }

  /** Show another run, and stay with it. @param {string} key */
  choose(key) {
    this.chosen = key;
    this.isChosenByHand = true;
    this.changes += 1;
  }

  /** Show a reply to this page. @param {boolean} ok @param {string} text */
  say(ok, text) {
    this.reply = { ok, text, at: Date.now() };
    this.changes += 1;
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
        this.statusAt = performance.now() - ageMs(message);
        this.takeAnswers(message);
        this.takeGuards(message);
        break;
      case "scene":
        this.record(message.run).scene = message;
        // A finished run begins again, or at another time.
        if (this.mode === "recorded") this.forget(this.record(message.run));
        break;
      case "playback":
        this.playback = message;
        break;
      case "past":
        this.record(message.run).trails = new Map(Object.entries(message.trails));
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
        this.takeCommand(message);
        break;
    }
  }

  /** @param {any} message */
  takeCommand(message) {
    const when = (message.at_s ?? Date.now() / 1000) * 1000;
    this.note({ ...message, kind: "command", run: "", t_s: null, when });
    // A second abort does not replace the first, unless a flight does not confirm it.
    if (message.command !== "abort" || (this.abort?.ok && message.ok)) return;
    const { who, ok, texts, unconfirmed, is_obeyed: isObeyed } = message;
    this.abort = { who, at: when, ok, isObeyed, texts, unconfirmed };
  }

  /** Guards report that a vehicle is down even if their program is dead. @param {any} status */
  takeGuards(status) {
    for (const guard of status.guards) {
      for (const [name, at_s] of Object.entries(guard.down_at_s ?? {})) this.takeDown(this.runs.get(guard.folder), name, Number(at_s) * 1000);
    }
  }

  /** @param {Run | undefined} run @param {string} name @param {number} at ms since 1970 */
  takeDown(run, name, at) {
    const flown = run?.flown.get(name);
    if (!run || (flown && !flown.isUp && !flown.armed)) return;
    run.flown.set(name, { isUp: false, armed: false, hasLink: true, downAt: at });
  }

  /** Record the answers of runs to a change of the fence. @param {any} status */
  takeAnswers(status) {
    for (const campaign of status.campaigns) {
      for (const answer of campaign.answers ?? []) {
        const key = `${answer.id} ${answer.run}`;
        if (this.answered.has(key)) continue;
        this.answered.add(key);
        const word = answer.ok ? "done" : "refused";
        this.note({ kind: "answer", run: "", t_s: null, when: Date.now(), vehicle: answer.run, word, text: answer.text });
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
        seenAt: 0,
        flown: new Map(),
        trails: new Map(),
        margins: new Map(),
        largest: new Map(),
        contacts: [],
        poses: new Map(),
      };
      this.runs.set(key, run);
      for (const old of this.runs.keys()) {
        if (this.runs.size > MOST_RUNS && old !== this.chosen) this.runs.delete(old);
      }
    }
    return run;
  }

  /** Forget what a finished run has shown so far. @param {Run} run */
  forget(run) {
    run.trails.clear();
    run.margins.clear();
    run.largest.clear();
    run.contacts = [];
    this.events = this.events.filter((one) => one.run !== run.key);
  }

  /** @param {any} view */
  takeView(view) {
    const run = this.record(view.run);
    // Until a new run has a state, the last one is shown with its verdict.
    if (!run.view && (!this.isChosenByHand || !this.run)) this.chosen = view.run;
    run.view = view;
    run.at = performance.now() - ageMs(view);
    run.seenAt = view.at_s * 1000;
    for (const vehicle of view.vehicles) {
      // Arming after an abort begins another flight.
      if (takeFlown(run, vehicle, view.down_at_s[vehicle.name])) this.abort = null;
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
    // The newest state may be slightly older than the run's end.
    if (event.kind === "stage" && run.view && event.t_s >= run.view.t_s) run.view.stage = event.word;
    // A page that joins gets the events before the state, which has the times then.
    if (event.down_at_s !== null && run.view) this.takeDown(run, event.vehicle, event.down_at_s * 1000);
    this.note({ ...event, when: timeOf(event, run) });
  }

  /** @param {any} event */
  note(event) {
    this.events.push(event);
    if (this.events.length > MOST_EVENTS) this.events.shift();
  }
}

/** Record whether a vehicle is up, or since when it is down; nothing before its first message.
 * @param {Run} run @param {any} vehicle @param {number | undefined} down_at_s since 1970, by the server, which may know by its guard
 * @returns {boolean} whether it was down, and is armed now */
function takeFlown(run, vehicle, down_at_s) {
  const isDown = down_at_s !== undefined;
  if (vehicle.silent_s === null && !isDown) return false;
  const isUp = !isDown && (vehicle.landed ? vehicle.landed !== "on_ground" : vehicle.armed);
  const before = run.flown.get(vehicle.name);
  const wasDown = before && !before.isUp && !before.armed;
  run.flown.set(vehicle.name, { isUp, armed: !isDown && vehicle.armed, hasLink: vehicle.link_up, downAt: isDown ? down_at_s * 1000 : 0 });
  // A state may be slightly older than its guard's message.
  return before !== undefined && Boolean(wasDown) && !isDown && run.seenAt - before.downAt > LATE_MS;
}

/** The time of an event, ms since 1970: by the run's clock if that is the wall clock, else its reception.
 * @param {any} event @param {Run} run */
function timeOf(event, run) {
  const epoch = run.scene?.epoch_s;
  return (epoch && event.t_s !== null ? epoch + event.t_s : event.at_s) * 1000;
}

/** The age of a message that the server kept for pages that join later, ms. @param {any} message */
function ageMs(message) {
  return message.age_s * 1000;
}

/** @param {number[]} a @param {number[]} b */
function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}
