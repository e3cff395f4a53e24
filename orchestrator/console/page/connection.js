// @ts-check
// The WebSocket to the console's server: opened again when it is lost, silent ones seen as lost.

const SILENT_MS = 2500;
const AGAIN_MS = 1000;
const HEAD_BYTES = 4;

/**
 * @typedef {{document: (message: any) => void, image: (head: any, jpeg: Uint8Array<ArrayBuffer>) => Promise<void>,
 *   opened: () => void, isOver: () => boolean}} Takers
 */

export class Connection {
  /** @param {Takers} takers */
  constructor(takers) {
    this.takers = takers;
    /** @type {WebSocket | null} */
    this.socket = null;
    this.heard = 0;
    this.isWanted = false;
    this.wasOpen = false;
    this.tryAt = 0;
    /** @type {(text: string, isLost: boolean) => void} */
    this.onChange = () => {};
  }

  open() {
    this.isWanted = true;
    this.tryAt = performance.now() + AGAIN_MS;
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    this.socket?.close();
    const socket = new WebSocket(`${scheme}//${location.host}/live`);
    socket.binaryType = "arraybuffer";
    let images = 0;
    socket.addEventListener("open", () => {
      this.heard = performance.now();
      this.wasOpen = true;
      this.takers.opened();
    });
    socket.addEventListener("message", (event) => {
      this.heard = performance.now();
      if (typeof event.data === "string") this.takers.document(JSON.parse(event.data));
      else void this.takeImage(socket, event.data, (images += 1));
    });
    socket.addEventListener("close", () => {
      if (this.socket === socket) this.socket = null;
    });
    this.socket = socket;
  }

  /** Hand an image on, and acknowledge it by its number when it is shown or let go.
   * @param {WebSocket} socket @param {ArrayBuffer} data @param {number} number */
  async takeImage(socket, data, number) {
    try {
      const length = new DataView(data).getUint32(0);
      const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, HEAD_BYTES, length)));
      await this.takers.image(head, new Uint8Array(data, HEAD_BYTES + length));
    } finally {
      if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ ack: number }));
    }
  }

  /** Look whether the server is there; try again where it is not. */
  check() {
    if (!this.isWanted) return;
    const now = performance.now();
    const isOpen = this.socket !== null && this.socket.readyState === WebSocket.OPEN;
    const silent = now - this.heard;
    if (isOpen && silent < SILENT_MS) {
      this.onChange("", false);
      return;
    }
    // The console ended with its campaign: nobody is to be tried again.
    if (this.takers.isOver() && !isOpen) return this.onChange("", false);
    const since = this.wasOpen
      ? `Nothing has come of the console's server for ${(silent / 1000).toFixed(0)} s.`
      : "The server is not there, or this browser has no session: open a link of the terminal.";
    if (silent >= SILENT_MS || !this.wasOpen) this.onChange(since, true);
    if (!isOpen && now > this.tryAt) this.open();
  }
}
