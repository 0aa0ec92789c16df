// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The checks: the findings with their remedies, and the numbers of the state. */

import { byId, element, icon, setText } from "../shell/dom.js";
import { t } from "../shell/language.js";
import { age, capital, plain } from "../shell/words.js";
import { currentState, store } from "../store.js";
import { READINGS } from "./readings.js";
import * as judged from "./tones.js";
import { currentVerdict } from "./verdict.js";

const ICONS = { bad: "stop", caution: "warning", good: "good", "": "note" };

const NUMBERS = Object.values(READINGS);

/** Builds the panel, and updates it with each state. */
export function buildChecks() {
  const top = element(
    "header",
    { class: "list-head" },
    element("h2", { text: t("checks.title") }),
  );
  const findings = element("ol", { class: "findings" });
  const numbers = element("dl", { class: "numbers" });
  const ages = element("dl", { class: "numbers ages" });
  byId("checks").append(top, findings, numbers, element("h3", { text: t("checks.ages") }), ages);
  const cells = NUMBERS.map(({ words }) => cell(numbers, words));
  store.watch(["states", "verdicts", "current", "units"], () => {
    const state = currentState() ?? {};
    NUMBERS.forEach((number, index) =>
      set(cells[index], number.text(state), number.tone?.(state) ?? ""),
    );
    showAges(ages, state.ages_s ?? {});
    showFindings(findings, state.findings ?? []);
  });
}

/** @param {HTMLElement} list @param {string} words @returns {HTMLElement} the value's element */
function cell(list, words) {
  const value = element("dd", {});
  list.append(element("div", {}, element("dt", { text: words }), value));
  return value;
}

/** @param {HTMLElement} value @param {string} text @param {string} tone */
function set(value, text, tone) {
  setText(value, text);
  value.dataset.tone = tone;
}

/** @param {HTMLElement} list @param {Record<string, number | null>} ages */
function showAges(list, ages) {
  const names = Object.keys(ages);
  if (list.dataset.names !== names.join()) {
    list.replaceChildren();
    names.forEach((name) => cell(list, name === "rtk" ? "RTK" : capital(plain(name))));
    list.dataset.names = names.join();
  }
  const values = list.querySelectorAll("dd");
  names.forEach((name, index) => set(values[index], age(ages[name]), judged.ageTone(ages[name])));
}

/** @param {HTMLElement} list @param {any[]} findings  built again only when they differ */
function showFindings(list, findings) {
  const go = currentVerdict().word === "GO";
  const key = JSON.stringify([go, findings]);
  if (list.dataset.key === key) return;
  list.dataset.key = key;
  const fine = element(
    "li",
    { class: "finding", data: { tone: "good" } },
    icon("good"),
    element("p", { text: t("checks.fine") }),
  );
  list.replaceChildren(...(findings.length ? findings.map(finding) : go ? [fine] : []));
}

/** @param {any} row  {severity, subject, evidence, parameter, remedy} */
function finding({ severity, subject, evidence, parameter, remedy }) {
  const tone = judged.toneOf(severity);
  const words = element(
    "div",
    {},
    element("strong", { text: plain(subject) }),
    element("p", { text: evidence }),
    remedy ? element("p", { class: "mend", text: remedy }) : null,
    parameter ? element("p", { text: parameter }) : null,
  );
  return element("li", { class: "finding", data: { tone } }, icon(ICONS[tone]), words);
}
