// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Shows where a place of the map is in the video, for some seconds: the video moves on. */

import { ask } from "../link/state_link.js";
import { said, t } from "../shell/language.js";
import { toast } from "../shell/toast.js";
import { store } from "../store.js";
import { stageOf } from "../video/stages.js";

const TIMES = 20;
const PERIOD_MS = 300;

let newest = 0;

/**
 * @param {number} latitude_deg
 * @param {number} longitude_deg
 */
export async function where(latitude_deg, longitude_deg) {
  const { current } = store.values;
  const mine = ++newest;
  for (let time = 0; time < TIMES && mine === newest; time += 1) {
    const answer = await ask("where", { aircraft: current, latitude_deg, longitude_deg });
    if (mine !== newest) return;
    if (store.get("still")) return refused(time, t("over.still")); // the answer is of a live one
    if (!answer.ok) return refused(time, answer.reason ?? "");
    stageOf(current)?.marks.point(answer.u, answer.v);
    await new Promise((resolve) => setTimeout(resolve, PERIOD_MS));
  }
}

/** @param {number} time  number of the try: only the first refusal is shown */
function refused(time, reason = "") {
  if (time === 0)
    toast(t("map.not_in_video", { reason: said(reason) }), { tone: "bad", milliseconds: 4000 });
}
