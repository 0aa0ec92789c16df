// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** What is written on the map in the video, and where its anchors are on the screen. */

import { targetColour } from "./kind_colours.js";
import { BESIDE } from "./label_places.js";

/**
 * @typedef {import("./shapes.js").Shapes} Shapes
 * @typedef {import("./map_painter.js").Sheet} Sheet
 * @typedef {import("./map_painter.js").Wishes} Wishes
 * @typedef {{text: string, anchor: number[], kind: number, half: number[], colour: string}} Written
 */

export const MARK_PX = 7;
const UNCERTAIN = "#a5a5a5";
const LABEL = "#fff";

/**
 * @param {Sheet} sheet @param {number} u @param {number} v
 * @returns {number[] | null} its place on the screen; null: it is not seen
 */
function anchorOf({ view, within: [left, top, right, bottom] }, u, v) {
  const { x, y } = view.toScreen(u, v);
  return x < left || y < top || x > right || y > bottom ? null : [x, y];
}

/** @param {Sheet} sheet @param {Shapes} shapes @returns {Written[]} the newest first */
export function targetLabels(sheet, { targets }) {
  const { ink } = sheet;
  const half = [1.5 * MARK_PX * ink, 1.5 * MARK_PX * ink];
  return [...targets].reverse().flatMap(([id, text, u, v]) => {
    const anchor = anchorOf(sheet, u, v);
    return anchor ? [{ text, anchor, kind: BESIDE, half, colour: targetColour(id) }] : [];
  });
}

/**
 * @param {Sheet} sheet @param {Shapes} shapes @param {Wishes} wishes @param {boolean[]} shown
 * @returns {Written[]} whose anchor is on the screen
 */
export function mapLabels(sheet, { labels, layers }, { labelsOff }, shown) {
  const { view, ink } = sheet;
  const named = layers.map(({ name }, number) => shown[number] && !labelsOff.includes(name));
  return labels.flatMap(([text, u, v, layer, kind, halfU, halfV, uncertain]) => {
    const anchor = named[layer] ? anchorOf(sheet, u, v) : null;
    if (!anchor) return [];
    const half =
      kind === BESIDE ? [MARK_PX * ink, MARK_PX * ink] : [halfU * view.scale, halfV * view.scale];
    return [{ text, anchor, kind, half, colour: uncertain ? UNCERTAIN : LABEL }];
  });
}

/**
 * @param {import("./view.js").PictureView} view @param {Shapes} shapes @param {boolean[]} shown
 * @returns {number[][]} places of marks and targets on the screen
 */
export function marksOf(view, { marks, targets }, shown) {
  const places = targets.map(([, , u, v]) => [u, v]);
  for (let k = 0; k < marks.layers.length; k += 1) {
    if (shown[marks.layers[k]]) places.push([marks.points[2 * k], marks.points[2 * k + 1]]);
  }
  return places.map(([u, v]) => {
    const { x, y } = view.toScreen(u, v);
    return [x, y];
  });
}
