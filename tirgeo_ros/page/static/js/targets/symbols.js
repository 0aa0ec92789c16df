// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** How targets look: the badge with icon and number, in the colour of the kind; buttons of words. */

import { element, icon } from "../shell/dom.js";
import { said } from "../shell/language.js";
import { capital } from "../shell/words.js";
import { store } from "../store.js";

/** The symbol of each status. */
const STATUS_SYMBOLS = {
  new: "new",
  checked: "tick",
  found: "found",
  dismissed: "dismissed",
};

/** @typedef {{number: number, kind: string, status: string}} Shown */

/** @param {Shown} target @returns {HTMLElement} number, icon, and the status if it is not new */
export function badge({ number, kind, status }) {
  const node = element(
    "span",
    { class: "badge", data: { kind, status } },
    icon(kind),
    element("b", { text: String(number) }),
    status === "new" ? null : element("i", { title: said(status) }, statusIcon(status)),
  );
  return coloured(node, kind);
}

/**
 * Gives a node the colour of a kind; the red theme's style sheet has the same for all.
 * @template {HTMLElement} Node
 * @param {Node} node
 * @param {string} kind
 */
export function coloured(node, kind) {
  node.style.setProperty("--kind", store.get("colours")[kind] ?? null);
  return node;
}

/** @param {string} status */
function statusIcon(status) {
  return icon(/** @type {Record<string, string>} */ (STATUS_SYMBOLS)[status] ?? "new");
}

/**
 * @param {string} kind
 * @param {() => void} pressed
 * @param {Record<string, string>} attributes  that say what it is, if it is no common button
 * @returns {HTMLButtonElement}
 */
export function kindButton(kind, pressed, attributes) {
  return coloured(choice(kind, icon(kind), pressed, { data: { kind }, ...attributes }), kind);
}

/**
 * @param {string} status
 * @param {() => void} pressed
 * @returns {HTMLButtonElement}
 */
export function statusButton(status, pressed) {
  return choice(status, statusIcon(status), pressed, { data: { status } });
}

/**
 * @param {string} word  of the server's, for a kind or a status
 * @param {SVGElement} symbol
 * @param {() => void} pressed
 * @param {Record<string, any>} attributes
 * @returns {HTMLButtonElement}
 */
function choice(word, symbol, pressed, attributes) {
  const own = { type: "button", class: "kind", "aria-label": capital(said(word)) };
  const words = element("span", { text: said(word) });
  return element("button", { ...own, ...attributes, on: { click: pressed } }, symbol, words);
}

/** @param {HTMLElement[]} buttons @param {(button: HTMLElement) => boolean} isChosen */
export function showChosen(buttons, isChosen) {
  for (const one of buttons) one.setAttribute("aria-pressed", String(isChosen(one)));
}
