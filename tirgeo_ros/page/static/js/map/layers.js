// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Which of the map's layers are drawn: the panel with their switches; remembered. */

import { button, element } from "../shell/dom.js";
import { t } from "../shell/language.js";
import { flip, store } from "../store.js";

/** The map's own layers; those of the vector map have the names of its file. */
const OWN = {
  targets: t("layers.targets"),
  labels: t("layers.labels"),
  track: t("layers.track"),
  footprint: t("layers.footprint"),
  tiles: t("layers.tiles"),
};

/** @typedef {"mapOff" | "layersOff"} Switches  of the map alone, and of the video as well */

/** @param {keyof typeof OWN} layer @returns {boolean} */
export function isOff(layer) {
  return store.get("mapOff").includes(layer);
}

/** @returns {{opener: HTMLElement, panel: HTMLElement}} */
export function buildLayers() {
  const panel = element("div", {
    class: "map-layers",
    role: "group",
    "aria-label": t("layers.open"),
    hidden: true,
  });
  const turn = () => {
    panel.hidden = !panel.hidden;
    opener.setAttribute("aria-expanded", String(!panel.hidden));
    if (panel.hidden) opener.focus();
  };
  const own = { label: t("layers.open"), id: "layers", "aria-expanded": "false" };
  const opener = button("layers", "", turn, own);
  const close = button("close", "", turn, { label: t("shell.close"), class: "plain" });
  store.watch(["mapLayers", "mapOff", "layersOff", "tiles"], () => {
    panel.replaceChildren(close, ...ownSwitches(), ...layerSwitches());
    const somethingOff = panel.querySelector("[aria-checked=false]"); // not of another map
    opener.classList.toggle("active", somethingOff !== null);
  });
  return { opener, panel };
}

/** @returns {HTMLElement[]} */
function ownSwitches() {
  return Object.entries(OWN)
    .filter(([layer]) => layer !== "tiles" || store.get("tiles"))
    .map(([layer, words]) => switchOf("mapOff", layer, words));
}

/** @returns {HTMLElement[]} */
function layerSwitches() {
  return store
    .get("mapLayers")
    .map((/** @type {string} */ name) => switchOf("layersOff", name, name || t("layers.map")));
}

/** @param {Switches} switches @param {string} layer @param {string} words @returns {HTMLElement} */
function switchOf(switches, layer, words) {
  const off = store.get(switches).includes(layer);
  const own = { role: "switch", "aria-checked": String(!off), dir: "auto", data: { layer } };
  return button(off ? "" : "tick", words, () => press(switches, layer), own);
}

/** @param {Switches} switches @param {string} layer  switches it on or off, and keeps the focus */
function press(switches, layer) {
  flip(switches, layer);
  const again = [...document.querySelectorAll(".map-layers button")];
  /** @type {HTMLElement | undefined} */ (
    again.find((one) => /** @type {HTMLElement} */ (one).dataset.layer === layer)
  )?.focus();
}
