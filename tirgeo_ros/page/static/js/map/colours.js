// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The map's colours: those of the theme, read from the style sheet's custom properties. */

/**
 * @param {string} name  of a custom property, without "--map-"
 * @returns {string}
 */
function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--map-${name}`).trim();
}

const AREAS = /building|house|roof|hall/i;
const WATER = /water|lake|pond|river|stream|hydrant|well|pump/i;
const WAYS = /path|road|street|track|way|rail|lane/i;

/**
 * Returns Leaflet's style of a feature of the vector map. The files are of many makers, so the kind
 * is guessed from all short values; an unknown kind gets a thin line.
 * @param {any} feature
 */
export function featureStyle(feature) {
  const words = Object.values(feature?.properties ?? {})
    .filter((value) => typeof value === "string" && value.length < 24)
    .join(" ");
  const line = WATER.test(words)
    ? "water"
    : WAYS.test(words)
      ? "way"
      : AREAS.test(words)
        ? "building"
        : "line";
  const drawn = colour(line);
  return {
    color: drawn,
    weight: line === "way" ? 2 : 1,
    opacity: 0.9,
    fillColor: drawn,
    fillOpacity: 0.14,
    radius: 4,
  };
}

/** @param {"track" | "footprint" | "target" | "measure"} what */
export function lineStyle(what) {
  const styles = {
    track: { weight: 2, opacity: 0.85 },
    footprint: { weight: 2, fillOpacity: 0.12, dashArray: "6 4" },
    target: { weight: 2, fillOpacity: 0.2 },
    measure: { weight: 3, dashArray: "2 6" },
  };
  return { color: colour(what), interactive: false, ...styles[what] };
}
