// @ts-check
// The camera of the 3D view: turned and zoomed by pointer, wheel, fingers and keys.

const AZIMUTH = (205 * Math.PI) / 180;
const ELEVATION = (32 * Math.PI) / 180;
const TURN = 0.01;
const STEP = 0.12;
const NEARER = 1.2;

export class Orbit {
  /** @param {HTMLCanvasElement} canvas @param {() => void} onChange */
  constructor(canvas, onChange) {
    this.onChange = onChange;
    this.azimuth = AZIMUTH;
    this.elevation = ELEVATION;
    this.zoom = 1;
    /** Whether the view is that of the campaign's observer, until it is turned. */
    this.isObserver = false;
    /** Pointers that are down. @type {Map<number, [number, number]>} */
    this.down = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      this.down.set(event.pointerId, [event.clientX, event.clientY]);
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => this.down.delete(/** @type {PointerEvent} */ (event).pointerId));
    }
    canvas.addEventListener("wheel", (event) => {
      // Without a modifier key the wheel scrolls the page.
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      this.nearer(Math.exp(-event.deltaY * 0.001));
    }, { passive: false });
    canvas.addEventListener("dblclick", () => this.reset());
    for (const [name, act] of Object.entries({ nearer: () => this.nearer(NEARER), farther: () => this.nearer(1 / NEARER), reset: () => this.reset(), observer: () => this.observe() })) {
      document.getElementById(`space-${name}`)?.addEventListener("click", act);
    }
    canvas.addEventListener("keydown", (event) => this.press(event));
  }

  observe() {
    this.isObserver = true;
    this.onChange();
  }

  reset() {
    this.isObserver = false;
    this.azimuth = AZIMUTH;
    this.elevation = ELEVATION;
    this.zoom = 1;
    this.onChange();
  }

  /** @param {number} azimuth @param {number} elevation */
  turn(azimuth, elevation) {
    this.isObserver = false;
    this.azimuth += azimuth;
    this.elevation = Math.min(1.55, Math.max(0.02, this.elevation + elevation));
    this.onChange();
  }

  /** @param {number} factor */
  nearer(factor) {
    this.isObserver = false;
    this.zoom = Math.min(20, Math.max(0.5, this.zoom * factor));
    this.onChange();
  }

  /** @param {PointerEvent} event */
  drag(event) {
    const before = this.down.get(event.pointerId);
    if (!before) return;
    const apart = this.apart();
    this.down.set(event.pointerId, [event.clientX, event.clientY]);
    if (apart) this.nearer((this.apart() || apart) / apart);
    else this.turn((event.clientX - before[0]) * TURN, (event.clientY - before[1]) * TURN);
  }

  /** How far apart two fingers are, pixels; 0 for one. */
  apart() {
    const [one, other] = [...this.down.values()];
    return other ? Math.hypot(one[0] - other[0], one[1] - other[1]) : 0;
  }

  /** @param {KeyboardEvent} event */
  press(event) {
    /** @type {Record<string, () => void>} */
    const keys = {
      ArrowLeft: () => this.turn(-STEP, 0),
      ArrowRight: () => this.turn(STEP, 0),
      ArrowUp: () => this.turn(0, STEP),
      ArrowDown: () => this.turn(0, -STEP),
      "+": () => this.nearer(NEARER),
      "-": () => this.nearer(1 / NEARER),
      Home: () => this.reset(),
    };
    const act = keys[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }
}
