/** The tabs: targets and checks; and the map on screens without a part for it. */

import { currentVerdict } from "../checks/verdict.js";
import { currentState, store } from "../store.js";
import { button, byId, element, setText } from "./dom.js";

const TABS = [
  ["targets", "other", "Targets"],
  ["map", "map", "Map"],
  ["checks", "checks", "Checks"],
];

/** Builds the tabs, and shows the chosen part. */
export function buildTabs() {
  const made = TABS.map(([tab, symbol, words]) => {
    const one = button(symbol, words, () => store.set({ tab }), { role: "tab", data: { tab } });
    one.append(element("span", { class: "count", hidden: true }));
    return one;
  });
  byId("tabs").append(...made);
  store.watch(["tab"], () => {
    const tab = store.get("tab");
    document.body.dataset.tab = tab;
    byId("targets").hidden = tab === "checks";
    byId("checks").hidden = tab !== "checks";
    byId("panel").scrollTo(0, 0);
    made.forEach((one) => one.setAttribute("aria-selected", String(one.dataset.tab === tab)));
  });
  store.watch(["targets"], () => count(made[0], store.get("targets").length, ""));
  store.watch(["states", "verdicts", "current"], () => {
    const { findings = [] } = currentState() ?? {};
    count(made[2], findings.length, currentVerdict().tone);
  });
}

/** @param {HTMLElement} tab @param {number} number @param {string} tone */
function count(tab, number, tone) {
  const holder = /** @type {HTMLElement} */ (tab.querySelector(".count"));
  holder.hidden = number === 0;
  holder.dataset.tone = tone;
  setText(holder, String(number));
}
