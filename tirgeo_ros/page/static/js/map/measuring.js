// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Distance and bearing between two places; the server computes them on the ellipsoid. */

import { ask } from "../link/state_link.js";
import { said, t } from "../shell/language.js";
import { toast } from "../shell/toast.js";
import { bearing, distance } from "../shell/words.js";
import { store } from "../store.js";
import { lineStyle } from "./colours.js";
import L from "./leaflet.js";

/**
 * @param {any} map
 * @param {(words: string) => void} say  shows the result, or what to press next; "" clears it
 * @returns {(place: [number, number]) => void} takes a place that was pressed
 */
export function buildMeasuring(map, say) {
  const drawn = L.layerGroup().addTo(map);
  /** @type {[number, number][]} */
  let places = [];
  let result = () => ""; // its words, in the units of this screen

  const begin = () => {
    places = [];
    result = () => "";
    drawn.clearLayers();
  };

  store.watch(["measuring"], () => {
    begin();
    say(store.get("measuring") ? t("measure.first") : "");
  });
  store.watch(["units"], () => result() && say(result()));

  return async (place) => {
    if (places.length === 2) begin();
    places.push(place);
    drawn.addLayer(L.circleMarker(place, { ...lineStyle("measure"), dashArray: null, radius: 6 }));
    if (places.length === 1) return say(t("measure.second"));
    drawn.addLayer(L.polyline(places, lineStyle("measure")));
    const [mine, words] = [places, await measured(places[0], places[1])];
    if (places !== mine) return; // ended meanwhile, or begun anew
    result = words;
    say(result());
  };
}

/**
 * @param {[number, number]} from  latitude, longitude
 * @param {[number, number]} to
 * @returns {Promise<() => string>} e.g. "123 m at 045°"
 */
async function measured(from, to) {
  const answer = await ask("measure", { from, to });
  const at = bearing(answer.bearing_deg);
  if (answer.ok) return () => t("words.at", { size: distance(answer.distance_m), bearing: at });
  toast(t("measure.refused", { reason: said(answer.reason ?? "") }), { tone: "bad" });
  return () => t("measure.first");
}
