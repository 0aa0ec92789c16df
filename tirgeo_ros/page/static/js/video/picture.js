// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The picture as the operator wants it: palette, tones and isotherm, by tables of grey values. */

import { PLAIN } from "./look_values.js";
import { hotTable, table } from "./palettes.js";

/**
 * @typedef {import("./message.js").Frame} Frame
 * @typedef {import("./look_values.js").Look} Look
 */

const COLUMNS = 40; // of the blurred picture that local contrast is against
const MOST_LOCAL = 3; // times that a difference from the neighbourhood is added

/** @param {Frame} frame @returns {boolean} whether it is a thermal picture in grey */
export function isGrey(frame) {
  return frame.shapes?.grey ?? false;
}

/** @param {number} grey @param {[number, number]} celsius  of grey 0 and 255 */
export function degreesOf(grey, [cold, hot]) {
  return cold + ((hot - cold) * grey) / 255;
}

/** @param {Frame} frame @param {Look} look @returns {number} grey value; 256: no isotherm */
export function isothermLevel({ shapes }, { isotherm, degrees, percent }) {
  if (!isotherm || !shapes?.grey) return 256;
  if (!shapes.celsius) return Math.ceil((percent / 100) * 255);
  const [cold, hot] = shapes.celsius;
  const grey = Math.ceil(((degrees - cold) / (hot - cold)) * 255);
  return Math.min(Math.max(grey, 0), 256);
}

/** @param {Look} look @returns {(grey: number) => number} */
function toneOf({ brightness, contrast }) {
  const slope = 2 ** (contrast / 50);
  const middle = 127.5 + 1.275 * brightness;
  return (grey) => Math.min(Math.max(middle + slope * (grey - 127.5), 0), 255);
}

/** Makes what is drawn of a frame. It is made once for a frame and a look. */
export class Picture {
  constructor() {
    this.canvas = document.createElement("canvas");
    this.small = document.createElement("canvas");
    this.wide = document.createElement("canvas");
    this.probe = contextOf(document.createElement("canvas")); // its upper left pixel
    this.made = "";
    /** @type {Frame | null} */
    this.frame = null;
  }

  /** @param {Frame} frame @param {Look} look @returns {CanvasImageSource} */
  of(frame, look) {
    const level = isothermLevel(frame, look);
    const { brightness, contrast, local } = look;
    const palette = isGrey(frame) ? look.palette : PLAIN.palette;
    const plain = palette === PLAIN.palette && !brightness && !contrast && !local && level > 255;
    if (plain) return frame.bitmap;
    const made = [palette, brightness, contrast, local, level].join();
    // Of one stamp a better picture may come: that of a still one.
    if (made !== this.made || frame !== this.frame) this.make(frame, { ...look, palette }, level);
    Object.assign(this, { made, frame });
    return this.canvas;
  }

  /** @param {Frame} frame @param {Look} look @param {number} level */
  make({ bitmap, shapes }, look, level) {
    const { width, height } = bitmap;
    fit(this.canvas, width, height);
    const context = contextOf(this.canvas);
    context.drawImage(bitmap, 0, 0);
    const image = context.getImageData(0, 0, width, height);
    const around = look.local ? this.blurred(bitmap) : null;
    if (shapes?.grey) colourGrey(image, around, look, level);
    else changeTones(image, around, look);
    context.putImageData(image, 0, 0);
  }

  /** @param {ImageBitmap} bitmap @returns {Uint8ClampedArray} the mean around each pixel */
  blurred(bitmap) {
    const { width, height } = bitmap;
    const [wide, high] = [COLUMNS, Math.max(Math.round((COLUMNS * height) / width), 1)];
    fit(this.small, wide, high);
    const small = contextOf(this.small);
    small.imageSmoothingQuality = "high";
    small.drawImage(bitmap, 0, 0, wide, high);
    fit(this.wide, width, height);
    const large = contextOf(this.wide);
    large.imageSmoothingQuality = "high";
    large.drawImage(this.small, 0, 0, width, height);
    return large.getImageData(0, 0, width, height).data;
  }

  /**
   * @param {Frame} frame @param {number} u @param {number} v  pixel of the full picture
   * @returns {number} its grey value
   */
  greyAt({ bitmap, width, height }, u, v) {
    const x = Math.round(((u + 0.5) / width) * bitmap.width - 0.5);
    const y = Math.round(((v + 0.5) / height) * bitmap.height - 0.5);
    this.probe.drawImage(bitmap, x, y, 1, 1, 0, 0, 1, 1);
    return this.probe.getImageData(0, 0, 1, 1).data[1];
  }
}

/** @param {HTMLCanvasElement} canvas @param {number} width @param {number} height */
function fit(canvas, width, height) {
  if (canvas.width !== width) canvas.width = width; // also clears it
  if (canvas.height !== height) canvas.height = height;
}

/** @param {HTMLCanvasElement} canvas @returns {CanvasRenderingContext2D} */
function contextOf(canvas) {
  const context = canvas.getContext("2d", { alpha: false, willReadFrequently: true });
  if (!context) throw new Error("this browser has no canvas");
  return context;
}

/**
 * @param {ImageData} image @param {Uint8ClampedArray | null} around @param {Look} look
 * @param {number} level
 */
function colourGrey({ data }, around, look, level) {
  const cool = table(look.palette, toneOf(look));
  const hot = hotTable(level);
  const gain = (look.local / 100) * MOST_LOCAL;
  const pixels = new Uint32Array(data.buffer);
  for (let k = 0; k < pixels.length; k += 1) {
    const grey = data[4 * k + 1];
    pixels[k] =
      grey >= level ? hot[grey] : cool[around ? sharper(grey, around[4 * k + 1], gain) : grey];
  }
}

/** @param {ImageData} image @param {Uint8ClampedArray | null} around @param {Look} look */
function changeTones({ data }, around, look) {
  const tones = Uint8Array.from({ length: 256 }, (_, value) => Math.round(toneOf(look)(value)));
  const gain = (look.local / 100) * MOST_LOCAL;
  for (let k = 0; k < data.length; k += 1) {
    if ((k & 3) === 3) continue;
    data[k] = tones[around ? sharper(data[k], around[k], gain) : data[k]];
  }
}

/** @param {number} value @param {number} around @param {number} gain @returns {number} a byte */
function sharper(value, around, gain) {
  return Math.min(Math.max(Math.round(value + gain * (value - around)), 0), 255);
}
