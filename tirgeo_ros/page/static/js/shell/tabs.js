// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The tabs: targets and checks; and the map on screens without a part for it. */

import { currentVerdict } from "../checks/verdict.js";
import { currentState, store } from "../store.js";
import { button, byId, element, setText } from "./dom.js";
import { t } from "./language.js";

const TABS = [
  ["targets", "other", t("tabs.targets")],
  ["map", "map", t("page.map")],
  ["checks", "checks", t("checks.title")],
];

/** Builds the tabs, and shows the chosen part. */
export function buildTabs() {
  const nodes = TABS.map(([tab, symbol, words]) => {
    const node = button(symbol, words, () => store.set({ tab }), { role: "tab", data: { tab } });
    node.append(element("span", { class: "count", hidden: true }));
    return node;
  });
  byId("tabs").append(...nodes);
  store.watch(["tab"], () => {
    const tab = store.get("tab");
    document.body.dataset.tab = tab;
    byId("targets").hidden = tab === "checks";
    byId("checks").hidden = tab !== "checks";
    byId("panel").scrollTo(0, 0);
    nodes.forEach((node) => node.setAttribute("aria-selected", String(node.dataset.tab === tab)));
  });
  store.watch(["targets"], () => count(nodes[0], store.get("targets").length, ""));
  store.watch(["states", "verdicts", "current"], () => {
    const { findings = [] } = currentState() ?? {};
    count(nodes[2], findings.length, currentVerdict().tone);
  });
}

/** @param {HTMLElement} tab @param {number} number @param {string} tone */
function count(tab, number, tone) {
  const holder = /** @type {HTMLElement} */ (tab.querySelector(".count"));
  holder.hidden = number === 0;
  holder.dataset.tone = tone;
  setText(holder, String(number));
}
