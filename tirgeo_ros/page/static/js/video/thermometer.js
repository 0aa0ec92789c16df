// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The temperature under the finger or the mouse, where the picture has a scale. */

import { element, hideAfter, setText } from "../shell/dom.js";
import { degreesOf } from "./picture.js";

const CLIPPED = 20; // grey values: a JPEG shows a clipped 255 as 235 to 255
const RESTS_MS = 3000; // after the finger has gone
const ABOVE_PX = { mouse: 30, touch: 76 }; // a finger hides what is under it

/** @param {number} grey @param {[number, number]} celsius @returns {string} */
export function degreesWords(grey, celsius) {
  // The picture shows no colder, no hotter.
  const beyond = grey <= CLIPPED ? "≤ " : grey >= 255 - CLIPPED ? "≥ " : "";
  return `${beyond}${degreesOf(grey, celsius).toFixed(1)} °C`;
}

export class Thermometer {
  /**
   * @param {HTMLElement} surface  over the picture
   * @param {import("./view.js").PictureView} view
   * @param {() => void} moved  called when another place is to be read
   */
  constructor(surface, view, moved) {
    this.view = view;
    this.node = element("div", { class: "degrees", hidden: true });
    surface.append(this.node);
    /** @type {{x: number, y: number, above: number} | null} */
    this.at = null;
    const take = (/** @type {PointerEvent} */ event) => {
      const box = surface.getBoundingClientRect();
      const above = event.pointerType === "mouse" ? ABOVE_PX.mouse : ABOVE_PX.touch;
      this.at = { x: event.clientX - box.left, y: event.clientY - box.top, above };
      moved();
    };
    surface.addEventListener("pointermove", take);
    surface.addEventListener("pointerdown", take);
    surface.addEventListener("pointerleave", () => this.left());
  }

  left() {
    this.at = null;
    hideAfter(this.node, RESTS_MS);
  }

  /** @param {import("./message.js").Frame} frame @param {import("./picture.js").Picture} picture */
  show(frame, picture) {
    if (!this.at) return;
    const { x, y, above } = this.at;
    const place = this.view.toPicture(x, y);
    const celsius = frame.shapes?.celsius;
    this.node.hidden = !place || !celsius;
    if (!place || !celsius) return;
    hideAfter(this.node, 20000);
    setText(this.node, degreesWords(picture.greyAt(frame, place.u, place.v), celsius));
    const top = y > above + 12 ? y - above : y + above;
    this.node.style.transform = `translate(${x}px, ${top}px) translate(-50%, -50%)`;
  }
}
