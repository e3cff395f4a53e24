// @ts-check
// Command buttons and keys: each sends one POST, and shows its reply.

import { by } from "./panels/dom.js";

/** @typedef {import("./model.js").Model} Model */

const WAIT_MS = 5000;

/** Send a request; return its reply, or a failure if the server does not answer.
 * @param {string} path @param {any} body @returns {Promise<{ok: boolean, is_obeyed?: boolean, text: string}>} */
export async function showReply(path, body) {
  try {
    const response = await fetch(path, {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(body),
      signal: AbortSignal.timeout(WAIT_MS),
    });
    return await response.json();
  } catch (error) {
    const isLate = error instanceof DOMException && error.name === "TimeoutError";
    const what = isLate ? "NOT CONFIRMED, and only an abort may still be executed" : "NOT SENT";
    return {
      ok: false,
      text: `${what}: the console's server does not answer (${error}). Use wil-campaign abort in a terminal.`,
    };
  }
}

/** @param {Model} model */
export function wireCommands(model) {
  /** @param {string} command */
  const send = async (command) => {
    model.say(true, `${command}: being sent`);
    const reply = await showReply("/command", { command, seen_s: model.status?.sent_s });
    // The head shows the progress of an abort, and what did not confirm it.
    if (command === "abort" && reply.is_obeyed) model.reply = null;
    else model.say(reply.ok, reply.text);
    model.changes += 1;
  };
  const abort = () => {
    if (model.you?.role === "operator" && model.mode === "live" && !model.isOver) void send("abort");
  };
  by("abort").addEventListener("click", abort);
  by("hold").addEventListener("click", () => void send("hold"));
  by("resume").addEventListener("click", () => void send("resume"));
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && !event.repeat) abort();
  });
  by("take").addEventListener("click", async () => {
    const reply = await showReply("/control", {});
    model.say(reply.ok, reply.text);
  });
  for (const role of ["viewer", "operator"]) {
    by(`invite-${role}`).addEventListener("click", async () => {
      const reply = await showReply("/invite", { role });
      if (reply.ok) by("link").textContent = reply.text;
      else model.say(reply.ok, reply.text);
    });
  }
}
