// @ts-check
// The WebSocket to the console's server; it reconnects when closed or silent.

const SILENT_MS = 2500;
const AGAIN_MS = 1000;
const HEAD_BYTES = 4;

/**
 * @typedef {{document: (message: any) => void, image: (head: any, jpeg: Uint8Array<ArrayBuffer>) => Promise<void>,
 *   opened: () => void, isOver: () => boolean}} Handlers
 */

export class Connection {
  /** @param {Handlers} handlers */
  constructor(handlers) {
    this.handlers = handlers;
    /** @type {WebSocket | null} */
    this.socket = null;
    this.receivedAt = 0;
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
      this.receivedAt = performance.now();
      this.wasOpen = true;
      this.handlers.opened();
    });
    socket.addEventListener("message", (event) => {
      this.receivedAt = performance.now();
      if (typeof event.data === "string") this.handlers.document(JSON.parse(event.data));
      else void this.takeImage(socket, event.data, (images += 1));
    });
    socket.addEventListener("close", () => {
      if (this.socket === socket) this.socket = null;
    });
    this.socket = socket;
  }

  /** Pass an image on, and acknowledge it by its number when it was drawn or dropped.
   * @param {WebSocket} socket @param {ArrayBuffer} data @param {number} number */
  async takeImage(socket, data, number) {
    try {
      const length = new DataView(data).getUint32(0);
      const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, HEAD_BYTES, length)));
      await this.handlers.image(head, new Uint8Array(data, HEAD_BYTES + length));
    } finally {
      if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ ack: number }));
    }
  }

  /** Check the connection; reconnect if it is lost. */
  check() {
    if (!this.isWanted) return;
    const now = performance.now();
    const isOpen = this.socket !== null && this.socket.readyState === WebSocket.OPEN;
    const silent = now - this.receivedAt;
    if (isOpen && silent < SILENT_MS) {
      this.onChange("", false);
      return;
    }
    // The console ended with its campaign: do not reconnect.
    if (this.handlers.isOver() && !isOpen) return this.onChange("", false);
    const since = this.wasOpen
      ? `No data from the console's server for ${(silent / 1000).toFixed(0)} s.`
      : "The server does not answer, or this browser has no session: open a link from the terminal.";
    if (silent >= SILENT_MS || !this.wasOpen) this.onChange(since, true);
    if (!isOpen && now > this.tryAt) this.open();
  }
}
