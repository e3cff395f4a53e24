// @ts-check
// What all panels use to write text into the page. Text only, never markup.

/** @param {string} id */
export const by = (id) => /** @type {HTMLElement} */ (document.getElementById(id));

/** @param {string} id */
export const button = (id) => /** @type {HTMLButtonElement} */ (document.getElementById(id));

/** @param {string} tag @param {string} [text] @param {string} [kind] */
export function make(tag, text = "", kind = "") {
  const made = document.createElement(tag);
  if (text) made.textContent = text;
  if (kind) made.className = kind;
  return made;
}

/** Write a text of which the page may show a part only; all of it stands in its title.
 * @param {string} id @param {string} text @param {string} [kind] */
export function write(id, text, kind) {
  const one = by(id);
  if (one.textContent !== text) one.textContent = one.title = text;
  if (kind !== undefined && one.className !== kind) one.className = kind;
}

/** A number without a sign that rounding left behind. @param {any} value @param {number} [digits] */
export function number(value, digits = 2) {
  return typeof value === "number" ? value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1") : "–";
}

/** A limit as it was written: no zeros behind it. @param {number} value */
export function plain(value) {
  return String(Number(number(value, 3)));
}

/** The time of day. @param {number} ms since 1970 */
export function clock(ms) {
  return new Date(ms).toLocaleTimeString("en-GB");
}
