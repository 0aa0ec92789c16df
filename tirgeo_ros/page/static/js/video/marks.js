// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Marks over the video: the cross of a press with its answer, and the ring at a map's place. */

import { byId, element, hideAfter, setText } from "../shell/dom.js";
import { t } from "../shell/language.js";

const ANSWER_MS = 4000;
const REFUSAL_MS = 9000;
const OFFER_MS = 9000;
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
    this.followed = ""; // id of the target that the last press set
    this.found = false; // in a frame since
    /** @type {Map<HTMLElement, {u: number, v: number}>} */
    this.places = new Map();
  }

  /** @param {number} u @param {number} v  shows that the press was taken */
  locating(u, v) {
    this.followed = "";
    this.put(this.cross, u, v);
    this.say(u, v, t("press.locating"), "wait");
  }

  /** @param {number} u @param {number} v @param {string} words @param {string} target  its id */
  located(u, v, words, target) {
    this.say(u, v, words, "good");
    Object.assign(this, { followed: target, found: false });
    hideAfter(this.answer, ANSWER_MS);
    hideAfter(this.cross, ANSWER_MS);
  }

  /** @param {HTMLElement} button  to press beside the words of `located`, which stay longer */
  offer(button) {
    button.addEventListener("pointerdown", (event) => event.stopPropagation()); // no press there
    button.addEventListener("click", () => {
      this.answer.hidden = true;
    });
    this.answer.append(button);
    this.lay(this.answer);
    hideAfter(this.answer, OFFER_MS);
    hideAfter(this.cross, OFFER_MS);
  }

  /**
   * Moves the cross with the ground: to where a newer frame has the target that was set. Where a
   * frame has it no longer, there is no cross: it would be on other ground.
   * @param {import("./shapes.js").TargetMark[]} targets  of the frame that is drawn
   */
  follow(targets) {
    if (!this.followed) return;
    const mark = targets.find(([id]) => id === this.followed);
    if (mark) this.moveTo(mark);
    else if (this.found) this.cross.hidden = true;
  }

  /** @param {import("./shapes.js").TargetMark} mark */
  moveTo(mark) {
    this.found = true;
    const offered = this.answer.querySelector("button"); // stays where the finger aims
    for (const node of offered ? [this.cross] : [this.cross, this.answer]) {
      if (node.hidden) continue;
      this.places.set(node, { u: mark[2], v: mark[3] });
      this.lay(node);
    }
  }

  /** @param {number} u @param {number} v @param {string} reason */
  refused(u, v, reason) {
    this.followed = "";
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
   * Places the words beside the cross, wholly inside what is seen of the video.
   * @param {number} x
   * @param {number} y
   */
  layAnswer(x, y) {
    const { clientWidth: width } = this.holder;
    const height = this.holder.clientHeight - this.underBar();
    const { offsetWidth: wide, offsetHeight: high } = this.answer;
    const left = Math.min(Math.max(x - wide / 2, 8), Math.max(width - wide - 8, 8));
    const [below, lowest] = [y + 30, height - high - 8];
    const top = below <= lowest ? below : Math.max(Math.min(y - 30 - high, lowest), 8);
    this.answer.style.transform = `translate(${left}px, ${top}px)`;
  }

  /** @returns {number} pixels at the foot of the video under a still picture's bar or the banner */
  underBar() {
    const { top, right, bottom } = this.holder.getBoundingClientRect();
    const bars = ["rewind", "banner"].map((id) => byId(id).getBoundingClientRect());
    // A wide banner is above the video, that of a phone on its side beside it.
    const over = bars.filter((bar) => bar.height && bar.top > top && bar.left < right);
    return Math.max(bottom - Math.min(bottom, ...over.map((bar) => bar.top)), 0);
  }
}
