// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** A coordinate in its written forms, each with a button that copies it. */

import { button, element, setText } from "../shell/dom.js";
import { UNKNOWN } from "../shell/words.js";
import { copy } from "./copying.js";

const FORMS = [
  ["decimal", "Latitude, longitude"],
  ["dms", "Degrees, minutes, seconds"],
  ["mgrs", "MGRS"],
  ["utm", "UTM"],
];
const SAID_MS = 2500;

/**
 * @param {() => Record<string, string>} written  decimal, dms, mgrs, utm
 * @returns {{node: HTMLElement, update: () => void}}
 */
export function coordinateRows(written) {
  const rows = FORMS.map(([form, words]) => ({ form, ...row(form, words) }));
  const node = element("div", { class: "coordinates" }, ...rows.map(({ holder }) => holder));
  const update = () =>
    rows.forEach(({ form, value }) => setText(value, written()[form] || UNKNOWN));
  return { node, update };
}

/** @param {string} form @param {string} words */
function row(form, words) {
  const value = element("span", { class: "mono value", data: { form } });
  const copier = button("copy", "Copy", () => copied(), { "aria-label": `Copy ${words}` });
  const text = copier.querySelector(".words");
  const copied = async () => {
    setText(text, (await copy(value)) ? "Copied" : "Selected");
    setTimeout(() => setText(text, "Copy"), SAID_MS);
  };
  const left = element("span", { class: "grow" }, element("small", { text: words }), value);
  return { holder: element("div", { class: "coordinate" }, left, copier), value };
}
