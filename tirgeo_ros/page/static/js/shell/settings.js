// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** What this device remembers: theme, sound, kind. The night mode is red. */

import { store } from "../store.js";

const KEPT = ["theme", "sound", "kind"];
const PLACE = "tirgeo";

/** Loads the kept settings, and keeps each change. */
export function keepSettings() {
  store.set(kept());
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

/** @returns {Record<string, any>} */
function kept() {
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
