// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Writes numbers as people read them. Unknown values (null) become a dash, never NaN. */

import { store } from "../store.js";
import { language, said, t } from "./language.js";

export const UNKNOWN = "–";
export const FOOT_M = 0.3048;
const MILE_FT = 5280;
const KNOT_M_S = 1852 / 3600;

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

/** @returns {boolean} whether this screen writes feet and knots */
export function inFeet() {
  return store.get("units") === "feet";
}

/**
 * @param {number | null | undefined} metres
 * @param {number} digits  of metres; feet have one less
 */
export function length(metres, digits) {
  if (!inFeet() || !known(metres)) return quantity(metres, digits, "m");
  return quantity(metres / FOOT_M, Math.max(digits - 1, 0), "ft");
}

/**
 * Writes the lengths in a text of the server, as "40 m above ground", in this screen's units.
 * @param {string} text
 */
export function inUnits(text) {
  if (!inFeet()) return text;
  return text.replace(/(\d+(?:\.\d+)?) m\b(?!\/)/g, (_, metres) => length(Number(metres), 1));
}

/** @param {number | null | undefined} metresPerSecond */
export function speed(metresPerSecond) {
  if (!inFeet() || !known(metresPerSecond)) return quantity(metresPerSecond, 1, "m/s");
  return quantity(metresPerSecond / KNOT_M_S, 1, "kn");
}

/** @param {number | null | undefined} metres  e.g. "45.1 m", "320 m", "12.0 km" */
export function distance(metres) {
  if (!known(metres)) return UNKNOWN;
  const [small, large, ratio] = inFeet() ? ["ft", "mi", MILE_FT] : ["m", "km", 1000];
  const value = inFeet() ? metres / FOOT_M : metres;
  if (value >= 10 * ratio) return quantity(value / ratio, 1, large);
  return quantity(value, value >= 100 ? 0 : 1, small);
}

/** @param {number} metres @returns {string} without unit, with fewer digits for large sizes */
function size(metres) {
  const value = inFeet() ? metres / FOOT_M : metres;
  return value.toFixed(value >= 10 ? 0 : 1);
}

/** @param {Record<string, string>} coordinates @returns {string} in the form of this screen */
export function coordinate(coordinates) {
  return coordinates[store.get("form")] || coordinates.decimal;
}

/**
 * @param {import("../store.js").Ellipse | null | undefined} ellipse
 * @returns {string} e.g. "1.2 x 0.8 m at 40°"
 */
export function ellipse(ellipse) {
  if (!ellipse || !known(ellipse.major_m)) return UNKNOWN;
  const axes = `${size(ellipse.major_m)} x ${size(ellipse.minor_m)} ${inFeet() ? "ft" : "m"}`;
  return t("words.at", { size: axes, bearing: `${ellipse.azimuth_deg.toFixed(0)}°` });
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
  return `${new Date(ms).toLocaleString(language === "en" ? "en-GB" : language)} (${utc} UTC)`;
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
  return state ? said(state.replaceAll("_", " ")) : UNKNOWN;
}

/** @param {{name: string, kind: string}} target  what it is called: its name, or its kind */
export function called(target) {
  return target.name || capital(said(target.kind));
}
