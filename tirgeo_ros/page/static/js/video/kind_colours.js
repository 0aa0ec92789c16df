// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The colour of each target in the video: that of its kind's badge in the list. */

import { store } from "../store.js";

/** The video is seen through a red filter at night: of this colour it leaves most. */
const BY_NIGHT = "#ffe14d";
const PRESS = "#ffffff"; // of a press that is no target

/** @type {import("../store.js").Target[]} */
let listed = [];
/** @type {Map<string, string>} */
let kinds = new Map();

/** @param {string} id  empty: of a press that is no target @returns {string} */
export function targetColour(id) {
  const targets = store.get("targets");
  if (targets !== listed) {
    listed = targets;
    kinds = new Map(listed.map((target) => [target.id, target.kind]));
  }
  return kindColour(kinds.get(id) ?? "");
}

/** @param {string} kind  empty: none @returns {string} */
function kindColour(kind) {
  if (store.get("theme") === "red") return BY_NIGHT;
  return store.get("colours")[kind] ?? PRESS;
}
