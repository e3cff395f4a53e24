// @ts-check
// The WebSocket to the console's server: opened again when it is lost, silent ones seen as lost.

const SILENT_MS = 2500;
const AGAIN_MS = 1000;

/**
 * @typedef {{document: (message: any) => void, image: (head: any, jpeg: Blob) => Promise<void>,
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
    const socket = new WebSocket(`${scheme}//${location.host}/live`);
    socket.binaryType = "arraybuffer";
    socket.addEventListener("open", () => {
      this.heard = performance.now();
      this.wasOpen = true;
      this.takers.opened();
    });
    socket.addEventListener("message", (event) => void this.take(socket, event.data));
    socket.addEventListener("close", () => {
      if (this.socket === socket) this.socket = null;
    });
    this.socket = socket;
  }

  /** @param {WebSocket} socket @param {string | ArrayBuffer} data */
  async take(socket, data) {
    this.heard = performance.now();
    if (typeof data === "string") {
      this.takers.document(JSON.parse(data));
      return;
    }
    try {
      const length = new DataView(data).getUint32(0);
      const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
      const jpeg = new Blob([new Uint8Array(data, 4 + length)], { type: "image/jpeg" });
      await this.takers.image(head, jpeg);
    } finally {
      if (socket.readyState === WebSocket.OPEN) socket.send('{"ack": 1}');
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
    if (this.takers.isOver() && !isOpen) {
      this.onChange("The campaign has ended and everything has landed; its console ended with it.", true);
      return;
    }
    const since = this.wasOpen
      ? `Nothing has come of the console's server for ${(silent / 1000).toFixed(0)} s.`
      : "The server is not there, or this browser has no session: open a link of the terminal.";
    if (silent >= SILENT_MS || !this.wasOpen) this.onChange(since, true);
    if (!isOpen && now > this.tryAt) this.open();
  }
}
