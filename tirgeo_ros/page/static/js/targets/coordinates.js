// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** A coordinate in its written forms, that of this screen first; a button copies each. */

import { button, element, setText } from "../shell/dom.js";
import { t } from "../shell/language.js";
import { UNKNOWN } from "../shell/words.js";
import { store } from "../store.js";
import { copy } from "./copying.js";

/** The forms, with their words. */
export const FORMS = {
  decimal: t("form.decimal"),
  dms: t("form.dms"),
  mgrs: t("form.mgrs"),
  utm: t("form.utm"),
};
const SAID_MS = 2500;

/**
 * @param {() => Record<string, string>} written  decimal, dms, mgrs, utm
 * @returns {{node: HTMLElement, update: () => void}}
 */
export function coordinateRows(written) {
  const rows = Object.entries(FORMS).map(([form, words]) => ({ form, ...row(form, words) }));
  const node = element("div", { class: "coordinates" }, ...rows.map(({ holder }) => holder));
  const update = () => {
    rows.forEach(({ form, value }) => setText(value, written()[form] || UNKNOWN));
    const first = rows.find(({ form }) => form === store.get("form"));
    if (first && node.firstChild !== first.holder) node.prepend(first.holder);
  };
  return { node, update };
}

/** @param {string} form @param {string} words */
function row(form, words) {
  const value = element("span", { class: "mono value", data: { form } });
  const copier = button("copy", t("copy.copy"), () => copied(), {
    "aria-label": t("copy.label", { form: words }),
  });
  const text = copier.querySelector(".words");
  const copied = async () => {
    setText(text, (await copy(value)) ? t("copy.copied") : t("copy.selected"));
    setTimeout(() => setText(text, t("copy.copy")), SAID_MS);
  };
  const left = element("span", { class: "grow" }, element("small", { text: words }), value);
  return { holder: element("div", { class: "coordinate" }, left, copier), value };
}
