// @ts-check
// Entry point of the page: joins with the link's token, connects, and dispatches messages.

import { Connection } from "./connection.js";
import { showReply, wireCommands } from "./commands.js";
import { FenceEditor } from "./fence.js";
import { Images } from "./images.js";
import { Model } from "./model.js";
import { Panels } from "./panels.js";
import { PlaybackBar } from "./playback.js";
import { Views } from "./views.js";

const NAME = "wil-console-name";
const model = new Model();
const images = new Images(model);
const views = new Views(model);
const panels = new Panels(model, () => views.draw());
const editor = new FenceEditor(model, views);
const playback = new PlaybackBar(model);
const connection = new Connection({
  document: (message) => {
    model.take(message);
    views.draw();
  },
  image: (head, jpeg) => images.take(head, jpeg),
  opened: () => model.clear(),
  isOver: () => model.isOver,
});
wireCommands(model);
connection.onChange = (text, isLost) => panels.lost(text, isLost);

/** Refresh ages and changed panels. */
function refresh() {
  connection.check();
  panels.refresh();
  editor.refresh();
  playback.refresh();
  if (model.answer) model.say(model.answer.ok, model.answer.text);
  model.answer = null;
  images.refresh();
}
setInterval(refresh, 200);

/** @param {string} token */
function join(token) {
  const dialog = /** @type {HTMLElement} */ (document.getElementById("join"));
  const form = /** @type {HTMLFormElement} */ (document.getElementById("join-form"));
  const name = /** @type {HTMLInputElement} */ (document.getElementById("name"));
  name.value = localStorage.getItem(NAME) ?? name.value;
  dialog.hidden = false;
  name.focus();
  name.select();
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    localStorage.setItem(NAME, name.value);
    const reply = await showReply("/session", { token, name: name.value });
    if (reply.ok) {
      history.replaceState(null, "", "/");
      dialog.hidden = true;
      connection.open();
    } else {
      /** @type {HTMLElement} */ (document.getElementById("join-error")).textContent = reply.text;
    }
  });
}

if (location.hash.length > 1) join(location.hash.slice(1));
else connection.open();
