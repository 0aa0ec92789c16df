// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The filter of the list: the kinds and statuses that are shown; none chosen shows all of them. */

import { button, element } from "../shell/dom.js";
import { t } from "../shell/language.js";
import { store } from "../store.js";
import { kindButton, showChosen, statusButton } from "./symbols.js";

/** @typedef {import("../store.js").Target} Target */
/** @typedef {{kinds: string[], statuses: string[]}} Filter */

/** @returns {Filter} what is chosen, of what the server knows */
function chosen() {
  const { filter, kinds, statuses } = store.values;
  const known = (/** @type {string[]} */ words, /** @type {string[]} */ all) =>
    words.filter((word) => all.includes(word));
  return {
    kinds: known(filter.kinds, kinds),
    statuses: known(filter.statuses, statuses),
  };
}

/** @returns {boolean} whether the list may lack targets */
export function isFiltering() {
  const { kinds, statuses } = chosen();
  return kinds.length + statuses.length > 0;
}

/** @param {Target[]} targets @returns {Target[]} those that the list shows */
export function filtered(targets) {
  const { kinds, statuses } = chosen();
  const passes = (/** @type {string[]} */ words, /** @type {string} */ word) =>
    words.length === 0 || words.includes(word);
  return targets.filter((one) => passes(kinds, one.kind) && passes(statuses, one.status));
}

/** Shows all targets again. */
export function showAll() {
  store.set({ filter: { kinds: [], statuses: [] } });
}

/** @returns {{opener: HTMLElement, chips: HTMLElement}} the button in the list's head, the chips */
export function buildFilter() {
  const chips = element("div", { class: "filter", hidden: true });
  const opener = button("filter", t("filter.open"), () => {
    chips.hidden = !chips.hidden;
    opener.setAttribute("aria-expanded", String(!chips.hidden));
  });
  opener.id = "filter";
  opener.setAttribute("aria-expanded", "false");
  store.watch(["kinds", "statuses"], () => fill(chips));
  store.watch(["filter", "kinds", "statuses"], () => {
    opener.classList.toggle("active", isFiltering());
    show(chips);
  });
  return { opener, chips };
}

/** @param {HTMLElement} chips */
function fill(chips) {
  const { kinds, statuses } = store.values;
  const row = (/** @type {string} */ label, /** @type {HTMLElement[]} */ buttons) =>
    element("div", { class: "kinds", role: "group", "aria-label": label }, ...buttons);
  const ofKind = (/** @type {string} */ kind) => kindButton(kind, () => turn("kinds", kind), {});
  const ofStatus = (/** @type {string} */ status) =>
    statusButton(status, () => turn("statuses", status));
  chips.replaceChildren(
    row(t("filter.kinds"), kinds.map(ofKind)),
    row(t("filter.statuses"), statuses.map(ofStatus)),
    button("", t("filter.all"), showAll, { class: "all" }),
  );
}

/** @param {"kinds" | "statuses"} what @param {string} word  chooses it, or chooses it no more */
function turn(what, word) {
  const filter = chosen();
  const words = filter[what];
  const next = words.includes(word) ? words.filter((one) => one !== word) : [...words, word];
  store.set({ filter: { ...filter, [what]: next } });
}

/** @param {HTMLElement} chips */
function show(chips) {
  const { kinds, statuses } = chosen();
  chips.querySelector(".all")?.toggleAttribute("hidden", !isFiltering());
  const buttons = /** @type {HTMLElement[]} */ ([...chips.querySelectorAll(".kind")]);
  showChosen(buttons, ({ dataset: { kind = "", status = "" } }) =>
    [...kinds, ...statuses].includes(kind || status),
  );
}
