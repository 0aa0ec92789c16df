// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Writes numbers as people read them. Unknown values (null) become a dash, never NaN. */

export const UNKNOWN = "–";

/**
 * @param {number | null | undefined} value
 * @returns {value is number}
 */
export function known(value) {
  return typeof value === "number" && Number.isFinite(value);
}

/**
 * @param {number | null | undefined} value
 * @param {number} digits
 * @param {string} unit
 */
export function quantity(value, digits, unit) {
  return known(value) ? `${value.toFixed(digits)} ${unit}` : UNKNOWN;
}

/** @param {number | null | undefined} degrees */
export function bearing(degrees) {
  if (!known(degrees)) return UNKNOWN;
  return `${String(Math.round(((degrees % 360) + 360) % 360) % 360).padStart(3, "0")}°`;
}

/** @param {number | null | undefined} metres */
export function distance(metres) {
  if (!known(metres)) return UNKNOWN;
  if (metres >= 10000) return `${(metres / 1000).toFixed(1)} km`;
  return metres >= 100 ? `${metres.toFixed(0)} m` : `${metres.toFixed(1)} m`;
}

/** @param {number} metres @returns {string} with fewer digits for large sizes */
function size(metres) {
  return metres >= 10 ? metres.toFixed(0) : metres.toFixed(1);
}

/**
 * @param {import("../store.js").Ellipse | null | undefined} ellipse
 * @returns {string} e.g. "1.2 x 0.8 m at 40°"
 */
export function ellipse(ellipse) {
  if (!ellipse || !known(ellipse.major_m)) return UNKNOWN;
  const axes = `${size(ellipse.major_m)} x ${size(ellipse.minor_m)} m`;
  return `${axes} at ${ellipse.azimuth_deg.toFixed(0)}°`;
}

/** @param {string | number | null | undefined} ns  time since 1970 as "14:03:27" of this place */
export function clock(ns) {
  const ms = Number(ns) / 1e6;
  if (!ns || !Number.isFinite(ms)) return UNKNOWN;
  return new Date(ms).toLocaleTimeString("en-GB");
}

/** @param {string | number | null | undefined} ns  date and time of this place, and of UTC */
export function dateAndTime(ns) {
  const ms = Number(ns) / 1e6;
  if (!ns || !Number.isFinite(ms)) return UNKNOWN;
  const utc = new Date(ms).toISOString().slice(11, 19);
  return `${new Date(ms).toLocaleString("en-GB")} (${utc} UTC)`;
}

/** @param {number | null | undefined} seconds  e.g. "0.05 s", "12 s", "3 min" */
export function age(seconds) {
  if (!known(seconds)) return UNKNOWN;
  if (seconds < 9.95) return `${seconds.toFixed(seconds < 0.995 ? 2 : 1)} s`;
  return seconds < 120 ? `${seconds.toFixed(0)} s` : `${(seconds / 60).toFixed(0)} min`;
}

/** @param {string} text */
export function capital(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/** @param {string | null | undefined} state  e.g. "dead_reckoning" as "dead reckoning" */
export function plain(state) {
  return state ? state.replaceAll("_", " ") : UNKNOWN;
}

/** @param {{name: string, kind: string}} target  what it is called: its name, or its kind */
export function called(target) {
  return target.name || capital(target.kind);
}
