// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The row under the video: kind of the next target (or the target refined), still, picture, zoom. */

import { button, byId, element, icon, setIcon, setText } from "../shell/dom.js";
import { t } from "../shell/language.js";
import { called } from "../shell/words.js";
import { mayChange, store, targetOf } from "../store.js";
import { kindButton } from "../targets/symbols.js";
import { stageOf } from "./stages.js";

const NEXT_ZOOM = 2;
const LAST_ZOOM = 4;

/** Builds the row, and updates it with the store. */
export function buildTools() {
  const kinds = element("div", {
    class: "kinds operator-only",
    role: "radiogroup",
    "aria-label": t("tools.kind"),
  });
  const refining = element("div", { class: "refining", hidden: true });
  byId("tools").append(kinds, refining, still(), look(), zoom());
  store.watch(["kinds"], () => kinds.replaceChildren(...store.get("kinds").map(chooser)));
  store.watch(["kinds", "kind"], () => {
    for (const one of kinds.children) {
      one.setAttribute("aria-checked", String(one.dataset.kind === store.get("kind")));
    }
  });
  store.watch(["refine", "role", "targets"], () => {
    const target = targetOf(store.get("refine"));
    kinds.hidden = Boolean(target) || !mayChange();
    refining.hidden = !target;
    if (target) refining.replaceChildren(...refineWords(target));
  });
}

/** @param {string} kind */
function chooser(kind) {
  return kindButton(kind, () => store.set({ kind }), { role: "radio" });
}

/** @param {import("../store.js").Target} target */
function refineWords(target) {
  const words = t("tools.again", { target: `${target.number} ${called(target)}` });
  const cancel = button("close", t("shell.cancel"), () => store.set({ refine: null }));
  return [icon("refine"), element("strong", { class: "grow", text: words }), cancel];
}

/** @returns {HTMLElement} */
function still() {
  const node = button("still", t("tools.still"), () => store.set({ still: !store.get("still") }), {
    class: "kind",
    id: "still",
    "aria-label": t("tools.still_picture"),
  });
  store.watch(["still"], () => {
    const on = store.get("still");
    node.setAttribute("aria-pressed", String(on));
    setIcon(node, on ? "live" : "still");
    setText(node.querySelector(".words"), on ? t("tools.live") : t("tools.still"));
  });
  return node;
}

/** @returns {HTMLElement} opens the panel of the picture */
function look() {
  const node = button(
    "look",
    t("tools.picture"),
    () => store.set({ looking: !store.get("looking") }),
    {
      class: "kind",
      id: "look-button",
      "aria-label": t("tools.picture_more"),
    },
  );
  store.watch(["looking"], () => node.setAttribute("aria-expanded", String(store.get("looking"))));
  return node;
}

/** @returns {HTMLElement} zooms in by steps, and out again: for gloves that cannot pinch */
function zoom() {
  return button(
    "zoom",
    t("tools.zoom"),
    () => {
      const stage = stageOf(store.get("current"));
      if (!stage) return;
      if (stage.view.zoom < LAST_ZOOM) stage.zoom(NEXT_ZOOM);
      else stage.changed(() => stage.view.reset());
    },
    { class: "kind", id: "zoom", "aria-label": t("tools.zoom_video") },
  );
}
