// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The targets on the map, with their 95 % ellipses; those too near each other are one number. */

import { element } from "../shell/dom.js";
import { Kept } from "../shell/kept.js";
import { t } from "../shell/language.js";
import { called } from "../shell/words.js";
import { store } from "../store.js";
import { badge, coloured } from "../targets/symbols.js";
import { clustersOf, NEAREST_ZOOM } from "./clusters.js";
import { lineStyle } from "./colours.js";
import { viewOf } from "./labels.js";
import { isOff } from "./layers.js";
import L from "./leaflet.js";
import { meet } from "./shapes.js";

/**
 * @typedef {import("../store.js").Target} Target
 * @typedef {import("./clusters.js").Cluster} Cluster
 * @typedef {{id: string, target: Target, chosen: boolean, colour: string, wide: boolean}} Single
 * @typedef {{id: string, count: number, kind: string, first: Target}} Group  id: all of it
 */

const BADGE_PX = 22; // from its middle to its edge
const NAME_PX = 32; // from its middle down to that of its name
const LEAST_PX = 8; // smaller ellipses are under the badge
const BESIDE = 0.2; // share of the view by which what is drawn reaches beyond it
const PIECE = 25; // marks that are made without a pause
const METRES = 40075017 / 256; // in a pixel at zoom 0, on the equator

export class Targets {
  /** @param {any} map @param {(target: Target) => void} pressed */
  constructor(map, pressed) {
    this.map = map;
    this.pressed = pressed;
    /** @type {Cluster[]} */
    this.clusters = [];
    this.zoom = NaN; // for which they are
    this.soon = 0;
    this.kept = new Kept(
      (/** @type {any} */ one) => ("count" in one ? this.group(one) : this.single(one)).addTo(map),
      (layers) => layers.remove(),
    );
    store.watch(["targets", "selected", "theme", "mapOff", "colours"], () => this.regroup());
    map.on("moveend", () => {
      if (map.getZoom() !== this.zoom) this.regroup();
      else this.drawSoon();
    });
  }

  regroup() {
    const { targets, selected } = store.values;
    this.zoom = this.map.getZoom();
    this.clusters = clustersOf(isOff("targets") ? [] : targets, this.zoom, selected);
    this.drawSoon();
  }

  drawSoon() {
    clearTimeout(this.soon);
    this.soon = setTimeout(() => this.draw());
  }

  /** Draws what is in view, and a little beside it; many new marks come in several pieces. */
  draw() {
    const { zoom, box } = viewOf(this.map);
    const [wide, high] = [BESIDE * (box[2] - box[0]), BESIDE * (box[3] - box[1])];
    const larger = [box[0] - wide, box[1] - high, box[2] + wide, box[3] + high];
    const inView = this.clusters.filter(({ x, y }) => meet([x, y, x, y], larger));
    const things = inView.map((one) => thingOf(one, zoom));
    const isThere = (/** @type {{id: string}} */ { id }) => this.kept.entries.has(id);
    const fresh = things.filter((one) => !isThere(one));
    this.kept.of([...things.filter(isThere), ...fresh.slice(0, PIECE)]);
    if (fresh.length > PIECE) this.drawSoon();
  }

  /** @param {Single} single */
  single({ target, chosen, colour, wide }) {
    const mark = marker(target, chosen).on("click", () => this.pressed(target));
    const style = lineStyle("target", colour);
    return L.layerGroup(wide ? [L.polygon(target.outline ?? [], style), mark] : [mark]);
  }

  /** @param {Group} group */
  group(group) {
    const html = coloured(
      element("span", { class: "map-cluster", text: String(group.count) }),
      group.kind,
    );
    const symbol = L.divIcon({ className: "map-target", html, iconSize: [48, 48] });
    const title = t("map.cluster", { count: group.count });
    const options = { icon: symbol, title, alt: title, zIndexOffset: 600 };
    return L.marker(placeOf(group.first), options).on("click", () => this.open(group.first));
  }

  /** Comes so near that the members of a cluster stand apart. @param {Target} first */
  open(first) {
    const cluster = this.clusters.find(({ members }) => members[0].id === first.id);
    const bounds = L.latLngBounds((cluster?.members ?? [first]).map(placeOf));
    const nearer = Math.max(this.map.getBoundsZoom(bounds.pad(0.3)), this.map.getZoom() + 1);
    store.set({ follow: false });
    this.map.setView(bounds.getCenter(), Math.min(nearer, NEAREST_ZOOM));
  }

  /** @returns {import("./labels.js").Source} the names of those that stand alone */
  get names() {
    const inView = (/** @type {import("./labels.js").View} */ { box }) =>
      this.clusters.filter(({ x, y }) => meet([x, y, x, y], box));
    const alone = (/** @type {Cluster} */ { members }) => members.length === 1 && members[0].name;
    return {
      taken: (view) => inView(view).map(({ x, y }) => ({ x, y, radius: BADGE_PX })),
      labels: (view) =>
        inView(view)
          .filter(alone)
          .map(({ members: [{ name: text }], x, y }) => {
            return { text, x, y, below: NAME_PX, look: "of-target" };
          }),
    };
  }
}

/** @param {Cluster} cluster @param {number} zoom @returns {Single | Group} what it is drawn from */
function thingOf({ members }, zoom) {
  const { selected, theme } = store.values;
  const [first] = members;
  const alike = members.every((one) => one.kind === first.kind) ? first.kind : "";
  if (members.length > 1) {
    const id = ["cluster", first.id, members.length, alike, theme].join(" ");
    return { id, count: members.length, kind: alike, first };
  }
  const chosen = first.id === selected;
  const wide = semiAxisPx(first, zoom) >= LEAST_PX;
  const colour = theme === "red" ? "" : alike;
  return { id: [first.id, chosen, wide, theme].join(" "), target: first, chosen, colour, wide };
}

/** @param {Target} target @param {number} zoom @returns {number} of its ellipse */
function semiAxisPx({ ellipse, latitude_deg }, zoom) {
  return (ellipse.major_m * 2 ** zoom) / (METRES * Math.cos((latitude_deg * Math.PI) / 180));
}

/** @param {Target} target @returns {[number, number]} */
function placeOf({ latitude_deg, longitude_deg }) {
  return [latitude_deg, longitude_deg];
}

/** @param {Target} target @param {boolean} chosen */
function marker(target, chosen) {
  const html = badge(target);
  html.classList.toggle("selected", chosen);
  const size = { iconSize: [48, 48], iconAnchor: [24, 24] };
  const symbol = L.divIcon({ className: "map-target", html, ...size });
  const title = `${target.number} ${called(target)}`;
  return L.marker(placeOf(target), { icon: symbol, title, alt: title, zIndexOffset: 500 });
}
