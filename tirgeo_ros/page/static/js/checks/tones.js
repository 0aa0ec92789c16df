// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The tones of numbers and findings: plain functions of the newest state. */

import { known } from "../shell/words.js";

/** @typedef {"good" | "caution" | "bad" | ""} Tone */

const POOR_HEADING_DEG = 1.0;
const BAD_HEADING_DEG = 3.0;
const POOR_POSITION_M = 0.5;
const BAD_POSITION_M = 5.0;
const LATE_S = 1.0;
const GONE_S = 3.0;

/** Tones by the severity of a finding. */
const TONES = { STOP: "bad", CAUTION: "caution", NOTE: "" };

/** @param {string} severity @returns {Tone} */
export function toneOf(severity) {
  return /** @type {any} */ (TONES)[severity] ?? "";
}

/** @param {any} state @returns {Tone} of the navigation */
export function navigationTone(state) {
  const name = state?.navigation?.state;
  if (name === "running") return "good";
  if (name === "lost") return "bad";
  return name ? "caution" : "";
}

/** @param {any} state @returns {Tone} */
export function rtkTone(state) {
  if (!state?.rtk) return "";
  return /fix/i.test(state.rtk) && !/no/i.test(state.rtk) ? "good" : "caution";
}

/**
 * @param {number | null | undefined} value
 * @param {number} poor
 * @param {number} bad
 * @returns {Tone}
 */
function toneBetween(value, poor, bad) {
  if (!known(value)) return "";
  if (value < poor) return "good";
  return value < bad ? "caution" : "bad";
}

/** @param {number | null | undefined} deg */
export const headingTone = (deg) => toneBetween(deg, POOR_HEADING_DEG, BAD_HEADING_DEG);
/** @param {number | null | undefined} metres */
export const positionTone = (metres) => toneBetween(metres, POOR_POSITION_M, BAD_POSITION_M);
/** @param {number | null | undefined} seconds */
export const ageTone = (seconds) => toneBetween(seconds, LATE_S, GONE_S);
