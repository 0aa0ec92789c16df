// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** How targets and their kinds look: the badge with icon and number, the button of a kind. */

import { element, icon } from "../shell/dom.js";
import { capital } from "../shell/words.js";

/** @param {{number: number, kind: string}} target @returns {HTMLElement} number and icon */
export function badge({ number, kind }) {
  return element(
    "span",
    { class: "badge", data: { kind } },
    icon(kind),
    element("b", { text: String(number) }),
  );
}

/**
 * @param {string} kind
 * @param {() => void} pressed
 * @param {Record<string, string>} attributes  that say whether this kind is chosen
 * @returns {HTMLButtonElement}
 */
export function kindButton(kind, pressed, attributes) {
  const own = { type: "button", class: "kind", "aria-label": capital(kind), data: { kind } };
  const words = element("span", { text: kind });
  return element("button", { ...own, ...attributes, on: { click: pressed } }, icon(kind), words);
}
