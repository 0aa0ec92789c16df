// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/**
 * Where the picture lies on the screen: zoom, pan, and pixels of the picture from places on the
 * screen and back. Pixel (0, 0) is the middle of the first one, so the picture begins at -0.5.
 */

const MOST_ZOOM = 8;

/** @param {number} value @param {number} low @param {number} high */
function clamp(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

export class PictureView {
  constructor() {
    this.width = 1; // of the box on the screen, CSS pixels
    this.height = 1;
    this.pictureWidth = 640;
    this.pictureHeight = 512;
    this.zoom = 1;
    this.middle = [0.5, 0.5]; // of the box, as a share of the picture
  }

  /** @param {number} width @param {number} height */
  setBox(width, height) {
    this.width = Math.max(width, 1);
    this.height = Math.max(height, 1);
    this.keepInside();
  }

  /** @param {number} width @param {number} height */
  setPicture(width, height) {
    this.pictureWidth = width;
    this.pictureHeight = height;
    this.keepInside();
  }

  /** @returns {number} CSS pixels for one pixel of the picture */
  get scale() {
    const fit = Math.min(this.width / this.pictureWidth, this.height / this.pictureHeight);
    return fit * this.zoom;
  }

  /** @returns {{left: number, top: number, width: number, height: number}} of the whole picture */
  get rectangle() {
    const [width, height] = [this.pictureWidth * this.scale, this.pictureHeight * this.scale];
    const left = this.width / 2 - this.middle[0] * width;
    return { left, top: this.height / 2 - this.middle[1] * height, width, height };
  }

  /**
   * @param {number} x  CSS pixels from the box's left upper corner
   * @param {number} y
   * @returns {{u: number, v: number} | null} null outside the picture
   */
  toPicture(x, y) {
    const { left, top } = this.rectangle;
    const u = (x - left) / this.scale - 0.5;
    const v = (y - top) / this.scale - 0.5;
    const inside =
      u >= -0.5 && v >= -0.5 && u <= this.pictureWidth - 0.5 && v <= this.pictureHeight - 0.5;
    return inside ? { u, v } : null;
  }

  /** @param {number} u @param {number} v @returns {{x: number, y: number}} */
  toScreen(u, v) {
    const { left, top } = this.rectangle;
    return { x: left + (u + 0.5) * this.scale, y: top + (v + 0.5) * this.scale };
  }

  /** @param {number} dx @param {number} dy  CSS pixels */
  panBy(dx, dy) {
    const { width, height } = this.rectangle;
    this.middle = [this.middle[0] - dx / width, this.middle[1] - dy / height];
    this.keepInside();
  }

  /**
   * Zooms about the place (x, y) of the box.
   * @param {number} factor @param {number} x @param {number} y
   */
  zoomAt(factor, x, y) {
    const before = this.rectangle;
    const [shareX, shareY] = [(x - before.left) / before.width, (y - before.top) / before.height];
    this.zoom = clamp(this.zoom * factor, 1, MOST_ZOOM);
    const { width, height } = this.rectangle;
    this.middle = [shareX - (x - this.width / 2) / width, shareY - (y - this.height / 2) / height];
    this.keepInside();
  }

  reset() {
    this.zoom = 1;
    this.middle = [0.5, 0.5];
  }

  /** Moves the picture so that there is empty space only if the picture is smaller than the box. */
  keepInside() {
    const { width, height } = this.rectangle;
    const keep = (/** @type {number} */ middle, /** @type {number} */ share) =>
      share >= 1 ? 0.5 : clamp(middle, share / 2, 1 - share / 2);
    const [x, y] = this.middle;
    this.middle = [keep(x, this.width / width), keep(y, this.height / height)];
  }
}
