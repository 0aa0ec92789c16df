// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** What this device remembers: theme, sound, kind, language, units, the picture. Night is red. */

import { store } from "../store.js";

const KEPT = [
  "theme",
  "sound",
  "kind",
  "language",
  "units",
  "form",
  "filter",
  "large",
  "look",
  "layersOff",
  "labelsOff",
  "mapOff",
];
const PLACE = "tirgeo";

/** Loads the kept settings, and keeps each change. */
export function keepSettings() {
  const settings = keptSettings();
  store.set(Object.fromEntries(KEPT.map((name) => [name, like(store.get(name), settings[name])])));
  store.watch(["theme"], () => {
    document.documentElement.dataset.theme = store.get("theme");
  });
  store.watch(KEPT, () => {
    const values = Object.fromEntries(KEPT.map((name) => [name, store.get(name)]));
    try {
      localStorage.setItem(PLACE, JSON.stringify(values));
    } catch {
      // a browser that keeps nothing begins anew each time
    }
  });
}

/**
 * Returns what was kept as far as it has the form of the default, else the default: another version
 * may have kept it.
 * @param {any} usual @param {any} kept @returns {any}
 */
function like(usual, kept) {
  if (Array.isArray(usual)) return Array.isArray(kept) ? kept.map(String) : usual;
  if (typeof usual !== "object") return typeof kept === typeof usual ? kept : usual;
  return Object.fromEntries(Object.keys(usual).map((key) => [key, like(usual[key], kept?.[key])]));
}

/** @returns {Record<string, any>} what was kept, by name */
export function keptSettings() {
  try {
    const saved = JSON.parse(localStorage.getItem(PLACE) ?? "{}");
    return Object.fromEntries(
      KEPT.filter((name) => name in saved).map((name) => [name, saved[name]]),
    );
  } catch {
    return {};
  }
}

/** Changes between dark and red. */
export function changeTheme() {
  store.set({ theme: store.get("theme") === "red" ? "dark" : "red" });
}
