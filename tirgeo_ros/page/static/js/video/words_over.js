// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The warning over a video, by its age and its fault: plain functions. */

import { said, t } from "../shell/language.js";
import { age } from "../shell/words.js";

const FROZEN_S = 1.0;
const SLOW_MS = 250;
const LATE_MS = 600;

/** @typedef {{tone: "old" | "still", title: string, detail: string}} Warning */

/**
 * Returns the warning over the picture, or null. The picture itself says why it has no map.
 * @param {{ageS: number, stillS: number | null, why: string}} video
 * @returns {Warning | null}
 */
export function wordsOver({ ageS, stillS, why }) {
  if (stillS !== null && Number.isFinite(stillS)) {
    const detail = t("over.still_age", { seconds: stillS.toFixed(0) });
    return { tone: "still", title: t("over.still"), detail };
  }
  if (ageS <= FROZEN_S) return null;
  if (Number.isFinite(ageS))
    return { tone: "old", title: t("over.frozen", { age: age(ageS) }), detail: why };
  return { tone: "old", title: said("NO VIDEO"), detail: why || t("over.waiting") };
}

/** @param {number | null} ms @returns {"good" | "caution" | "bad" | ""} */
export function latencyTone(ms) {
  if (ms === null) return "";
  if (ms < SLOW_MS) return "good";
  return ms < LATE_MS ? "caution" : "bad";
}
