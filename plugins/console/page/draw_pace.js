// @ts-check
// Adapts a view's frame rate and resolution to its drawing time, so that slow graphics leave most of
// the processor to the images and to the flight.

const SHARE = 0.08;
const SMOOTH = 0.3;
const LONGEST_MS = 2000;
const COARSE_MS = 120;
const FINE_MS = 30;
const LEAST_SCALE = 0.7;

export class DrawPace {
  constructor() {
    /** Drawing time, smoothed, ms. */
    this.took_ms = 0;
    /** Share of the screen's resolution. */
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

  /** Whether the next drawing may begin; a view turned by hand waits only for its last drawing.
   * @param {number} now @param {boolean} isTurned */
  isDue(now, isTurned) {
    if (this.isDrawing) return now - this.begunAt > LONGEST_MS;
    return isTurned || now - this.begunAt >= Math.min(LONGEST_MS, this.took_ms / SHARE);
  }
}
