// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Distance and bearing between two places; the server computes them on the ellipsoid. */

import { ask } from "../link/state_link.js";
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

  store.watch(["measuring"], () => {
    places = [];
    drawn.clearLayers();
    say(store.get("measuring") ? "Press the first place" : "");
  });

  return async (place) => {
    if (places.length === 2) {
      places = [];
      drawn.clearLayers();
    }
    places.push(place);
    drawn.addLayer(L.circleMarker(place, { ...lineStyle("measure"), dashArray: null, radius: 6 }));
    if (places.length === 1) return say("Press the second place");
    drawn.addLayer(L.polyline(places, lineStyle("measure")));
    return say(await measured(places[0], places[1]));
  };
}

/**
 * @param {[number, number]} from  latitude, longitude
 * @param {[number, number]} to
 * @returns {Promise<string>} e.g. "123 m at 045°"
 */
async function measured(from, to) {
  const answer = await ask("measure", { from, to });
  if (answer.ok) return `${distance(answer.distance_m)} at ${bearing(answer.bearing_deg)}`;
  toast(`Not measured: ${answer.reason}`, { tone: "bad" });
  return "Press the first place";
}
