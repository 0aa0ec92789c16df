// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Draws a frame on the canvas of its stage: the picture, and the map of the same frame on it. */

import { store } from "../store.js";
import { Detail } from "./detail.js";
import { inkOf, MapPainter } from "./map_painter.js";
import { Picture } from "./picture.js";

/** @typedef {import("./label_places.js").Box} Box */

const MOST_RATIO = 2; // of the canvas's pixels to CSS pixels

export class FramePainter {
  /** @param {HTMLCanvasElement} canvas @param {import("./view.js").PictureView} view */
  constructor(canvas, view) {
    this.canvas = canvas;
    this.view = view;
    this.context = /** @type {CanvasRenderingContext2D} */ (
      canvas.getContext("2d", { alpha: false })
    );
    this.picture = new Picture();
    this.map = new MapPainter();
    this.detail = new Detail();
    /** @type {Box[]} */
    this.taken = [];
  }

  /** @param {number} width @param {number} height  CSS pixels */
  resize(width, height) {
    const ratio = Math.min(window.devicePixelRatio || 1, MOST_RATIO);
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
  }

  /**
   * Takes note of words over the picture: nothing written goes under them.
   * @param {HTMLElement[]} nodes
   * @returns {boolean} whether they have moved
   */
  keepFree(nodes) {
    const before = String(this.taken);
    this.taken = nodes
      .filter((node) => node.offsetWidth)
      .map((node) => {
        const { offsetLeft: left, offsetTop: top } = node;
        return [left, top, left + node.offsetWidth, top + node.offsetHeight];
      });
    return String(this.taken) !== before;
  }

  /** @param {import("./message.js").Frame} frame @param {number} decodeMs  that its shapes took */
  paint(frame, decodeMs) {
    const { context, view } = this;
    const ratio = this.canvas.width / view.width;
    const { left, top, width, height } = view.rectangle;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = "#000";
    context.fillRect(0, 0, view.width, view.height);
    context.drawImage(this.picture.of(frame, store.get("look")), left, top, width, height);
    if (frame.shapes) this.paintMap(frame.shapes, ratio, decodeMs);
  }

  /** @param {import("./shapes.js").Shapes} shapes @param {number} ratio @param {number} decodeMs */
  paintMap(shapes, ratio, decodeMs) {
    const { context, view, taken, detail } = this;
    const { layersOff, labelsOff, look } = store.values;
    const ink = inkOf(view.width, view.height);
    const begin = performance.now();
    this.map.paint({ context, view, taken, ratio, ink, skipPx: detail.skipPx }, shapes, {
      layersOff,
      labelsOff,
      opacity: look.opacity / 100,
    });
    detail.took(decodeMs + performance.now() - begin, verticesOf(shapes));
  }
}

/** @param {import("./shapes.js").Shapes} shapes */
function verticesOf({ rings, lines }) {
  return (rings.points.length + lines.points.length) / 2;
}
