// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/**
 * How the picture looks.
 *
 * @typedef {object} Look
 * @property {import("./palettes.js").Palette} palette
 * @property {number} brightness  -100 to 100
 * @property {number} contrast  -100 to 100
 * @property {number} local  local contrast, 0 to 100
 * @property {boolean} isotherm
 * @property {number} degrees  of the isotherm, where the picture has a scale
 * @property {number} percent  of grey, where it has none
 * @property {number} opacity  of the map, 0 to 100
 */

/** @type {Look} */
export const PLAIN = {
  palette: "white_hot",
  brightness: 0,
  contrast: 0,
  local: 0,
  isotherm: false,
  degrees: 40,
  percent: 80,
  opacity: 100,
};
