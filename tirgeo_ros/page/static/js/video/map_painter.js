// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/**
 * Draws the shapes of a frame over its picture. Lines and letters have the size of the screen, not
 * of the picture, so they are sharp however small the picture came.
 */

import { targetColour } from "./kind_colours.js";
import { paintBar, paintRose } from "./instruments.js";
import { LabelPlaces } from "./label_places.js";
import { mapLabels, MARK_PX, marksOf, targetLabels } from "./label_texts.js";
import { letterPx, sizeOf, write } from "./lettering.js";
import { pathsOf } from "./paths.js";

/**
 * @typedef {import("./shapes.js").Shapes} Shapes
 * @typedef {import("./label_places.js").Box} Box
 *
 * @typedef {object} Wishes  of the operator
 * @property {number} opacity  of the whole map
 * @property {string[]} layersOff  names
 * @property {string[]} labelsOff  names of layers
 *
 * @typedef {object} Sheet
 * @property {CanvasRenderingContext2D} context
 * @property {number} ratio  of its pixels to CSS pixels
 * @property {import("./view.js").PictureView} view
 * @property {Box} within  what is seen of the picture
 * @property {Box[]} taken  where other words stand
 * @property {number} skipPx  see detail.js
 * @property {number} ink  size of ink, relative to a picture of 640 x 512
 */

const HALO = "rgb(0 0 0 / 80%)";
const HALO_PX = 1.2; // on each side
const TARGET_LINE_PX = 2;
const LEAST_ELLIPSE = 1.5; // in radii of a mark: a smaller one could not be told from it
const LARGEST_ELLIPSE_PX = 4000;
const ELLIPSE = "#d7afff";
const DASHES = [7, 5];
const DOTS = [2, 6];

/** @param {number} width @param {number} height  of the box @returns {number} */
export function inkOf(width, height) {
  return Math.min(Math.max(Math.min(width / 640, height / 512), 0.75), 1.5);
}

export class MapPainter {
  constructor() {
    this.labels = new LabelPlaces();
  }

  /** @param {Omit<Sheet, "within">} given @param {Shapes} shapes @param {Wishes} wishes */
  paint(given, shapes, wishes) {
    const sheet = { ...given, within: seen(given.view) };
    const { context } = sheet;
    const shown = shapes.layers.map(({ name }) => !wishes.layersOff.includes(name));
    const paths = pathsOf(shapes, sheet.skipPx / sheet.view.scale);
    context.save();
    clip(sheet);
    context.globalAlpha = wishes.opacity;
    paintAreas(sheet, shapes, paths.areas, shown);
    paintEllipses(sheet, shapes, shown);
    paintLines(sheet, shapes, paths.strokes, shown);
    screenScale(sheet);
    context.globalAlpha = 1;
    this.paintWords(sheet, shapes, wishes, shown);
    context.restore();
  }

  /**
   * Writes what is written. Targets, bar and rose have room before the map's labels.
   * @param {Sheet} sheet @param {Shapes} shapes @param {Wishes} wishes @param {boolean[]} shown
   */
  paintWords(sheet, shapes, wishes, shown) {
    const { context, view, within } = sheet;
    const size = letterPx(view.width, view.height);
    const bar = shapes.bar ? paintBar(context, view, shapes.bar, size, sheet.taken) : [];
    const { heading_deg: heading } = shapes;
    const rose = heading === null ? [] : paintRose(context, within, heading, size);
    const marks = marksOf(view, shapes, shown);
    this.labels.begin(within, [...sheet.taken, ...bar, ...rose], marks);
    const targets = this.placed(sheet, size, targetLabels(sheet, shapes));
    const labels = this.placed(sheet, size, mapLabels(sheet, shapes, wishes, shown));
    context.globalAlpha = wishes.opacity;
    for (const [text, box, colour] of labels) write(context, text, size, box, colour);
    context.globalAlpha = 1;
    paintTargets(sheet, shapes);
    for (const [text, box, colour] of targets) write(context, text, size, box, colour);
  }

  /**
   * @param {Sheet} sheet @param {number} size @param {import("./label_texts.js").Written[]} labels
   * @returns {[string, Box, string][]} those that have room
   */
  placed({ context }, size, labels) {
    /** @type {[string, Box, string][]} */
    const result = [];
    /** @type {Map<string, number>} */
    const times = new Map();
    for (const { text, anchor, kind, half, colour } of labels) {
      const name = `${kind} ${text}`;
      times.set(name, (times.get(name) ?? 0) + 1);
      const key = `${times.get(name)} ${name}`;
      const box = this.labels.place(key, anchor, sizeOf(context, text, size), kind, half);
      if (box) result.push([text, box, colour]);
    }
    return result;
  }
}

/** @param {import("./view.js").PictureView} view @returns {Box} what is seen of the picture */
function seen(view) {
  const { left, top, width, height } = view.rectangle;
  const [right, bottom] = [
    Math.min(left + width, view.width),
    Math.min(top + height, view.height),
  ];
  return [Math.max(left, 0), Math.max(top, 0), right, bottom];
}

/** Lets nothing be drawn beside the picture. @param {Sheet} sheet */
function clip(sheet) {
  const [left, top, right, bottom] = sheet.within;
  screenScale(sheet);
  sheet.context.beginPath();
  sheet.context.rect(left, top, right - left, bottom - top);
  sheet.context.clip();
}

/** @param {Sheet} sheet  its unit becomes a pixel of the picture */
function pictureScale({ context, ratio, view }) {
  const { x, y } = view.toScreen(0, 0);
  const scale = ratio * view.scale;
  context.setTransform(scale, 0, 0, scale, ratio * x, ratio * y);
}

/** @param {Sheet} sheet  its unit becomes a CSS pixel */
function screenScale({ context, ratio }) {
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
}

/**
 * @param {Sheet} sheet @param {Shapes} shapes @param {import("./paths.js").Area[][]} areas
 * @param {boolean[]} shown
 */
function paintAreas(sheet, { layers }, areas, shown) {
  const { context } = sheet;
  const alpha = context.globalAlpha;
  pictureScale(sheet);
  layers.forEach(({ fill, fill_opacity: opacity }, number) => {
    if (!fill || !shown[number]) return;
    context.globalAlpha = alpha * opacity;
    context.fillStyle = fill;
    for (const { path, rule } of areas[number]) context.fill(path, rule);
  });
  context.globalAlpha = alpha;
}

/**
 * Draws lines and marks layer by layer, the faintest lines first: a faint line must not weaken a
 * strong one.
 * @param {Sheet} sheet @param {Shapes} shapes @param {import("./paths.js").Stroke[][]} strokes
 * @param {boolean[]} shown
 */
function paintLines(sheet, shapes, strokes, shown) {
  const { context, ink, view } = sheet;
  const alpha = context.globalAlpha;
  const marks = markPaths(sheet, shapes);
  shapes.layers.forEach(({ line, width }, number) => {
    if (!shown[number]) return;
    pictureScale(sheet);
    for (const { opacity, path } of strokes[number]) {
      context.globalAlpha = alpha * opacity;
      stroke(context, path, line, (ink * width) / view.scale, HALO_PX / view.scale);
    }
    context.globalAlpha = alpha;
    screenScale(sheet);
    if (marks[number]) stroke(context, marks[number], line, ink * width, HALO_PX);
  });
}

/**
 * @param {CanvasRenderingContext2D} context @param {Path2D} path @param {string} colour
 * @param {number} width @param {number} halo
 */
function stroke(context, path, colour, width, halo) {
  context.lineJoin = "bevel"; // round ones take two to three times as long without a graphics card
  context.lineCap = "butt";
  context.lineWidth = width + 2 * halo;
  context.strokeStyle = HALO;
  context.stroke(path);
  context.lineWidth = width;
  context.strokeStyle = colour;
  context.stroke(path);
}

/** @param {Sheet} sheet @param {Shapes} shapes @returns {Path2D[]} open diamonds, by layer */
function markPaths({ view, ink }, { marks }) {
  /** @type {Path2D[]} */
  const paths = [];
  for (let k = 0; k < marks.layers.length; k += 1) {
    const { x, y } = view.toScreen(marks.points[2 * k], marks.points[2 * k + 1]);
    addDiamond((paths[marks.layers[k]] ??= new Path2D()), x, y, MARK_PX * ink);
  }
  return paths;
}

/** @param {Path2D} path @param {number} x @param {number} y @param {number} radius */
function addDiamond(path, x, y, radius) {
  path.moveTo(x, y - radius);
  path.lineTo(x + radius, y);
  path.lineTo(x, y + radius);
  path.lineTo(x - radius, y);
  path.closePath();
}

/** @param {Sheet} sheet @param {Shapes} shapes @param {boolean[]} shown */
function paintEllipses(sheet, { ellipses }, shown) {
  screenScale(sheet);
  for (const [u, v, major, minor, angle, layer, dotted] of ellipses) {
    if (shown[layer] && isLarge(sheet, major))
      paintEllipse(sheet, [u, v, major, minor, angle], dotted ? DOTS : DASHES);
  }
}

/** @param {Sheet} sheet @param {number} major  px @returns {boolean} whether it is seen apart */
function isLarge({ view, ink }, major) {
  return major * view.scale >= LEAST_ELLIPSE * MARK_PX * ink;
}

/** @param {Sheet} sheet @param {number[]} ellipse @param {number[]} dashes */
function paintEllipse({ context, view }, [u, v, major, minor, angle], dashes) {
  const { x, y } = view.toScreen(u, v);
  const [longer, shorter] = [major, minor].map((axis) =>
    Math.min(axis * view.scale, LARGEST_ELLIPSE_PX),
  );
  const path = new Path2D();
  path.ellipse(x, y, longer, shorter, angle, 0, 2 * Math.PI);
  context.setLineDash(dashes);
  stroke(context, path, ELLIPSE, 1.5, HALO_PX);
  context.setLineDash([]);
}

/** @param {Sheet} sheet @param {Shapes} shapes */
function paintTargets(sheet, { targets }) {
  const { context, view, ink } = sheet;
  const radius = MARK_PX * ink;
  for (const [id, , u, v, major, minor, angle] of targets) {
    const { x, y } = view.toScreen(u, v);
    if (isLarge(sheet, major)) paintEllipse(sheet, [u, v, major, minor, angle], DASHES);
    const path = new Path2D();
    addDiamond(path, x, y, radius);
    stroke(context, path, targetColour(id), TARGET_LINE_PX * ink, HALO_PX);
  }
}
