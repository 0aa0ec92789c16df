// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The row under the video: kind of the next target (or the target refined), still, zoom. */

import { button, byId, element, icon, setIcon, setText } from "../shell/dom.js";
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
    "aria-label": "Kind of the next target",
  });
  const refining = element("div", { class: "refining", hidden: true });
  byId("tools").append(kinds, refining, still(), zoom());
  store.watch(["kinds", "kind"], () => kinds.replaceChildren(...store.get("kinds").map(chooser)));
  store.watch(["refine", "role", "targets"], () => {
    const target = targetOf(store.get("refine"));
    kinds.hidden = Boolean(target) || !mayChange();
    refining.hidden = !target;
    if (target) refining.replaceChildren(...refineWords(target));
  });
}

/** @param {string} kind */
function chooser(kind) {
  const checked = String(kind === store.get("kind"));
  const attributes = { role: "radio", "aria-checked": checked };
  return kindButton(kind, () => store.set({ kind }), attributes);
}

/** @param {import("../store.js").Target} target */
function refineWords(target) {
  const words = `Press on ${target.number} ${called(target)} again`;
  const cancel = button("close", "Cancel", () => store.set({ refine: null }));
  return [icon("refine"), element("strong", { class: "grow", text: words }), cancel];
}

/** @returns {HTMLElement} */
function still() {
  const node = button("still", "still", () => store.set({ still: !store.get("still") }), {
    class: "kind",
    id: "still",
    "aria-label": "Still picture",
  });
  store.watch(["still"], () => {
    const on = store.get("still");
    node.setAttribute("aria-pressed", String(on));
    setIcon(node, on ? "live" : "still");
    setText(node.querySelector(".words"), on ? "live" : "still");
  });
  return node;
}

/** @returns {HTMLElement} zooms in by steps, and out again: for gloves that cannot pinch */
function zoom() {
  return button(
    "zoom",
    "zoom",
    () => {
      const stage = stageOf(store.get("current"));
      if (!stage) return;
      if (stage.view.zoom < LAST_ZOOM) stage.zoom(NEXT_ZOOM);
      else stage.changed(() => stage.view.reset());
    },
    { class: "kind", id: "zoom", "aria-label": "Zoom the video" },
  );
}
