// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The moving map: north up, base below, targets and aircraft above. */

import { button, byId, element, setText } from "../shell/dom.js";
import { t } from "../shell/language.js";
import { inFeet } from "../shell/words.js";
import { currentState, store, targetOf } from "../store.js";
import { buildAircraft, centre } from "./aircraft_layer.js";
import { Base } from "./base.js";
import { buildLabels } from "./labels.js";
import { buildLayers } from "./layers.js";
import L from "./leaflet.js";
import { buildMeasuring } from "./measuring.js";
import { Targets } from "./target_layer.js";

const FIRST_ZOOM = 18;

/**
 * @param {(latitude_deg: number, longitude_deg: number) => void} where  shows a place in the video
 */
export function buildMap(where) {
  const holder = element("div", { id: "map", role: "application", "aria-label": t("map.moving") });
  const status = element("div", { class: "map-said", role: "status", hidden: true });
  byId("map-area").append(holder, status);
  const map = L.map(holder, {
    preferCanvas: true,
    attributionControl: false,
    zoomControl: false,
    maxZoom: 22,
    zoomSnap: 0.5,
    tapTolerance: 20,
    zoomAnimation: true,
  }).setView([0, 0], FIRST_ZOOM);
  loseNoView(map);
  buildScale(map);
  const measure = buildMeasuring(map, (words) => tell(status, words));
  const base = new Base(map, () => {
    comeToPlace(map, base);
    writeLabels();
  });
  const pressed = (/** @type {number} */ latitude, /** @type {number} */ longitude) =>
    store.get("measuring") ? measure([latitude, longitude]) : where(latitude, longitude);
  const targets = new Targets(map, (target) => {
    pressed(target.latitude_deg, target.longitude_deg);
    if (!store.get("measuring")) store.set({ selected: target.id, tab: "targets" });
  });
  const writeLabels = buildLabels(map, [targets.names, base.names]);
  buildAircraft(map);
  map.on("click", (/** @type {any} */ { latlng }) => pressed(latlng.lat, latlng.wrap().lng));
  map.on("dragstart", () => store.set({ follow: false }));
  byId("map-area").append(...mapTools(map, base));
  stayRight(map, holder);
}

/** Lets the last view that is asked for while the map zooms wait: Leaflet drops it. @param {any} map */
function loseNoView(map) {
  const setView = map.setView.bind(map);
  /** @type {any[] | null} */
  let waiting = null;
  map.setView = (/** @type {any[]} */ ...view) => {
    waiting = map._animatingZoom ? view : null;
    return waiting ? map : setView(...view);
  };
  map.on("zoomend", () => waiting && map.setView(...waiting));
}

/** Draws the scale, in the units of this screen. @param {any} map */
function buildScale(map) {
  /** @type {any} */
  let scale;
  store.watch(["units"], () => {
    scale?.remove();
    const units = { imperial: inFeet(), metric: !inFeet() };
    scale = L.control.scale({ ...units, maxWidth: 140 }).addTo(map);
  });
}

/** @param {HTMLElement} status @param {string} words */
function tell(status, words) {
  setText(status, words);
  status.hidden = !words;
}

/**
 * Shows the vector map while the selected aircraft has no position.
 * @param {any} map
 * @param {Base} base
 */
function comeToPlace(map, base) {
  if (!currentState()?.position && base.bounds) map.fitBounds(base.bounds);
}

/** @param {any} map @param {Base} base @returns {HTMLElement[]} the map's buttons and layers */
function mapTools(map, base) {
  const all = button("fit", "", () => fitAll(map, base), { label: t("map.all") });
  const nearer = button("", "+", () => map.zoomIn(1), { label: t("map.nearer") });
  const farther = button("", "−", () => map.zoomOut(1), { label: t("map.farther") });
  const swapping = button("swap", "", swap, { label: t("map.swap"), id: "swap" });
  store.watch(["large"], () => {
    document.body.dataset.large = store.get("large");
  });
  const { opener, panel } = buildLayers();
  const tools = [nearer, farther, followButton(map), measureButton(), all, opener, swapping];
  return [element("div", { class: "map-tools" }, ...tools), panel];
}

/** Gives the large place to the map, or to the video again. */
export function swap() {
  store.set({ large: store.get("large") === "map" ? "video" : "map" });
}

/** @param {any} map @returns {HTMLElement} */
function followButton(map) {
  const turn = () => {
    store.set({ follow: !store.get("follow") });
    if (store.get("follow")) centre(map);
  };
  const node = button("follow", "", turn, { label: t("map.follow"), id: "follow" });
  store.watch(["follow"], () => node.setAttribute("aria-pressed", String(store.get("follow"))));
  return node;
}

/** @returns {HTMLElement} */
function measureButton() {
  const turn = () => store.set({ measuring: !store.get("measuring") });
  const node = button("measure", "", turn, { label: t("map.measure"), id: "measure" });
  const pressed = () => node.setAttribute("aria-pressed", String(store.get("measuring")));
  store.watch(["measuring"], pressed);
  return node;
}

/** Shows targets, aircraft and the vector map at once. @param {any} map @param {Base} base */
function fitAll(map, base) {
  const bounds = L.latLngBounds([]);
  for (const { latitude_deg, longitude_deg } of store.get("targets")) {
    bounds.extend([latitude_deg, longitude_deg]);
  }
  for (const state of Object.values(store.get("states"))) {
    if (state.position) bounds.extend(state.position.slice(0, 2));
  }
  if (!bounds.isValid() && base.bounds) bounds.extend(base.bounds);
  store.set({ follow: false });
  if (bounds.isValid()) map.fitBounds(bounds, { padding: [50, 50], maxZoom: 20 });
}

/** Lays the map out again each time its box changes, and shows a target on demand. */
function stayRight(/** @type {any} */ map, /** @type {HTMLElement} */ holder) {
  new ResizeObserver(() => {
    map.invalidateSize({ animate: false });
    if (store.get("follow")) centre(map);
  }).observe(holder);
  store.watch(["shown"], () => {
    const target = targetOf(store.get("shown")?.id ?? null);
    if (!target) return;
    store.set({ follow: false });
    map.setView([target.latitude_deg, target.longitude_deg], Math.max(map.getZoom(), 19));
  });
}
