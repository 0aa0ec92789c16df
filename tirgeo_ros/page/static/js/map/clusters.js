// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Puts targets together that are too near each other on the screen. */

import { worldPlace } from "./shapes.js";

/** @typedef {import("../store.js").Target} Target */
/** @typedef {{members: Target[], x: number, y: number}} Cluster  x, y: at zoom 0 */

const APART_PX = 44; // a finger in a glove hits one of two
export const NEAREST_ZOOM = 20; // from here on each is drawn by itself

/**
 * @param {Target[]} targets
 * @param {number} zoom
 * @param {string | null} alone  id of a target that stays by itself
 * @returns {Cluster[]} each with one member or more, in the order of their first ones
 */
export function clustersOf(targets, zoom, alone) {
  const side = APART_PX / 2 ** zoom;
  /** @type {Map<string, Cluster[]>} */
  const cells = new Map();
  /** @type {Cluster[]} */
  const all = [];
  for (const target of targets) {
    const [x, y] = worldPlace(target.latitude_deg, target.longitude_deg);
    const single = zoom >= NEAREST_ZOOM || target.id === alone;
    const near = single ? undefined : nearOf(cells, x, y, side);
    if (near) near.members.push(target);
    else all.push({ members: [target], x, y });
    if (!near && !single) cellOf(cells, x, y, side).push(all[all.length - 1]);
  }
  return all;
}

/**
 * @param {Map<string, Cluster[]>} cells @param {number} x @param {number} y @param {number} side
 * @returns {Cluster | undefined} one whose first member is near
 */
function nearOf(cells, x, y, side) {
  for (const dx of [-side, 0, side]) {
    for (const dy of [-side, 0, side]) {
      const found = cells
        .get(keyOf(x + dx, y + dy, side))
        ?.find((one) => Math.hypot(one.x - x, one.y - y) < side);
      if (found) return found;
    }
  }
  return undefined;
}

/**
 * @param {Map<string, Cluster[]>} cells @param {number} x @param {number} y @param {number} side
 * @returns {Cluster[]}
 */
function cellOf(cells, x, y, side) {
  const key = keyOf(x, y, side);
  const cell = cells.get(key) ?? [];
  cells.set(key, cell);
  return cell;
}

/** @param {number} x @param {number} y @param {number} side @returns {string} */
function keyOf(x, y, side) {
  return `${Math.floor(x / side)} ${Math.floor(y / side)}`;
}
