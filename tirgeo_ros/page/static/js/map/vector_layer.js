// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/**
 * The vector map on tiles: a pan draws only the tiles that come into view, a zoom shows the old ones
 * until the new ones are there, and no piece of the work is long.
 */

import { colour, STYLES } from "./colours.js";
import L from "./leaflet.js";
import { meet } from "./shapes.js";

/** @typedef {import("./shapes.js").Shape} Shape */
/** @typedef {{x: number, y: number, scale: number}} View  of a tile: its corner at zoom 0 */

const TILE_PX = 512;
const EDGE_PX = 6; // by which a line or a point reaches into the next tile
const LEAST_PX = 0.8; // between drawn points of a line
const PIECE_MS = 8; // of work without a pause

/** Draws tiles one after the other, with pauses for fingers and video. */
class Queue {
  constructor() {
    /** @type {(() => void)[]} */
    this.jobs = [];
    this.waiting = false;
  }

  /** @param {() => void} job */
  add(job) {
    this.jobs.push(job);
    if (!this.waiting) setTimeout(() => this.work());
    this.waiting = true;
  }

  work() {
    const end = performance.now() + PIECE_MS;
    while (this.jobs.length && performance.now() < end) this.jobs.shift()?.();
    this.waiting = this.jobs.length > 0;
    if (this.waiting) setTimeout(() => this.work());
  }
}

const VectorLayer = L.GridLayer.extend({
  /** @param {any} options */
  initialize(options) {
    L.GridLayer.prototype.initialize.call(this, options);
    /** @type {Shape[]} */
    this.shapes = [];
    this.queue = new Queue();
  },

  show(/** @type {Shape[]} */ shapes) {
    this.shapes = shapes;
    this.redraw();
  },

  createTile(/** @type {any} */ coords, /** @type {(error: null, tile: any) => void} */ done) {
    const tile = document.createElement("canvas");
    const ratio = window.devicePixelRatio || 1;
    tile.width = TILE_PX * ratio;
    tile.height = TILE_PX * ratio;
    this.queue.add(() => {
      if (tile.isConnected) drawTile(tile, this.shapes, coords, ratio);
      done(null, tile);
    });
    return tile;
  },
});

/** @param {any} map @returns {any} Leaflet's layer, with `show(shapes)` */
export function buildVectorLayer(map) {
  const options = { tileSize: TILE_PX, maxZoom: 22, zIndex: 2, className: "vector-tiles" };
  return new VectorLayer(options).addTo(map);
}

/**
 * @param {HTMLCanvasElement} tile
 * @param {Shape[]} shapes
 * @param {{x: number, y: number, z: number}} coords
 * @param {number} ratio
 */
function drawTile(tile, shapes, { x, y, z }, ratio) {
  const context = tile.getContext("2d");
  if (!context) return;
  context.scale(ratio, ratio);
  const scale = 2 ** z;
  const side = TILE_PX / scale;
  const edge = EDGE_PX / scale;
  const corner = [x * side, y * side];
  const box = [...corner.map((one) => one - edge), ...corner.map((one) => one + side + edge)];
  const seen = shapes.filter((shape) => meet(shape.box, box));
  drawAll(context, seen, { x: corner[0], y: corner[1], scale });
}

/**
 * Draws shapes in their order; neighbours of one style and form are one path.
 * @param {CanvasRenderingContext2D} context @param {Shape[]} shapes @param {View} view
 */
function drawAll(context, shapes, view) {
  const colours = Object.fromEntries(Object.keys(STYLES).map((name) => [name, colour(name)]));
  for (let k = 0; k < shapes.length;) {
    const first = shapes[k];
    context.beginPath();
    for (; shapes[k]?.pen === first.pen; k += 1) trace(context, shapes[k], view);
    paint(context, first, colours[first.style]);
  }
}

/**
 * Fills and strokes a path.
 * @param {CanvasRenderingContext2D} context @param {Shape} shape  its first one
 * @param {string} own  colour
 */
function paint(context, { form, style, lines }, own) {
  const { weight, fill } = STYLES[style];
  context.lineWidth = weight;
  context.strokeStyle = own;
  context.fillStyle = own;
  context.globalAlpha = fill;
  if (form !== "line") context.fill(lines.length > 1 ? "evenodd" : "nonzero");
  context.globalAlpha = 0.9;
  context.stroke();
}

/** @param {CanvasRenderingContext2D} context @param {Shape} shape @param {View} view */
function trace(context, { form, lines }, view) {
  if (form === "point") circle(context, lines[0], view);
  else for (const line of lines) traceLine(context, line, view);
}

/** @param {CanvasRenderingContext2D} context @param {Float64Array} line @param {View} view */
function circle(context, [x, y], view) {
  const radius = 4;
  const [left, top] = [(x - view.x) * view.scale, (y - view.y) * view.scale];
  context.moveTo(left + radius, top);
  context.arc(left, top, radius, 0, 2 * Math.PI);
}

/**
 * Traces a line without points that are too near to the one before to be seen.
 * @param {CanvasRenderingContext2D} context @param {Float64Array} line @param {View} view
 */
function traceLine(context, line, { x, y, scale }) {
  let [lastX, lastY] = [(line[0] - x) * scale, (line[1] - y) * scale];
  context.moveTo(lastX, lastY);
  const end = line.length - 2;
  for (let k = 2; k <= end; k += 2) {
    const [left, top] = [(line[k] - x) * scale, (line[k + 1] - y) * scale];
    if (k < end && Math.abs(left - lastX) + Math.abs(top - lastY) < LEAST_PX) continue;
    context.lineTo(left, top);
    [lastX, lastY] = [left, top];
  }
}
