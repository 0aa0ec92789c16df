// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Makes a target of a press on the video, or shows there why it cannot. */

import { ask } from "../link/state_link.js";
import { said, t } from "../shell/language.js";
import { capital, coordinate, ellipse } from "../shell/words.js";
import { mayChange, store, targetOf } from "../store.js";
import { changed } from "../targets/changes.js";
import { filtered } from "../targets/filter.js";
import { sameAs } from "../targets/merging.js";

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
    marks.refused(u, v, t("press.viewer"));
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
  else marks.refused(u, v, capital(answer.reason ? said(answer.reason) : t("press.refused")));
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
  const words = [
    target.number,
    coordinate(target.coordinates),
    t("words.ellipse", { ellipse: ellipse(target.ellipse) }),
  ];
  if (answer.temperature_c !== null) words.push(`${answer.temperature_c.toFixed(1)} °C`);
  marks.located(u, v, words.join("  ·  "), target.id);
  const same = refined ? null : sameAs(target, answer.near);
  if (same) marks.offer(same);
  store.set({ refine: null, selected: refined ? target.id : store.get("selected") });
  const { number, clicks } = target;
  const isListed = filtered([target]).length > 0;
  const set = isListed ? t("press.set", { number }) : t("press.set_hidden", { number });
  const averaged = t("press.averaged", { number, count: clicks });
  const warning = target.clicks_agree ? "" : `. ${t("merge.disagree")}`;
  changed(refined ? averaged + warning : set, target.id);
}
