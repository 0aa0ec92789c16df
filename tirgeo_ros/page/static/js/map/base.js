// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The lowest layers of the map: the vector map and tiles, if any, and words where there is none. */

import { element, setText } from "../shell/dom.js";
import { said, t } from "../shell/language.js";
import { store } from "../store.js";
import { styleOf } from "./colours.js";
import { viewOf } from "./labels.js";
import { isOff } from "./layers.js";
import L from "./leaflet.js";
import { meet, shapesOf, wholeBox } from "./shapes.js";
import { buildVectorLayer } from "./vector_layer.js";

/** @typedef {import("./shapes.js").Shape} Shape */

const LABELS_FROM_ZOOM = 17;
const LEAST_PX = 30; // what is smaller on the screen gets no label
const AGAIN_MS = 5000; // after a map that did not come

/** The base of the map: what the server gave, and what of it is drawn. */
export class Base {
  /** @param {any} map  Leaflet's @param {() => void} ready  called when the vector map is there */
  constructor(map, ready) {
    this.map = map;
    this.ready = ready;
    this.vector = buildVectorLayer(map);
    /** @type {Shape[]} */
    this.shapes = [];
    /** @type {Shape[]} */
    this.shown = [];
    this.phase = "loading"; // then "there" or "failed"
    this.simplified = "";
    this.taken = { current: "", text: /** @type {string | null} */ (null) }; // whose map it is
    this.tiles = /** @type {any} */ (null);
    this.words = element("small", { class: "map-words", role: "status" });
    map.getContainer().append(this.words);
    store.watch(["link", "current"], () => this.load());
    store.watch(["theme", "layersOff"], () => this.show());
    store.watch(["tiles", "mapOff"], () => this.setTiles());
    store.watch(["targets", "tiles", "mapOff"], () => this.tell());
    map.on("moveend", () => {
      this.setTiles();
      this.tell();
    });
  }

  /** Asks for the vector map of the selected aircraft, once in each connection. */
  async load() {
    const { current, link } = store.values;
    if (link.phase === "lost") this.loadedFor = null; // a server started again may have another
    if (link.phase !== "open" || this.loadedFor === current) return;
    this.loadedFor = current;
    if (this.tilesMissed) this.tiles?.redraw();
    this.tilesMissed = false;
    const before = this.taken.current === current ? this.taken.text : null;
    const answer = await mapOf(current, before);
    if (this.loadedFor !== current) return; // another one was selected meanwhile
    this.phase = answer || before !== null ? "there" : "failed";
    if (!answer) setTimeout(() => this.loadAgain(), AGAIN_MS);
    else if (answer.text !== before) this.take(answer);
    if (answer) this.taken = { current, text: answer.text };
    this.tell();
  }

  loadAgain() {
    this.loadedFor = null;
    this.load();
  }

  /** @param {any} answer */
  take(answer) {
    this.shapes = shapesOf(answer.collection, styleOf);
    this.simplified = answer.collection?.simplified ?? "";
    this.box = wholeBox(this.shapes);
    store.set({ mapLayers: [...new Set(this.shapes.map(({ layer }) => layer))] });
    this.show();
    this.ready();
  }

  /** Draws the layers that are on. */
  show() {
    const off = store.get("layersOff");
    this.shown = this.shapes.filter(({ layer }) => !off.includes(layer));
    this.vector.show(this.shown);
    this.tell();
  }

  /** Adds or removes the tiles of an MBTiles file, below all lines; not before there is a place. */
  setTiles() {
    if (!store.get("tiles") || !this.map._loaded) return;
    this.tiles ??= tileLayer(this.map).on("tileerror", () => {
      this.tilesMissed = true; // they are asked for again in the next connection
    });
    if (isOff("tiles")) this.tiles.remove();
    else this.tiles.addTo(this.map);
  }

  /** Says what is left out, and why the map is empty where it is. */
  tell() {
    const less = this.simplified && t("map.simplified", { what: said(this.simplified) });
    const targetsOff = isOff("targets") && store.get("targets").length;
    const words = [this.whyEmpty(), less, targetsOff ? t("map.targets_off") : ""];
    setText(this.words, words.filter(Boolean).join(" · "));
  }

  /** @returns {string} "" if something of the base is in view */
  whyEmpty() {
    if (this.phase === "loading") return t("map.loading");
    if (this.phase === "failed") return t("map.failed");
    if (store.get("tiles") && !isOff("tiles")) return "";
    if (!this.box) return t("map.none");
    if (!this.shown.length) return t("map.layers_off");
    return meet(this.box, viewOf(this.map).box) ? "" : t("map.elsewhere");
  }

  /** @returns {any} bounds of the vector map, or null without one */
  get bounds() {
    if (!this.box) return null;
    const [left, top, right, bottom] = this.box.map((one) => one * 256);
    const corners = [L.point(left, bottom), L.point(right, top)];
    return L.latLngBounds(corners.map((corner) => this.map.unproject(corner, 8)));
  }

  /** @returns {import("./labels.js").Source} the names of its features, where there is room */
  get names() {
    return { taken: () => [], labels: (view) => labelsOf(this.shown, view) };
  }
}

/**
 * Returns the layer of the tiles; above their largest zoom they are enlarged.
 * @param {any} map
 */
function tileLayer(map) {
  const { max, attribution } = store.get("tiles");
  const { body } = new DOMParser().parseFromString(attribution, "text/html"); // often a link
  map.getContainer().append(element("small", { class: "map-credit", text: body.textContent }));
  const options = { maxNativeZoom: max, maxZoom: 22, className: "tiles" };
  return L.tileLayer("/tiles/{z}/{x}/{y}", options);
}

/**
 * @param {string} aircraft
 * @param {string | null} before  the text that is known, which is not read again
 * @returns {Promise<{text: string, collection: any} | null>} null if it did not come; an aircraft
 *   may have no map
 */
async function mapOf(aircraft, before) {
  try {
    const answer = await fetch(`/map/${encodeURIComponent(aircraft)}`);
    const text = answer.ok ? await answer.text() : "";
    if (!answer.ok && answer.status !== 404) return null;
    return { text, collection: text && text !== before ? JSON.parse(text) : null };
  } catch {
    return null;
  }
}

/**
 * @param {Shape[]} shapes @param {import("./labels.js").View} view
 * @returns {import("./labels.js").Label[]}
 */
function labelsOf(shapes, view) {
  if (view.zoom < LABELS_FROM_ZOOM) return [];
  const off = store.get("labelsOff") ?? [];
  return shapes
    .filter((shape) => shape.name && meet(shape.box, view.box) && isLargeEnough(shape, view.zoom))
    .filter(({ layer }) => !off.includes(layer))
    .map(({ name: text, box }) => {
      return { text, x: (box[0] + box[2]) / 2, y: (box[1] + box[3]) / 2, below: 0, look: "" };
    });
}

/** @param {Shape} shape @param {number} zoom @returns {boolean} for a label; points only if near */
function isLargeEnough({ form, box }, zoom) {
  if (form === "point") return zoom > LABELS_FROM_ZOOM + 1;
  return Math.max(box[2] - box[0], box[3] - box[1]) * 2 ** zoom >= LEAST_PX;
}
