// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The targets on the map, with their 95 % ellipses. */

import { store } from "../store.js";
import { badge } from "../targets/symbols.js";
import { Kept } from "../shell/kept.js";
import { called } from "../shell/words.js";
import { lineStyle } from "./colours.js";
import L from "./leaflet.js";

/**
 * @typedef {import("../store.js").Target} Target
 * @typedef {Target & {theme: string, chosen: boolean}} Shown  all that its layers depend on
 */

/**
 * @param {any} map
 * @param {(target: Target) => void} pressed
 */
export function buildTargets(map, pressed) {
  const kept = new Kept(
    (/** @type {Shown} */ one) => {
      const ellipse = L.polygon(one.outline ?? [], lineStyle("target"));
      return L.layerGroup([ellipse, marker(one).on("click", () => pressed(one))]).addTo(map);
    },
    (layers) => layers.remove(),
  );
  store.watch(["targets", "selected", "theme"], () => {
    const { targets, selected, theme } = store.values;
    kept.of(
      targets.map((/** @type {Target} */ one) => ({ ...one, theme, chosen: one.id === selected })),
    );
  });
}

/** @param {Shown} target */
function marker(target) {
  const html = badge(target);
  html.classList.toggle("selected", target.chosen);
  const symbol = L.divIcon({
    className: "map-target",
    html,
    iconSize: [48, 48],
    iconAnchor: [24, 24],
  });
  const title = `${target.number} ${called(target)}`;
  const place = [target.latitude_deg, target.longitude_deg];
  return L.marker(place, { icon: symbol, title, alt: title, zIndexOffset: 500 });
}
