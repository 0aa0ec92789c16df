// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Marks over the video: the cross of a press with its answer, and the ring at a map's place. */

import { element, hideAfter, setText } from "../shell/dom.js";

const ANSWER_MS = 4000;
const REFUSAL_MS = 9000;
const RING_MS = 1200; // where.js sets it again before

/** @typedef {import("./view.js").PictureView} PictureView */

export class Marks {
  /**
   * @param {HTMLElement} holder  over the picture, of its box's size
   * @param {PictureView} view
   */
  constructor(holder, view) {
    this.view = view;
    this.cross = element("div", { class: "cross", hidden: true });
    this.ring = element("div", { class: "ring", hidden: true });
    this.cursor = element("div", { class: "cursor", hidden: true });
    this.answer = element("div", { class: "answer", role: "status", hidden: true });
    holder.append(this.cross, this.ring, this.cursor, this.answer);
    this.holder = holder;
    /** @type {Map<HTMLElement, {u: number, v: number}>} */
    this.places = new Map();
  }

  /** @param {number} u @param {number} v  shows that the press was taken */
  locating(u, v) {
    this.put(this.cross, u, v);
    this.say(u, v, "Locating…", "wait");
  }

  /** @param {number} u @param {number} v @param {string} words */
  located(u, v, words) {
    this.say(u, v, words, "good");
    hideAfter(this.answer, ANSWER_MS);
    hideAfter(this.cross, ANSWER_MS);
  }

  /** @param {number} u @param {number} v @param {string} reason */
  refused(u, v, reason) {
    this.put(this.cross, u, v);
    this.say(u, v, reason, "bad");
    hideAfter(this.answer, REFUSAL_MS);
    hideAfter(this.cross, REFUSAL_MS);
  }

  /** @param {number} u @param {number} v  where a place of the map is */
  point(u, v) {
    this.put(this.ring, u, v);
    hideAfter(this.ring, RING_MS);
  }

  /** @param {number} u @param {number} v @param {string} words @param {string} tone */
  say(u, v, words, tone) {
    this.answer.dataset.tone = tone;
    setText(this.answer, words);
    this.put(this.answer, u, v);
  }

  /** @param {HTMLElement} mark @param {number} u @param {number} v */
  put(mark, u, v) {
    mark.hidden = false;
    hideAfter(mark, 20000); // the answer, which always comes, sets a shorter time
    this.places.set(mark, { u, v });
    this.lay(mark);
  }

  /** Places all marks again after a zoom, a pan or a new size of the window. */
  layAll() {
    for (const mark of this.places.keys()) this.lay(mark);
  }

  /** @param {HTMLElement} mark */
  lay(mark) {
    const place = this.places.get(mark);
    if (!place || mark.hidden) return;
    const { x, y } = this.view.toScreen(place.u, place.v);
    if (mark !== this.answer) mark.style.transform = `translate(${x}px, ${y}px)`;
    else this.layAnswer(x, y);
  }

  /**
   * Places the words beside the cross, wholly inside the video.
   * @param {number} x
   * @param {number} y
   */
  layAnswer(x, y) {
    const { clientWidth: width, clientHeight: height } = this.holder;
    const { offsetWidth: wide, offsetHeight: high } = this.answer;
    const left = Math.min(Math.max(x - wide / 2, 8), Math.max(width - wide - 8, 8));
    const below = y + 30;
    const top = below + high + 8 <= height ? below : Math.max(y - 30 - high, 8);
    this.answer.style.transform = `translate(${left}px, ${top}px)`;
  }
}
