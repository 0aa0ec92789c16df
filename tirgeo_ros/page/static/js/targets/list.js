// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The list of targets. */

import { button, byId, element, icon } from "../shell/dom.js";
import { Kept } from "../shell/kept.js";
import { said, t } from "../shell/language.js";
import { called, clock, coordinate, ellipse } from "../shell/words.js";
import { mayChange, store } from "../store.js";
import { draftOf, undo } from "./changes.js";
import { buildFilter, filtered, isFiltering, showAll } from "./filter.js";
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
  const undoing = button("undo", t("shell.undo"), undo, { class: "operator-only", id: "undo" });
  const exporting = button(
    "export",
    t("list.export"),
    () => {
      exports.hidden = !exports.hidden;
    },
    { id: "export" },
  );
  const { opener, chips } = buildFilter();
  const head = element("header", { class: "list-head" }, count, undoing, opener, exporting);
  const holder = element("div", { id: "target-list" }, head, exports, chips, rows);
  byId("targets").append(holder);
  store.watch(["targets", "filter", "drafts", "role", "units", "form"], () => show(count, rows));
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
  const { units, form } = store.values; // a row is made again when these change
  const newestFirst = [...targets]
    .reverse()
    .map((one) => ({ ...one, ...draftOf(one.id).fields, units, form }));
  const shown = filtered(newestFirst);
  count.textContent = countWords(shown.length, targets.length);
  const items = keptRows.of(shown);
  rows.querySelector(".nothing")?.remove();
  (items.length ? items : [nothing(targets.length)]).forEach((item, place) => {
    if (rows.children[place] !== item) rows.insertBefore(item, rows.children[place] ?? null);
  });
}

/** @param {number} shown @param {number} all @returns {string} */
function countWords(shown, all) {
  if (isFiltering()) return t("list.some", { count: shown, all });
  return all === 1 ? t("list.one") : t("list.count", { count: all });
}

/** @param {number} hidden  targets that the filter hides @returns {HTMLElement} why none is here */
function nothing(hidden) {
  const how = mayChange() ? t("list.how") : t("list.how_viewer");
  const why = hidden ? t("list.hidden", { count: hidden }) : how;
  return element(
    "li",
    { class: "nothing" },
    icon("other"),
    element("p", { text: why }),
    hidden ? button("", t("filter.all"), showAll) : null,
  );
}

/** @param {Target} target  with what was typed and is not confirmed @returns {HTMLElement} */
function row(target) {
  const top = element(
    "span",
    { class: "row-top" },
    element("strong", { text: called(target), dir: "auto" }),
    element("time", { text: clock(target.created_ns) }),
  );
  const place = element("span", { class: "mono", text: coordinate(target.coordinates) });
  const middle = element(
    "span",
    { class: "grow" },
    top,
    element(
      "span",
      { class: "row-below" },
      place,
      target.status === "new"
        ? null
        : element("span", { class: "status", text: said(target.status) }),
      element("span", {
        class: "accuracy",
        text: t("words.ellipse", { ellipse: ellipse(target.ellipse) }),
      }),
      target.alternatives.length
        ? element("span", { class: "said", text: t("list.choose") })
        : null,
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
