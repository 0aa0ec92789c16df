// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The help: for each mode of the page its symbols, and in a sentence what each does. */

import { store } from "../store.js";
import { openDialog } from "./dialog.js";
import { button, element, icon } from "./dom.js";
import { said, t } from "./language.js";

/**
 * The rows of each mode: a symbol (an icon of index.html, a word of the server's or a text), and
 * the key of its words.
 * @type {Record<string, [string, string][]>}
 */
const ROWS = {
  video: [
    ["other", "help.video.press"],
    ["still", "help.video.still"],
    ["look", "help.video.look"],
    ["zoom", "help.video.zoom"],
    ["ms", "help.video.age"],
    ["warning", "help.video.frozen"],
    ["record", "help.video.record"],
    ["mark", "help.video.mark"],
    ["night", "help.video.night"],
  ],
  still: [
    ["still", "help.video.still"],
    ["back", "help.still.picture"],
    ["second-back", "help.still.second"],
    ["live", "help.still.live"],
  ],
  picture: [
    ["look", "help.video.look"],
    ["°C", "help.picture.degrees"],
    [t("look.isotherm"), "help.picture.isotherm"],
    [t("look.local"), "help.picture.local"],
    ["layers", "help.picture.layers"],
  ],
  map: [
    ["where", "help.map.where"],
    ["aircraft", "help.map.aircraft"],
    ["follow", "help.map.follow"],
    ["measure", "help.map.measure"],
    ["fit", "help.map.all"],
    ["layers", "help.map.layers"],
    ["swap", "help.map.swap"],
  ],
  targets: [
    ["other", "help.targets.row"],
    ["95 %", "help.targets.ellipse"],
    ["refine", "help.targets.again"],
    ["merge", "help.targets.merge"],
    ["found", "help.targets.status"],
    ["filter", "help.targets.filter"],
    ["warning", "help.targets.disagree"],
    ["note", "help.targets.choose"],
    ["copy", "help.targets.copy"],
    ["undo", "help.targets.undo"],
    ["share", "help.targets.share"],
    ["export", "help.targets.export"],
  ],
  checks: [
    ["GO", "help.checks.go"],
    ["CAUTION", "help.checks.caution"],
    ["NO GO", "help.checks.no_go"],
    ["WAIT", "help.checks.wait"],
    ["LOST", "help.checks.lost"],
    ["NO DATA", "help.checks.no_data"],
    ["NO VIDEO", "help.checks.no_video"],
    ["good", "help.checks.numbers"],
    ["mute", "help.checks.silence"],
  ],
  keys: [
    [t("keys.numbers"), "help.keys.kind"],
    [t("keys.arrows"), "help.keys.cross"],
    [t("keys.space"), "help.keys.still"],
    [", .", "help.keys.rewind"],
    ["+ −", "help.keys.zoom"],
    ["M", "help.keys.mark"],
    ["R", "help.keys.record"],
    ["N", "help.keys.night"],
    ["S", "help.keys.swap"],
    [t("keys.control_z"), "help.keys.undo"],
    ["?", "help.keys.help"],
    [t("keys.escape"), "help.keys.close"],
  ],
};
const NAMES = {
  video: t("page.video"),
  still: t("tools.still_picture"),
  picture: t("look.title"),
  map: t("page.map"),
  targets: t("tabs.targets"),
  checks: t("checks.title"),
  keys: t("menu.keys"),
};

/** Opens the help, at what the operator sees now. */
export function openHelp() {
  const rows = element("dl", { class: "help-rows" });
  const modes = Object.entries(NAMES).map(([mode, name]) =>
    button("", name, () => show(mode), { data: { mode } }),
  );
  const show = (/** @type {string} */ mode) => {
    rows.replaceChildren(...ROWS[mode].map(row));
    rows.dataset.mode = mode;
    modes.forEach((one) => one.setAttribute("aria-pressed", String(one.dataset.mode === mode)));
  };
  show(modeNow());
  openDialog("help", t("help.title"), element("div", { class: "modes" }, ...modes), rows);
}

/** @returns {string} what the operator sees now */
function modeNow() {
  const { tab, targets, still, looking } = store.values;
  if (looking) return "picture";
  if (still) return "still";
  return tab === "targets" && !targets.length ? "video" : tab;
}

/** @param {[string, string]} row @returns {HTMLElement} */
function row([symbol, key]) {
  const isIcon = document.getElementById(`icon-${symbol}`) !== null;
  const sign = isIcon ? icon(symbol) : element("b", { text: said(symbol) });
  return element("div", {}, element("dt", {}, sign), element("dd", { text: t(key) }));
}
