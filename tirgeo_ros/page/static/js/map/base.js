// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The lowest layers of the map: the vector map, its labels, and tiles, if any. */

import { element, setText } from "../shell/dom.js";
import { store } from "../store.js";
import { featureStyle } from "./colours.js";
import L from "./leaflet.js";

const MOST_LABELS = 40;
const LABELS_FROM_ZOOM = 17;
const [LETTER_PX, LINE_PX] = [6.8, 17];
const LEAST_PX = 30; // what is smaller on the screen gets no label

/**
 * Draws the base, and updates it.
 * @param {any} map  Leaflet's
 * @param {() => void} ready  called when the vector map is there
 */
export function buildBase(map, ready) {
  const vector = L.geoJSON(null, {
    style: featureStyle,
    interactive: false,
    pointToLayer: (/** @type {any} */ feature, /** @type {any} */ place) =>
      L.circleMarker(place, featureStyle(feature)),
  }).addTo(map);
  const labels = L.layerGroup().addTo(map);
  const simplified = element("small", { class: "map-simplified", role: "status" });
  map.getContainer().append(simplified);
  let loadedFor = /** @type {string | null} */ (null);
  let tiles = /** @type {any} */ (null);

  store.watch(["link", "current"], async () => {
    if (store.get("link").phase !== "open") return;
    const { current } = store.values;
    if (loadedFor === current) return;
    loadedFor = current;
    if (await load(vector, current)) {
      label(map, vector, labels);
      setText(simplified, vector.simplified && `Map simplified: ${vector.simplified}`);
      ready();
    } else loadedFor = null;
  });
  store.watch(["theme"], () => vector.setStyle(featureStyle));
  map.on("moveend", () => {
    if (store.get("tiles") && !tiles) tiles = addTiles(map); // not before the map has a place
    label(map, vector, labels);
  });
  return vector;
}

/**
 * Adds the tiles of an MBTiles file, below all lines; above its largest zoom they are enlarged.
 * @param {any} map @returns {any}
 */
function addTiles(map) {
  const { max, attribution } = store.get("tiles");
  const { body } = new DOMParser().parseFromString(attribution, "text/html"); // often a link
  map.getContainer().append(element("small", { class: "map-credit", text: body.textContent }));
  const options = { maxNativeZoom: max, maxZoom: 22, className: "tiles" };
  return L.tileLayer("/tiles/{z}/{x}/{y}", options).addTo(map);
}

/**
 * @param {any} vector
 * @param {string} aircraft
 * @returns {Promise<boolean>} whether the server answered; an aircraft may have an empty map
 */
async function load(vector, aircraft) {
  try {
    const answer = await fetch(`/map/${encodeURIComponent(aircraft)}`);
    const text = answer.ok ? await answer.text() : "";
    vector.clearLayers();
    const features = text ? JSON.parse(text) : null;
    if (features) vector.addData(features);
    vector.simplified = features?.simplified ?? "";
    return answer.ok || answer.status === 404;
  } catch {
    return false; // requested again after the next reconnection
  }
}

/**
 * Writes the names of features in view, as many as do not cover each other.
 * @param {any} map @param {any} vector @param {any} labels
 */
function label(map, vector, labels) {
  labels.clearLayers();
  if (map.getZoom() < LABELS_FROM_ZOOM) return;
  /** @type {any[]} */
  const taken = [];
  vector.eachLayer((/** @type {any} */ layer) => {
    const name = layer.feature?.properties?.name;
    if (!name || taken.length >= MOST_LABELS || !isLargeEnough(map, layer)) return;
    const place = layer.getLatLng?.() ?? layer.getBounds().getCenter();
    const box = boxOf(map.latLngToContainerPoint(place), String(name));
    if (!map.getBounds().contains(place) || taken.some((other) => other.overlaps(box))) return;
    taken.push(box);
    labels.addLayer(labelAt(place, String(name)));
  });
}

/** @param {any} map @param {any} layer @returns {boolean} for a label; points only if near */
function isLargeEnough(map, layer) {
  if (layer.getLatLng) return map.getZoom() > LABELS_FROM_ZOOM + 1;
  const { min, max } = L.bounds(
    [layer.getBounds().getNorthWest(), layer.getBounds().getSouthEast()].map((corner) =>
      map.latLngToContainerPoint(corner),
    ),
  );
  return Math.max(max.x - min.x, max.y - min.y) >= LEAST_PX;
}

/** @param {{x: number, y: number}} middle @param {string} name @returns {any} on the screen */
function boxOf({ x, y }, name) {
  const [wide, high] = [(name.length * LETTER_PX) / 2 + 4, LINE_PX / 2];
  return L.bounds([x - wide, y - high], [x + wide, y + high]);
}

/** @param {any} place @param {string} name */
function labelAt(place, name) {
  const html = element("span", { text: name });
  const symbol = L.divIcon({ className: "map-label", html, iconSize: [0, 0] });
  return L.marker(place, { icon: symbol, interactive: false, keyboard: false });
}
