// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** One aircraft's video: canvas, marks, and warnings over the picture. */

import { element, setText } from "../shell/dom.js";
import { store } from "../store.js";
import { VideoFeed } from "./feed.js";
import { listen } from "./gestures.js";
import { Marks } from "./marks.js";
import { PictureView } from "./view.js";
import { latencyTone, wordsOver } from "./words_over.js";

/** @typedef {import("./feed.js").Frame} Frame */

export class Stage {
  /**
   * @param {import("../store.js").Aircraft} aircraft
   * @param {{pressed: (stage: Stage, u: number, v: number, stampNs: string) => void,
   *   beside: () => void}} listeners
   */
  constructor(aircraft, listeners) {
    this.aircraft = aircraft;
    this.listeners = listeners;
    this.view = new PictureView();
    /** @type {Frame | null} */
    this.frame = null; // on the screen
    this.build();
    this.marks = new Marks(this.over, this.view);
    this.feed = new VideoFeed(aircraft.id, (frame) => this.show(frame));
    this.still = false;
    listen(this.over, this.gestures());
    new ResizeObserver(() => this.resize()).observe(this.over);
  }

  build() {
    const name = this.aircraft.name || "the aircraft";
    this.canvas = element("canvas", {});
    this.over = element("div", {
      class: "over",
      tabindex: "0",
      role: "application",
      "aria-label": `Video of ${name}. Press to set a target; arrow keys and Enter do the same.`,
    });
    this.name = element("span", { class: "name", text: this.aircraft.name });
    this.recording = element("span", { class: "rec", text: "REC", hidden: true });
    this.latency = element("span", { class: "latency", title: "from the camera to this screen" });
    this.title = element("strong", {});
    this.detail = element("span", {});
    this.words = element(
      "div",
      { class: "words-over", role: "alert", hidden: true },
      this.title,
      this.detail,
    );
    const chips = element("div", { class: "chips" }, this.name, this.recording, this.latency);
    this.root = element(
      "article",
      { class: "stage", data: { aircraft: this.aircraft.id } },
      this.canvas,
      this.over,
      chips,
      this.words,
    );
    this.context = this.canvas.getContext("2d", { alpha: false });
  }

  /** @returns {import("./gestures.js").Gestures} */
  gestures() {
    return {
      down: () => this.frame?.stampNs ?? null, // of the picture on the screen at that moment
      press: (x, y, stampNs) => this.pressed(x, y, stampNs),
      pan: (dx, dy) => this.changed(() => this.view.panBy(dx, dy)),
      zoom: (factor, x, y) => this.changed(() => this.view.zoomAt(factor, x, y)),
    };
  }

  /** @param {number} x @param {number} y @param {string | null} stampNs */
  pressed(x, y, stampNs) {
    const place = this.view.toPicture(x, y);
    if (place && stampNs) this.listeners.pressed(this, place.u, place.v, stampNs);
    else this.listeners.beside();
  }

  /** @param {() => void} change  of the view */
  changed(change) {
    change();
    this.draw();
    this.marks.layAll();
    this.root.dataset.zoomed = String(this.view.zoom > 1);
  }

  /** @param {number} factor  about the middle */
  zoom(factor) {
    const { width, height } = this.view;
    this.changed(() => this.view.zoomAt(factor, width / 2, height / 2));
  }

  /** @param {Frame} frame */
  show(frame) {
    this.frame?.bitmap.close();
    this.frame = frame;
    this.view.setPicture(frame.width, frame.height);
    this.draw();
  }

  draw() {
    const { context, canvas, frame } = this;
    if (!frame) return;
    const ratio = canvas.width / this.view.width;
    const { left, top, width, height } = this.view.rectangle;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = "#000";
    context.fillRect(0, 0, this.view.width, this.view.height);
    context.drawImage(frame.bitmap, left, top, width, height);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.over;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.changed(() => this.view.setBox(width, height));
  }

  /** Starts or stops the video: a hidden tile takes no bandwidth. @param {boolean} on */
  follow(on) {
    this.root.hidden = !on;
    if (on && !store.get("still")) this.feed.start();
    else this.feed.stop();
  }

  /** @param {boolean} on  keeps the picture that is on the screen */
  hold(on) {
    this.still = on;
    if (this.root.hidden) return;
    if (on) this.feed.stop();
    else this.feed.start();
  }

  /** @returns {number | null | undefined} when the newest picture came; null: none is expected */
  get watched() {
    if (this.still || this.root.hidden || document.hidden) return null;
    return this.feed.arrivedAt || undefined;
  }

  /** Writes over the picture what is wrong with it and how old it is; called every 200 ms. */
  tell() {
    const state = store.get("states")[this.aircraft.id] ?? null;
    const stillS = this.still ? this.feed.ageS : null;
    const why = store.get("verdicts")[this.aircraft.id]?.text ?? "";
    const warning = wordsOver({ ageS: this.feed.ageS, stillS, why });
    this.root.dataset.tone = warning?.tone ?? "good";
    this.words.hidden = !warning;
    setText(this.title, warning?.title ?? "");
    setText(this.detail, warning?.detail ?? "");
    this.recording.hidden = !state?.recording;
    this.tellLatency(state);
  }

  /** @param {any} state */
  tellLatency(state) {
    const ms = this.still || this.feed.ageS > 1 ? null : (state?.latency_ms ?? null);
    this.latency.hidden = this.still || this.feed.ageS > 1;
    this.latency.dataset.tone = latencyTone(ms);
    const rate = `${this.feed.hz.toFixed(0)} Hz`;
    setText(this.latency, ms === null ? rate : `${ms.toFixed(0)} ms · ${rate}`);
  }
}
