// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The keyboard. */

import { swap } from "../map/moving_map.js";
import { store } from "../store.js";
import { undo } from "../targets/changes.js";
import { rewind } from "../video/rewind.js";
import { stageOf } from "../video/stages.js";
import { mark, record } from "./commands.js";
import { openHelp } from "./help.js";
import { changeTheme } from "./settings.js";

const STEP_PX = 8;
const OF_THE_MAP = ["Enter", "+", "-"]; // and the arrows: Leaflet takes them on the map
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const REPEATED = [...Object.keys(ARROWS), ...",.<>;:+-"]; // while one is held down

/** Listens to keys that no field takes. */
export function listenToKeys() {
  document.addEventListener("keydown", (event) => {
    const target = /** @type {HTMLElement} */ (event.target);
    const typing = target.closest("input:not([type=range]), textarea, dialog");
    const onMap = target.closest("#map") && [...OF_THE_MAP, ...Object.keys(ARROWS)];
    if (typing || onMap?.includes(event.key) || event.altKey || event.metaKey) return;
    const run = event.ctrlKey ? withControl(event) : commandOf(event);
    if (!run) return;
    event.preventDefault();
    if (!event.repeat || REPEATED.includes(event.key)) run();
  });
}

/** @param {KeyboardEvent} event @returns {(() => unknown) | undefined} */
function withControl(event) {
  return letter(event) === "z" && !event.shiftKey ? undo : undefined;
}

/** @param {KeyboardEvent} event @returns {string} the key, a letter small also with Caps Lock */
function letter({ key }) {
  return key.length === 1 ? key.toLowerCase() : key;
}

/** @param {KeyboardEvent} event @returns {(() => unknown) | undefined} */
function commandOf(event) {
  const key = letter(event);
  const numbered = kindOf(key);
  if (numbered) return numbered;
  const onButton = /** @type {HTMLElement} */ (event.target).closest("button, a, summary");
  if (onButton && (key === "Enter" || key === " ")) return undefined; // the button takes it
  const scrolls = /** @type {HTMLElement} */ (event.target).matches("#panel:focus-visible");
  if (scrolls && (key in ARROWS || key === " ")) return undefined;
  const slides = /** @type {HTMLElement} */ (event.target).matches("input");
  if (slides && key in ARROWS) return undefined;
  const stage = stageOf(store.get("current"));
  const step = event.shiftKey ? 1 : STEP_PX;
  if (key in ARROWS) return () => moveCursor(stage, /** @type {any} */ (ARROWS)[key], step);
  const command = {
    Enter: () => pressAtCursor(stage),
    " ": () => store.set({ still: !store.get("still") }),
    ",": () => rewind(-1),
    ".": () => rewind(1),
    "<": () => rewind(-1, true), // Shift and a comma in English,
    ">": () => rewind(1, true),
    ";": () => rewind(-1, true), // and in German and Spanish
    ":": () => rewind(1, true),
    "+": () => stage?.zoom(1.5),
    "-": () => stage?.zoom(1 / 1.5),
    m: mark,
    r: record,
    s: swap,
    n: changeTheme,
    "?": openHelp,
    Escape: () => store.set({ refine: null, measuring: false, selected: null, looking: false }),
  }[key];
  // Without Shift a French key of a number is another sign, and some of these are commands.
  return command ?? kindOf(event.code.replace("Digit", ""));
}

/** @param {string} number @returns {(() => unknown) | undefined} */
function kindOf(number) {
  const kind = store.get("kinds")[Number(number) - 1];
  return kind && (() => store.set({ kind }));
}

/** @typedef {import("../video/stage.js").Stage} Stage */

/**
 * @param {Stage | undefined} stage
 * @returns {{u: number, v: number} | undefined} where the cross is
 */
function cursorOf(stage) {
  if (!stage) return undefined;
  const { pictureWidth, pictureHeight } = stage.view;
  return (
    stage.marks.places.get(stage.marks.cursor) ?? { u: pictureWidth / 2, v: pictureHeight / 2 }
  );
}

/** @param {Stage | undefined} stage @param {number[]} direction @param {number} step  screen px */
function moveCursor(stage, [dx, dy], step) {
  const at = cursorOf(stage);
  if (!stage || !at) return;
  const { scale, pictureWidth, pictureHeight } = stage.view;
  const u = Math.min(Math.max(at.u + (dx * step) / scale, 0), pictureWidth - 1);
  const v = Math.min(Math.max(at.v + (dy * step) / scale, 0), pictureHeight - 1);
  stage.marks.put(stage.marks.cursor, u, v);
}

/** @param {Stage | undefined} stage */
function pressAtCursor(stage) {
  const at = cursorOf(stage);
  if (!stage || !at || stage.marks.cursor.hidden) return;
  const { x, y } = stage.view.toScreen(at.u, at.v);
  stage.pressed(x, y, stage.frame?.stampNs ?? null);
}
