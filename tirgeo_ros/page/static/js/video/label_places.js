// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/**
 * Where labels have room: the most important first, each at the place that it had before, or at
 * the first free one. All sizes are CSS pixels.
 *
 * @typedef {[left: number, top: number, right: number, bottom: number]} Box
 * @typedef {number[][]} Places  offsets of a label's middle, in `half` units
 *
 * @typedef {object} Request
 * @property {string} key  of the same label in the next frame
 * @property {number} x  of the anchor
 * @property {number} y
 * @property {number} width
 * @property {number} height
 * @property {number[]} half  horizontal and vertical unit of the places
 * @property {Places} places  the best first
 * @property {boolean} mark  the anchor must stay free
 */

const ROOM_PX = 4; // around a new place, so that the label need not move again soon
const STAYS_WITHIN = 0.8; // of its size, until a label leaves its outline

/** @type {Record<string, Places>} */
const PLACES = {
  beside: [[1, 0], [-1, 0], [0, -1], [0, 1], [1, -1], [1, 1], [-1, -1], [-1, 1]], // prettier-ignore
  along: [[0, -1], [0, 1], [1, 0], [-1, 0], [0, 0]], // prettier-ignore
  under: [[0, 1], [0, -1], [1, 0], [-1, 0]], // prettier-ignore
  within: [[0, 0], [0, -1], [0, 1], [0, -2], [0, 2]], // prettier-ignore
};

export const ALONG = 0;
export const BESIDE = 1;
export const INSIDE = 2;

export class LabelPlaces {
  constructor() {
    /** @type {Map<string, {places: Places, number: number}>} */
    this.before = new Map();
  }

  /**
   * Begins a frame.
   * @param {Box} within  what is seen of the picture
   * @param {Box[]} taken  where no label may be
   * @param {number[][]} marks  places that a label covers only if it must
   */
  begin(within, taken, marks) {
    this.within = within;
    this.taken = [...taken];
    this.marks = marks;
    this.last = this.before;
    this.before = new Map();
  }

  /**
   * @param {string} key @param {number[]} anchor  x, y @param {number[]} size  width, height
   * @param {number} kind  ALONG, BESIDE or INSIDE
   * @param {number[]} half  of the mark or the outline, in x and y
   * @returns {Box | null} null: there is no room
   */
  place(key, [x, y], [width, height], kind, half) {
    const [halfX, halfY] = [width / 2, height / 2];
    const outer = [halfX + half[0], halfY + half[1]];
    const request = { key, x, y, width, height, mark: kind === BESIDE };
    if (kind === BESIDE) return this.find({ ...request, half: outer, places: PLACES.beside });
    const stays = this.last?.get(key)?.places === PLACES.within ? STAYS_WITHIN : 1;
    const small = half[0] < stays * halfX || half[1] < stays * halfY;
    if (kind === INSIDE && small)
      return this.find({ ...request, half: outer, places: PLACES.under });
    const places = kind === INSIDE ? PLACES.within : PLACES.along;
    return this.find({ ...request, half: [halfX, halfY], places });
  }

  /** @param {Request} request @returns {Box | null} */
  find(request) {
    const { key, places } = request;
    const last = this.last?.get(key);
    const stays =
      last?.places === places && this.isFree(this.boxAt(request, last.number), request, 0);
    const number = stays ? last.number : this.newPlace(request);
    if (number < 0) return null;
    const box = this.boxAt(request, number);
    this.before.set(key, { places, number });
    this.taken?.push(box);
    return box;
  }

  /** @param {Request} request @returns {number} of the first free place; -1: there is none */
  newPlace(request) {
    let second = -1;
    for (let number = 0; number < request.places.length; number += 1) {
      const box = this.boxAt(request, number);
      if (!this.isFree(box, request, ROOM_PX)) continue;
      if (!this.coversMark(box)) return number;
      if (second < 0) second = number;
    }
    return second;
  }

  /** @param {Request} request @param {number} number @returns {Box} moved into the picture */
  boxAt({ x, y, width, height, half, places }, number) {
    const [left, top, right, bottom] = this.within ?? [0, 0, 0, 0];
    const boxX = x + places[number][0] * half[0] - width / 2;
    const boxY = y + places[number][1] * half[1] - height / 2;
    const inX = Math.max(Math.min(boxX, right - width), left);
    const inY = Math.max(Math.min(boxY, bottom - height), top);
    return [inX, inY, inX + width, inY + height];
  }

  /** @param {Box} box @param {Request} request @param {number} room */
  isFree([left, top, right, bottom], { x, y, mark, width, height }, room) {
    const within = this.within ?? [0, 0, 0, 0];
    if (width > within[2] - within[0] || height > within[3] - within[1]) return false;
    if (mark && x > left && x < right && y > top && y < bottom) return false;
    for (const [x0, y0, x1, y1] of this.taken ?? []) {
      if (left - room < x1 && x0 < right + room && top - room < y1 && y0 < bottom + room)
        return false;
    }
    return true;
  }

  /** @param {Box} box */
  coversMark([left, top, right, bottom]) {
    return this.marks?.some(([x, y]) => x > left && x < right && y > top && y < bottom) ?? false;
  }
}
