// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The map's labels: as many as cover neither each other nor a target, the targets' names first. */

import { element } from "../shell/dom.js";
import { store } from "../store.js";
import { isOff } from "./layers.js";
import L from "./leaflet.js";

/**
 * @typedef {object} Label
 * @property {string} text
 * @property {number} x  its place at zoom 0
 * @property {number} y
 * @property {number} below  pixels from the place down to its middle
 * @property {string} look  its class
 *
 * @typedef {object} Source
 * @property {(view: View) => Label[]} labels  the most important first
 * @property {(view: View) => {x: number, y: number, radius: number}[]} taken  places of symbols
 *
 * @typedef {object} View
 * @property {number} zoom
 * @property {number[]} box  what is seen, at zoom 0: least x and y, largest x and y
 */

const MOST_LABELS = 60; // of one source
const MOST_TRIED = 400;
const AFTER_MS = 60; // after the marks of targets
const [LINE_PX, MOST_PX, MARGIN_PX] = [17, 200, 4];

/** @param {any} map @returns {View} what the map shows */
export function viewOf(map) {
  const zoom = map.getZoom();
  const { min, max } = map.getPixelBounds();
  return { zoom, box: [min.x, min.y, max.x, max.y].map((one) => one / 2 ** zoom) };
}

/** @param {any} map @param {Source[]} sources @returns {() => void} writes the labels anew */
export function buildLabels(map, sources) {
  const group = L.layerGroup().addTo(map);
  const update = () => {
    group.clearLayers();
    if (isOff("labels")) return;
    for (const label of chosen(viewOf(map), sources)) group.addLayer(marker(map, label));
  };
  let soon = 0;
  const updateSoon = () => {
    clearTimeout(soon);
    soon = setTimeout(update, AFTER_MS);
  };
  map.on("moveend", updateSoon);
  store.watch(["targets", "selected", "layersOff", "labelsOff", "mapOff"], updateSoon);
  return updateSoon;
}

/** @param {View} view @param {Source[]} sources @returns {Label[]} */
function chosen(view, sources) {
  const scale = 2 ** view.zoom;
  const taken = sources.flatMap((source) =>
    source.taken(view).map(({ x, y, radius }) => boxAt(x * scale, y * scale, radius, radius)),
  );
  return sources.flatMap((source) => thatFit(source.labels(view), taken, scale));
}

/** @param {Label[]} labels @param {any[]} taken  grows @param {number} scale @returns {Label[]} */
function thatFit(labels, taken, scale) {
  const fitting = [];
  for (const label of labels.slice(0, MOST_TRIED)) {
    if (fitting.length >= MOST_LABELS) break;
    const half = Math.min(widthOf(label.text), MOST_PX) / 2 + MARGIN_PX;
    const box = boxAt(label.x * scale, label.y * scale + label.below, half, LINE_PX / 2);
    if (taken.some((other) => other.overlaps(box))) continue;
    taken.push(box);
    fitting.push(label);
  }
  return fitting;
}

/** @param {number} x @param {number} y @param {number} halfWide @param {number} halfHigh */
function boxAt(x, y, halfWide, halfHigh) {
  return L.bounds([x - halfWide, y - halfHigh], [x + halfWide, y + halfHigh]);
}

/** @type {Map<string, number>} */
const widths = new Map();
const ruler = document.createElement("canvas").getContext("2d");

/** @param {string} text @returns {number} pixels, in whatever script it is written */
function widthOf(text) {
  if (!widths.has(text) && ruler) {
    ruler.font = `600 12px ${getComputedStyle(document.documentElement).fontFamily}`;
    widths.set(text, ruler.measureText(text).width);
  }
  return widths.get(text) ?? 0;
}

/** @param {any} map @param {Label} label */
function marker(map, { text, x, y, below, look }) {
  const html = element("span", { class: look, text, dir: "auto" });
  const symbol = L.divIcon({
    className: "map-label",
    html,
    iconSize: [0, 0],
    iconAnchor: [0, -below],
  });
  const place = map.unproject([x * 256, y * 256], 8);
  return L.marker(place, { icon: symbol, interactive: false, keyboard: false });
}
