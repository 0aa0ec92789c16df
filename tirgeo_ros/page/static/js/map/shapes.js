// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/**
 * The shapes of the vector map in the world's pixels at zoom 0, as Leaflet counts them: what a tile
 * shows is then found, and drawn, by a scale and a shift.
 */

/** @typedef {"area" | "line" | "point"} Form */

/**
 * @typedef {object} Shape
 * @property {Form} form
 * @property {string} layer  name of its layer
 * @property {string} name  "" without one
 * @property {string} style  as `featureStyle` names it
 * @property {string} pen  neighbours with the same one are drawn as one path
 * @property {Float64Array[]} lines  x, y, x, y, ...
 * @property {[number, number, number, number]} box  least x and y, largest x and y
 */

const WORLD = 256; // pixels at zoom 0
const FORMS = /** @type {Record<string, Form>} */ ({
  Polygon: "area",
  LineString: "line",
  Point: "point",
});

/**
 * @param {any} collection  GeoJSON of the server, or null without a map
 * @param {(feature: any) => string} styleOf
 * @returns {Shape[]} in the order of drawing
 */
export function shapesOf(collection, styleOf) {
  const features = collection?.features ?? [];
  return features
    .filter((/** @type {any} */ { geometry }) => geometry?.type in FORMS)
    .map((/** @type {any} */ feature) => shapeOf(feature, styleOf(feature)));
}

/** @param {any} feature @param {string} style @returns {Shape} */
function shapeOf({ geometry, properties }, style) {
  const form = FORMS[geometry.type];
  const { coordinates } = geometry;
  const lines = (
    form === "area" ? coordinates : [form === "point" ? [coordinates] : coordinates]
  ).map(worldLine);
  const { layer = "", name = "" } = properties ?? {};
  const pen = `${style} ${form} ${lines.length > 1 ? "holes" : ""}`;
  const texts = { layer: String(layer ?? ""), name: String(name ?? "") };
  return { form, style, pen, lines, box: boxOf(lines), ...texts };
}

/** @param {number[][]} places  [longitude, latitude], degrees */
function worldLine(places) {
  const line = new Float64Array(2 * places.length);
  places.forEach(([longitude, latitude], k) => {
    line.set(worldPlace(latitude, longitude), 2 * k);
  });
  return line;
}

/** @param {number} latitude @param {number} longitude @returns {[number, number]} of a place */
export function worldPlace(latitude, longitude) {
  const sine = Math.sin((Math.max(-85.0511, Math.min(85.0511, latitude)) * Math.PI) / 180);
  const north = Math.log((1 + sine) / (1 - sine)) / (4 * Math.PI);
  return [WORLD * (0.5 + longitude / 360), WORLD * (0.5 - north)];
}

/** @param {Float64Array[]} lines @returns {[number, number, number, number]} */
function boxOf(lines) {
  const box = /** @type {[number, number, number, number]} */ ([
    Infinity,
    Infinity,
    -Infinity,
    -Infinity,
  ]);
  for (const line of lines) {
    for (let k = 0; k < line.length; k += 2) grow(box, line[k], line[k + 1]);
  }
  return box;
}

/** @param {[number, number, number, number]} box @param {number} x @param {number} y */
function grow(box, x, y) {
  box[0] = Math.min(box[0], x);
  box[1] = Math.min(box[1], y);
  box[2] = Math.max(box[2], x);
  box[3] = Math.max(box[3], y);
}

/** @param {Shape[]} shapes @returns {[number, number, number, number] | null} of all of them */
export function wholeBox(shapes) {
  const corners = shapes.map(({ box }) => new Float64Array(box));
  return shapes.length ? boxOf(corners) : null;
}

/** @param {number[]} box @param {number[]} other @returns {boolean} whether they meet */
export function meet(box, other) {
  return box[0] <= other[2] && box[2] >= other[0] && box[1] <= other[3] && box[3] >= other[1];
}
