// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The list of targets. */

import { button, byId, element, icon } from "../shell/dom.js";
import { Kept } from "../shell/kept.js";
import { called, clock, ellipse } from "../shell/words.js";
import { mayChange, store } from "../store.js";
import { draftOf, undo } from "./changes.js";
import { badge } from "./symbols.js";

const FORMATS = [
  ["geojson", "GeoJSON"],
  ["kml", "KML"],
  ["gpx", "GPX"],
  ["csv", "CSV"],
  ["gpkg", "GeoPackage"],
];

/** @typedef {import("../store.js").Target} Target */

const keptRows = new Kept(row, (/** @type {HTMLElement} */ gone) => gone.remove());

/** Builds the list, and updates it with the store. */
export function buildList() {
  const count = element("h2", {});
  const exports = exportRow();
  const rows = element("ol", { class: "rows" });
  const undoing = button("undo", "Undo", undo, { class: "operator-only", id: "undo" });
  const exporting = button(
    "export",
    "Export",
    () => {
      exports.hidden = !exports.hidden;
    },
    { id: "export" },
  );
  const head = element("header", { class: "list-head" }, count, undoing, exporting);
  const holder = element("div", { id: "target-list" }, head, exports, rows);
  byId("targets").append(holder);
  store.watch(["targets", "drafts", "role"], () => show(count, rows));
  store.watch(["selected"], () => {
    holder.hidden = store.get("selected") !== null;
  });
}

/** @returns {HTMLElement} links that download all targets */
function exportRow() {
  const links = FORMATS.map(([format, words]) =>
    element("a", {
      class: "button",
      text: words,
      href: `/export/${format}`,
      download: `targets.${format}`,
    }),
  );
  return element("div", { class: "exports", hidden: true }, ...links);
}

/** @param {HTMLElement} count @param {HTMLElement} rows */
function show(count, rows) {
  /** @type {Target[]} */
  const targets = store.get("targets");
  count.textContent = targets.length === 1 ? "1 target" : `${targets.length} targets`;
  const newestFirst = [...targets].reverse().map((one) => ({ ...one, ...draftOf(one.id).fields }));
  const items = keptRows.of(newestFirst);
  rows.querySelector(".nothing")?.remove();
  (items.length ? items : [nothing()]).forEach((item, place) => {
    if (rows.children[place] !== item) rows.insertBefore(item, rows.children[place] ?? null);
  });
}

/** @returns {HTMLElement} */
function nothing() {
  const how = mayChange()
    ? "Choose a kind, then press on the video where the target is."
    : "Targets that operators set appear here.";
  return element("li", { class: "nothing" }, icon("other"), element("p", { text: how }));
}

/** @param {Target} target  with what was typed and is not confirmed @returns {HTMLElement} */
function row(target) {
  const top = element(
    "span",
    { class: "row-top" },
    element("strong", { text: called(target) }),
    element("time", { text: clock(target.created_ns) }),
  );
  const place = element("span", { class: "mono", text: target.coordinates.decimal });
  const middle = element(
    "span",
    { class: "grow" },
    top,
    element(
      "span",
      { class: "row-below" },
      place,
      element("span", { class: "accuracy", text: `95 %: ${ellipse(target.ellipse)}` }),
      target.alternatives.length ? element("span", { class: "said", text: "choose a text" }) : null,
    ),
  );
  const open = () => store.set({ selected: target.id });
  return element(
    "li",
    {},
    element(
      "button",
      { type: "button", class: "row", on: { click: open }, data: { target: target.id } },
      badge(target),
      middle,
    ),
  );
}
