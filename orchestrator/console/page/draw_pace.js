// @ts-check
// How often, and how finely, a view is drawn: as its graphics take it. A view that is slow to draw, as
// every one is without a graphics processor, leaves most of the time to the images and to the flight.

const SHARE = 0.08;
const SMOOTH = 0.3;
const LONGEST_MS = 2000;
const COARSE_MS = 120;
const FINE_MS = 30;
const LEAST_SCALE = 0.7;

export class DrawPace {
  constructor() {
    /** What a drawing takes, smoothed, ms. */
    this.took_ms = 0;
    /** Of the screen's own resolution. */
    this.scale = 1;
    this.begunAt = -Infinity;
    this.isDrawing = false;
  }

  /** @param {number} now */
  begin(now) {
    this.begunAt = now;
    this.isDrawing = true;
  }

  /** The drawing that began last is done. @param {number} now */
  end(now) {
    if (!this.isDrawing) return;
    this.isDrawing = false;
    const took = now - this.begunAt;
    this.took_ms = this.took_ms ? this.took_ms + SMOOTH * (took - this.took_ms) : took;
    if (this.took_ms > COARSE_MS) this.scale = Math.max(LEAST_SCALE, this.scale * 0.8);
    else if (this.took_ms < FINE_MS) this.scale = Math.min(1, this.scale * 1.1);
  }

  /** When the next drawing may begin, ms after the last began; turned by hand, it waits for nothing else.
   * @param {number} now @param {boolean} isTurned */
  isDue(now, isTurned) {
    if (this.isDrawing) return now - this.begunAt > LONGEST_MS;
    return isTurned || now - this.begunAt >= Math.min(LONGEST_MS, this.took_ms / SHARE);
  }
}
