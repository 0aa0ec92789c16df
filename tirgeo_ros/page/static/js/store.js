// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/**
 * The state of the page: one store, which every module reads and listens to.
 *
 * @typedef {"connecting" | "open" | "lost" | "refused"} LinkPhase
 * @typedef {{phase: LinkPhase, retryAt: number}} Link  retryAt: performance.now() of the next try
 * @typedef {{id: string, name: string}} Aircraft
 * @typedef {{major_m: number, minor_m: number, azimuth_deg: number}} Ellipse
 *
 * @typedef {object} Target
 * @property {string} id
 * @property {number} number
 * @property {string} name
 * @property {string} kind
 * @property {string} status
 * @property {string} note
 * @property {["name" | "kind" | "note" | "status", string][]} alternatives  field and text: to choose from
 * @property {string} aircraft
 * @property {string} created_ns
 * @property {number} latitude_deg
 * @property {number} longitude_deg
 * @property {{decimal: string, dms: string, mgrs: string, utm: string}} coordinates
 * @property {number} height_m  above the ellipsoid
 * @property {number | null} height_msl_m
 * @property {Ellipse} ellipse  95 %
 * @property {number[][]} outline  of the ellipse, [[latitude, longitude], ...]
 * @property {number} clicks
 * @property {boolean} clicks_agree
 */

import { PLAIN } from "./video/look_values.js";

/** Holds values by name and tells listeners of changes. */
export class Store {
  /** @param {Record<string, any>} values */
  constructor(values) {
    this.values = values;
    /** @type {{names: string[], listener: () => void}[]} */
    this.listeners = [];
  }

  /**
   * @param {string} name
   * @returns {any}
   */
  get(name) {
    return this.values[name];
  }

  /**
   * Sets values, then calls each listener of a changed one once.
   * @param {Record<string, any>} changes
   */
  set(changes) {
    const changed = Object.keys(changes).filter((name) => this.values[name] !== changes[name]);
    Object.assign(this.values, changes);
    for (const { names, listener } of this.listeners) {
      if (names.some((name) => changed.includes(name))) listener();
    }
  }

  /**
   * Calls the listener now and after each change of one of the names.
   * @param {string[]} names
   * @param {() => void} listener
   */
  watch(names, listener) {
    this.listeners.push({ names, listener });
    listener();
  }
}

export const store = new Store({
  link: { phase: "connecting", retryAt: 0 },
  role: "viewer",
  /** @type {Aircraft[]} */
  aircraft: [],
  /** @type {string[]} */
  kinds: ["person", "fire", "vehicle", "hydrant", "building", "other"],
  /** @type {Record<string, string>} */
  colours: {}, // of each kind
  statuses: ["new", "checked", "found", "dismissed"],
  filter: { kinds: [], statuses: [] }, // of the list; none: all
  large: "video", // which of video and map has the large place
  /** @type {string[]} */
  layersOff: [], // names of layers of the vector map, in the video as well
  /** @type {string[]} */
  mapOff: [], // the map's own layers that are off
  /** @type {string[]} */
  mapLayers: [], // names of the vector map's layers
  /** @type {{min: number, max: number, attribution: string} | null} */
  tiles: null,
  most: { name: 0, note: 0 }, // characters that the server takes
  current: "", // id of the aircraft that is selected
  states: {}, // newest state message of each aircraft
  /** @type {Record<string, import("./checks/verdict.js").Verdict>} */
  verdicts: {}, // of each aircraft, from all that this page knows
  tracks: {}, // whole track of each aircraft: [[latitude, longitude], ...]
  /** @type {Target[]} */
  targets: [],
  selected: null, // id of the target whose card is open
  refine: null, // id of the target that the next press refines
  kind: "person", // of the next target
  still: false,
  rewound: {}, // another object at each change of the still pictures
  looking: false, // the panel of the picture is open
  look: PLAIN, // of the picture
  /** @type {string[]} */
  labelsOff: [], // of layers whose labels it does not show
  tab: "targets",
  follow: true,
  measuring: false,
  theme: "dark",
  language: "", // "": the browser's
  units: "metres", // or "feet"
  form: "decimal", // of coordinates: decimal, dms, mgrs, utm
  /** @type {string[]} */
  asked: [], // commands that wait for their answer
  sound: true,
  soundAllowed: false, // browsers allow sound after the first press
});

/**
 * Takes a name out of a list of the store, or adds it.
 * @param {"layersOff" | "labelsOff" | "mapOff"} list
 * @param {string} name
 */
export function flip(list, name) {
  /** @type {string[]} */
  const names = store.get(list);
  const others = names.filter((one) => one !== name);
  store.set({ [list]: others.length < names.length ? others : [...names, name] });
}

/** @returns {any} the newest state of the selected aircraft, or null */
export function currentState() {
  return store.get("states")[store.get("current")] ?? null;
}

/** @returns {boolean} whether this role may change anything */
export function mayChange() {
  return store.get("role") === "operator";
}

/**
 * @param {string | null} id
 * @returns {Target | undefined}
 */
export function targetOf(id) {
  return store.get("targets").find((/** @type {Target} */ target) => target.id === id);
}
