// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The bar under a still picture: goes through the pictures of the last two minutes. */

import { button, byId, element, setText } from "../shell/dom.js";
import { t } from "../shell/language.js";
import { age } from "../shell/words.js";
import { store } from "../store.js";
import { layMarks, stageOf } from "./stages.js";

/** Builds the bar; it is there while the picture is still. */
export function buildRewind() {
  const slider = element("input", {
    type: "range",
    min: "0",
    step: "1",
    "aria-label": t("rewind.time"),
    on: { input: () => current()?.go(Number(slider.value)) },
  });
  const words = element("span", { class: "rewind-words", role: "status" });
  const bar = element(
    "div",
    { id: "rewind", role: "group", "aria-label": t("rewind.title"), hidden: true },
    button("second-back", "", () => rewind(-1, true), { label: t("rewind.second_back") }),
    button("back", "", () => rewind(-1), { label: t("rewind.picture_back") }),
    element("div", { class: "rewind-middle" }, slider, words),
    button("forward", "", () => rewind(1), { label: t("rewind.picture_forward") }),
    button("second-forward", "", () => rewind(1, true), { label: t("rewind.second_forward") }),
  );
  byId("stages").after(bar);
  store.watch(["still", "current", "rewound"], () => tell(bar, slider, words));
}

/** @returns {import("./still.js").Still | undefined} of the selected aircraft */
function current() {
  return stageOf(store.get("current"))?.held;
}

/**
 * Makes the picture still if it is not, and goes back or forward.
 * @param {number} steps @param {boolean} seconds  not pictures
 */
export function rewind(steps, seconds = false) {
  if (!store.get("still")) store.set({ still: true });
  if (seconds) current()?.stepSeconds(steps);
  else current()?.step(steps);
}

/** @param {HTMLElement} bar @param {any} slider @param {HTMLElement} words */
function tell(bar, slider, words) {
  const held = current();
  const shown = store.get("still") && Boolean(held?.on);
  const turned = bar.hidden === shown;
  bar.hidden = !shown;
  if (turned) layMarks(); // no answer is under the bar
  if (!shown || !held) return;
  const [last, index] = [held.stamps.length - 1, held.index];
  slider.disabled = last < 1;
  slider.max = String(Math.max(last, 0));
  slider.value = String(index);
  const ago = last < 0 ? "" : secondsBefore(held.stamps[last], held.stampNs);
  slider.setAttribute("aria-valuetext", ago);
  setText(words, held.words || ago);
}

/** @param {string} newestNs @param {string} stampNs @returns {string} */
function secondsBefore(newestNs, stampNs) {
  const seconds = Number(BigInt(newestNs) - BigInt(stampNs)) / 1e9;
  return seconds > 0 ? t("rewind.back", { age: age(seconds) }) : t("rewind.newest");
}
