// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The words that belong to a frame's map: notices at the top, the status line at the bottom. */

import { element } from "../shell/dom.js";
import { said, t } from "../shell/language.js";
import { inFeet, inUnits } from "../shell/words.js";
import { store } from "../store.js";

const TONES = ["", "caution", "bad"]; // by severity

export class WordsOfMap {
  /** @param {HTMLElement} holder  over the picture */
  constructor(holder) {
    this.notices = element("div", { class: "notices" });
    this.status = element("div", { class: "status-line" });
    this.shown = "";
    holder.append(this.notices, this.status);
  }

  /** @param {import("./shapes.js").Shapes | null} shapes  of the frame that is drawn */
  show(shapes) {
    /** @type {[string, number][]} */
    const off = shapes && isOff(shapes) ? [[t("map.layers_off"), 1]] : [];
    const words = [shapes?.notices ?? [], [...off, ...(shapes?.status ?? [])]];
    const text = JSON.stringify([words, inFeet()]);
    if (text === this.shown) return;
    this.shown = text;
    [this.notices, this.status].forEach((holder, which) => {
      holder.replaceChildren(...words[which].map(line));
      holder.hidden = !words[which].length;
    });
  }
}

/** @param {import("./shapes.js").Shapes} shapes @returns {boolean} whether the operator hides all */
function isOff({ layers }) {
  const { look, layersOff } = store.values;
  const shown = layers.filter(({ name }) => look.opacity && !layersOff.includes(name));
  return layers.length > 0 && shown.length === 0;
}

/** @param {[string, number]} words */
function line([text, severity]) {
  return element("span", {
    text: inUnits(said(text)),
    dir: "auto",
    data: { tone: TONES[severity] ?? "bad" },
  });
}
