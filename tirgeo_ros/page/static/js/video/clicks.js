// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Makes a target of a press on the video, or shows there why it cannot. */

import { ask } from "../link/state_link.js";
import { capital, ellipse } from "../shell/words.js";
import { mayChange, store, targetOf } from "../store.js";
import { changed } from "../targets/changes.js";

/** @typedef {import("./stage.js").Stage} Stage */

/**
 * Asks the server to locate a pixel of the picture with this stamp.
 * @param {Stage} stage
 * @param {number} u
 * @param {number} v
 * @param {string} stampNs  of the picture on the screen at the beginning of the press
 */
export async function pressed(stage, u, v, stampNs) {
  const { marks, aircraft } = stage;
  store.set({ current: aircraft.id });
  if (!mayChange()) {
    marks.refused(u, v, "You are a viewer: only operators set targets.");
    return;
  }
  marks.locating(u, v);
  const refine = targetOf(store.get("refine")) ? store.get("refine") : null;
  const click = {
    aircraft: aircraft.id,
    stamp_ns: stampNs,
    u,
    v,
    kind: store.get("kind"),
    refine,
  };
  const answer = await ask("click", click);
  if (answer.ok) located(marks, u, v, answer, refine !== null);
  else marks.refused(u, v, capital(answer.reason ?? "refused"));
}

/**
 * @param {import("./marks.js").Marks} marks
 * @param {number} u
 * @param {number} v
 * @param {any} answer
 * @param {boolean} refined
 */
function located(marks, u, v, answer, refined) {
  const { target } = answer;
  const words = [target.number, target.coordinates.decimal, `95 %: ${ellipse(target.ellipse)}`];
  if (answer.temperature_c !== null) words.push(`${answer.temperature_c.toFixed(1)} °C`);
  marks.located(u, v, words.join("  ·  "));
  store.set({ refine: null, selected: refined ? target.id : store.get("selected") });
  changed(
    refined
      ? `Target ${target.number} averaged over ${target.clicks} presses`
      : `Target ${target.number} set`,
    target.id,
  );
}
