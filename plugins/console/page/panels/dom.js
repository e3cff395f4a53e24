// @ts-check
// Helpers of all panels to write text into the page; text only, never markup.

/** @param {string} id */
export const by = (id) => /** @type {HTMLElement} */ (document.getElementById(id));

/** @param {string} id */
export const button = (id) => /** @type {HTMLButtonElement} */ (document.getElementById(id));

/** @param {string} tag @param {string} [text] @param {string} [kind] */
export function make(tag, text = "", kind = "") {
  const element = document.createElement(tag);
  if (text) element.textContent = text;
  if (kind) element.className = kind;
  return element;
}

/** Write a text that the page may truncate; its title has all of it.
 * @param {string} id @param {string} text @param {string} [kind] */
export function write(id, text, kind) {
  const one = by(id);
  if (one.textContent !== text) one.textContent = one.title = text;
  if (kind !== undefined && one.className !== kind) one.className = kind;
}

/** A number without the sign of a rounded zero. @param {any} value @param {number} [digits] */
export function number(value, digits = 2) {
  return typeof value === "number" ? value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1") : "–";
}

/** A limit without trailing zeros. @param {number} value */
export function plain(value) {
  return String(Number(number(value, 3)));
}

/** The time of day. @param {number} ms since 1970 */
export function clock(ms) {
  return new Date(ms).toLocaleTimeString("en-GB");
}
