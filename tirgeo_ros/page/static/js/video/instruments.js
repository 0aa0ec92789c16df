// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The scale bar and the compass rose, which help to read the picture as a map. */

import { FOOT_M, bearing, inFeet } from "../shell/words.js";
import { sizeOf, write } from "./lettering.js";

/** @typedef {import("./label_places.js").Box} Box */

const WHITE = "#fff";
const BLACK = "rgb(0 0 0 / 85%)";
const NEEDLE = [[0, 1], [0.32, -0.8], [0, -0.45], [-0.32, -0.8]]; // prettier-ignore
const NEEDLE_TIMES = 1.1; // half the needle's length, in sizes of the letters
const LETTER_TIMES = 1.8; // distance of the N from the needle's middle
const REACH_TIMES = 2.4;
const BAR_ROOM_PX = 6;
const MOST_LIFT_PX = 30; // farther up another length would be true

/** @param {number} metres  a round number @returns {{share: number, text: string}} of the bar */
function lengthOf(metres) {
  if (inFeet()) return inRoundFeet(metres / FOOT_M);
  if (metres >= 1000) return { share: 1, text: `${metres / 1000} km` };
  return { share: 1, text: metres >= 1 ? `${metres} m` : `${Math.round(metres * 100)} cm` };
}

/** @param {number} feet @returns {{share: number, text: string}} of the largest round number */
function inRoundFeet(feet) {
  const power = 10 ** Math.floor(Math.log10(feet));
  const round = power * (feet >= 5 * power ? 5 : feet >= 2 * power ? 2 : 1);
  return { share: round / feet, text: `${Number(round.toPrecision(1))} ft` };
}

/**
 * Draws a length on the ground where it has this length, if that is on the screen: a little higher
 * where the status line stands.
 * @param {CanvasRenderingContext2D} context
 * @param {import("./view.js").PictureView} view
 * @param {[number, number, number, number]} bar
 * @param {number} size  of letters
 * @param {Box[]} taken  where words stand
 * @returns {Box[]} where it is
 */
export function paintBar(context, view, [left, right, row, metres], size, taken) {
  const { share, text } = lengthOf(metres);
  const [from, to] = [left, left + share * (right - left)].map((u) => view.toScreen(u, row));
  from.y = to.y = lifted(from.y, taken);
  const [wide, high] = sizeOf(context, text, size);
  const top = from.y - high - 0.4 * size;
  if (from.x < 0 || to.x > view.width || top < 0 || from.y > view.height) return [];
  const path = new Path2D();
  path.moveTo(from.x, from.y - 0.35 * size);
  path.lineTo(from.x, from.y);
  path.lineTo(to.x, to.y);
  path.lineTo(to.x, to.y - 0.35 * size);
  haloed(context, path, 2);
  const middle = Math.max((from.x + to.x) / 2, wide / 2);
  write(context, text, size, [middle - wide / 2, top, middle + wide / 2, top + high], WHITE);
  return [[from.x - 4, top, Math.max(to.x, middle + wide / 2) + 4, from.y + 4]];
}

/** @param {number} y @param {Box[]} taken @returns {number} above words that would hide it */
function lifted(y, taken) {
  const hiding = taken.filter(([, top, , bottom]) => y + BAR_ROOM_PX > top && y < bottom);
  const free = Math.min(y, ...hiding.map(([, top]) => top - BAR_ROOM_PX));
  return y - free <= MOST_LIFT_PX ? free : y;
}

/** @param {CanvasRenderingContext2D} context @param {Path2D} path @param {number} width */
function haloed(context, path, width) {
  context.lineJoin = "miter";
  context.lineWidth = width + 2.5;
  context.strokeStyle = BLACK;
  context.stroke(path);
  context.lineWidth = width;
  context.strokeStyle = WHITE;
  context.stroke(path);
}

/**
 * Draws the rose in the right upper corner; up is the heading.
 * @param {CanvasRenderingContext2D} context
 * @param {Box} within  what is seen of the picture
 * @param {number} heading  degrees
 * @param {number} size  of letters
 * @returns {Box[]} where it is
 */
export function paintRose(context, within, heading, size) {
  const reach = REACH_TIMES * size;
  const [x, y] = [within[2] - reach, within[1] + reach];
  const turn = (-heading * Math.PI) / 180;
  const path = needleOf(x, y, turn, NEEDLE_TIMES * size);
  haloed(context, path, 1);
  context.fillStyle = WHITE;
  context.fill(path);
  const far = LETTER_TIMES * size;
  writeAt(context, "N", x + far * Math.sin(turn), y - far * Math.cos(turn), size);
  writeAt(context, bearing(heading), x, y + reach + 0.4 * size, size);
  return [[within[2] - 2 * reach, within[1], within[2], y + reach + 1.2 * size]];
}

/** @param {number} x @param {number} y @param {number} turn  rad @param {number} half */
function needleOf(x, y, turn, half) {
  const path = new Path2D();
  for (const [right, north] of NEEDLE) {
    const east = right * Math.cos(turn) + north * Math.sin(turn);
    const down = right * Math.sin(turn) - north * Math.cos(turn);
    path.lineTo(x + half * east, y + half * down);
  }
  path.closePath();
  return path;
}

/**
 * @param {CanvasRenderingContext2D} context @param {string} text
 * @param {number} x  of the middle @param {number} y @param {number} size
 */
function writeAt(context, text, x, y, size) {
  const [wide, high] = sizeOf(context, text, size);
  const box = /** @type {Box} */ ([x - wide / 2, y - high / 2, x + wide / 2, y + high / 2]);
  write(context, text, size, box, WHITE);
}
