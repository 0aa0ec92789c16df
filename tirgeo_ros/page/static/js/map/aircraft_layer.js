// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The aircraft on the map: where each is and was, its heading, what its camera sees. */

import { icon } from "../shell/dom.js";
import { store } from "../store.js";
import { lineStyle } from "./colours.js";
import { isOff } from "./layers.js";
import L from "./leaflet.js";

const FREE_SHARE = 0.2;

/** One aircraft's layers. */
class Shown {
  /** @param {any} map @param {string} name */
  constructor(map, name) {
    this.track = L.polyline([], lineStyle("track")).addTo(map);
    this.footprint = L.polygon([], lineStyle("footprint")).addTo(map);
    this.symbol = icon("aircraft");
    const symbol = L.divIcon({ className: "map-aircraft", html: this.symbol, iconSize: [40, 40] });
    this.marker = L.marker([0, 0], {
      icon: symbol,
      interactive: false,
      keyboard: false,
      zIndexOffset: 1000,
      alt: name,
    });
    this.map = map;
    this.points = 0;
  }

  /** @param {any} state @param {number[][]} track @param {boolean} isCurrent */
  update(state, track, isCurrent) {
    if (state.position) this.marker.setLatLng(state.position.slice(0, 2)).addTo(this.map);
    else this.marker.remove();
    this.symbol.style.transform = `rotate(${state.heading_deg ?? 0}deg)`;
    this.symbol.classList.toggle("without-heading", state.heading_deg === null);
    this.symbol.classList.toggle("other", !isCurrent);
    this.footprint.setLatLngs(isOff("footprint") ? [] : (state.footprint ?? []));
    const points = isOff("track") ? [] : track;
    if (points.length !== this.points) this.track.setLatLngs(points);
    this.points = points.length;
  }

  remove() {
    for (const layer of [this.track, this.footprint, this.marker]) layer.remove();
  }

  recolour() {
    this.track.setStyle(lineStyle("track"));
    this.footprint.setStyle(lineStyle("footprint"));
  }
}

/** @param {any} map */
export function buildAircraft(map) {
  /** @type {Map<string, Shown>} */
  const shown = new Map();
  store.watch(["aircraft", "states", "current", "tracks", "mapOff"], () => {
    const { aircraft, states, tracks, current, follow, measuring } = store.values;
    const there = aircraft.map((/** @type {import("../store.js").Aircraft} */ { id }) => id);
    for (const [id, one] of shown) {
      if (there.includes(id)) continue; // else a server that was started again has it no more
      one.remove();
      shown.delete(id);
    }
    for (const { id, name } of aircraft) {
      shown.get(id)?.symbol.classList.toggle("stale", !states[id]);
      if (!states[id]) continue;
      if (!shown.has(id)) shown.set(id, new Shown(map, name));
      shown.get(id)?.update(states[id], tracks[id] ?? [], id === current);
    }
    if (follow && !measuring) centre(map, FREE_SHARE); // no press is beside where it was aimed
  });
  store.watch(["theme"], () => shown.forEach((one) => one.recolour()));
}

/**
 * Puts the selected aircraft in the middle.
 * @param {any} map
 * @param {number} allowed  share of the map by which it may be off, so that the map seldom moves
 */
export function centre(map, allowed = 0) {
  const place = store.get("states")[store.get("current")]?.position?.slice(0, 2);
  const size = map.getSize();
  if (!place || !size.x) return;
  const off = map.latLngToContainerPoint(place).distanceTo(size.divideBy(2));
  if (off > allowed * Math.min(size.x, size.y)) map.panTo(place, { animate: off < size.x });
}
