// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The map's colours: those of the theme, read from the style sheet's custom properties. */

import { store } from "../store.js";

/**
 * @param {string} name  of a custom property, without "--map-"
 * @returns {string}
 */
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--map-${name}`).trim();
}

const AREAS = /building|house|roof|hall/i;
const WATER = /water|lake|pond|river|stream|hydrant|well|pump/i;
const WAYS = /path|road|street|track|way|rail|lane/i;

/**
 * How the features of the vector map are drawn, by style; the colours have the same names.
 * @type {Record<string, {weight: number, fill: number}>}
 */
export const STYLES = {
  line: { weight: 1, fill: 0.14 },
  way: { weight: 2, fill: 0.14 },
  building: { weight: 1, fill: 0.14 },
  water: { weight: 1, fill: 0.14 },
};

/**
 * Returns the style of a feature of the vector map. The files are of many makers, so the kind is
 * guessed from all short values; an unknown kind gets a thin line.
 * @param {any} feature
 * @returns {string}
 */
export function styleOf(feature) {
  const words = Object.values(feature?.properties ?? {})
    .filter((value) => typeof value === "string" && value.length < 24)
    .join(" ");
  if (WATER.test(words)) return "water";
  if (WAYS.test(words)) return "way";
  return AREAS.test(words) ? "building" : "line";
}

/**
 * @param {"track" | "footprint" | "target" | "measure"} what
 * @param {string} kind  of a target, whose colour it has; "": the theme's own
 */
export function lineStyle(what, kind = "") {
  const styles = {
    track: { weight: 2, opacity: 0.85 },
    footprint: { weight: 2, fillOpacity: 0.12, dashArray: "6 4" },
    target: { weight: 2, fillOpacity: 0.2 },
    measure: { weight: 3, dashArray: "2 6" },
  };
  const color = store.get("colours")[kind] ?? colour(what);
  return { color, interactive: false, ...styles[what] };
}
