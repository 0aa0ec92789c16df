// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The moving map: north up, base below, targets and aircraft above. */

import { button, byId, element, setText } from "../shell/dom.js";
import { currentState, store, targetOf } from "../store.js";
import { buildAircraft, centre } from "./aircraft_layer.js";
import { buildBase } from "./base.js";
import L from "./leaflet.js";
import { buildMeasuring } from "./measuring.js";
import { buildTargets } from "./target_layer.js";

const FIRST_ZOOM = 18;

/**
 * @param {(latitude_deg: number, longitude_deg: number) => void} where  shows a place in the video
 */
export function buildMap(where) {
  const holder = element("div", { id: "map", role: "application", "aria-label": "Moving map" });
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
  L.control.scale({ imperial: false, maxWidth: 140 }).addTo(map);
  const measure = buildMeasuring(map, (words) => tell(status, words));
  const vector = buildBase(map, () => comeToPlace(map, vector));
  const pressed = (/** @type {number} */ latitude, /** @type {number} */ longitude) =>
    store.get("measuring") ? measure([latitude, longitude]) : where(latitude, longitude);
  buildTargets(map, (target) => {
    pressed(target.latitude_deg, target.longitude_deg);
    if (!store.get("measuring")) store.set({ selected: target.id, tab: "targets" });
  });
  buildAircraft(map);
  map.on("click", (/** @type {any} */ { latlng }) => pressed(latlng.lat, latlng.wrap().lng));
  map.on("dragstart", () => store.set({ follow: false }));
  byId("map-area").append(mapTools(map, vector));
  stayRight(map, holder);
}

/** @param {HTMLElement} status @param {string} words */
function tell(status, words) {
  setText(status, words);
  status.hidden = !words;
}

/**
 * Shows the vector map while the selected aircraft has no position.
 * @param {any} map
 * @param {any} vector
 */
function comeToPlace(map, vector) {
  if (!currentState()?.position && vector.getLayers().length) map.fitBounds(vector.getBounds());
}

/** @param {any} map @param {any} vector @returns {HTMLElement} the map's buttons */
function mapTools(map, vector) {
  const follow = button(
    "follow",
    "",
    () => {
      store.set({ follow: !store.get("follow") });
      if (store.get("follow")) centre(map);
    },
    { label: "Follow the aircraft", id: "follow" },
  );
  const measuring = button(
    "measure",
    "",
    () => store.set({ measuring: !store.get("measuring") }),
    { label: "Measure distance and bearing", id: "measure" },
  );
  const all = button("fit", "", () => fitAll(map, vector), { label: "Show everything" });
  const nearer = button("", "+", () => map.zoomIn(1), { label: "Zoom in" });
  const farther = button("", "−", () => map.zoomOut(1), { label: "Zoom out" });
  store.watch(["follow", "measuring"], () => {
    follow.setAttribute("aria-pressed", String(store.get("follow")));
    measuring.setAttribute("aria-pressed", String(store.get("measuring")));
  });
  return element("div", { class: "map-tools" }, nearer, farther, follow, measuring, all);
}

/** Shows targets, aircraft and the vector map at once. @param {any} map @param {any} vector */
function fitAll(map, vector) {
  const bounds = L.latLngBounds([]);
  for (const { latitude_deg, longitude_deg } of store.get("targets")) {
    bounds.extend([latitude_deg, longitude_deg]);
  }
  for (const state of Object.values(store.get("states"))) {
    if (state.position) bounds.extend(state.position.slice(0, 2));
  }
  if (!bounds.isValid() && vector.getLayers().length) bounds.extend(vector.getBounds());
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
