// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Words on the picture, of the screen's own letters: their size, and drawing them with a halo. */

const FAMILY = 'Roboto, "Segoe UI", "Noto Sans", "Liberation Sans", Arial, sans-serif';
const HALO = "rgb(0 0 0 / 85%)";
const MOST_WIDTHS = 2000;
/** A text whose first letter is of a script that is written from right to left. */
const RIGHT_TO_LEFT =
  /^\P{L}*[\p{Script=Hebrew}\p{Script=Arabic}\p{Script=Syriac}\p{Script=Thaana}]/u;

/** @type {Map<string, number>} */
const widths = new Map();

/** @param {number} width @param {number} height  of the box, CSS px @returns {number} CSS px */
export function letterPx(width, height) {
  return Math.min(Math.max(Math.min(width / 42, height / 24), 12), 16);
}

/** @param {number} size  of the letters @returns {number} of the halo on each side */
function haloPx(size) {
  return size / 7;
}

/**
 * @param {CanvasRenderingContext2D} context @param {string} text @param {number} size
 * @returns {number[]} width and height with the halo
 */
export function sizeOf(context, text, size) {
  const key = `${size} ${text}`;
  let width = widths.get(key);
  if (width === undefined) {
    if (widths.size > MOST_WIDTHS) widths.clear();
    useLetters(context, text, size);
    width = context.measureText(text).width;
    widths.set(key, width);
  }
  return [width + 2 * haloPx(size), size * 1.25 + 2 * haloPx(size)];
}

/**
 * @param {CanvasRenderingContext2D} context @param {string} text @param {number} size
 * @param {import("./label_places.js").Box} box @param {string} colour
 */
export function write(context, text, size, [left, top, , bottom], colour) {
  const [x, y] = [left + haloPx(size), (top + bottom) / 2];
  useLetters(context, text, size);
  context.lineWidth = 2 * haloPx(size);
  context.lineJoin = "round";
  context.strokeStyle = HALO;
  context.fillStyle = colour;
  context.strokeText(text, x, y);
  context.fillText(text, x, y);
}

/** @param {CanvasRenderingContext2D} context @param {string} text @param {number} size */
function useLetters(context, text, size) {
  context.font = `600 ${size}px ${FAMILY}`;
  context.textAlign = "left";
  context.textBaseline = "middle";
  context.direction = RIGHT_TO_LEFT.test(text) ? "rtl" : "ltr";
}
