// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** One aircraft's video: picture with map, marks, and warnings over it. */

import { element, setText } from "../shell/dom.js";
import { t } from "../shell/language.js";
import { store } from "../store.js";
import { VideoFeed } from "./feed.js";
import { FramePainter } from "./frame_painter.js";
import { listen } from "./gestures.js";
import { Marks } from "./marks.js";
import { Still } from "./still.js";
import { Thermometer } from "./thermometer.js";
import { PictureView } from "./view.js";
import { latencyTone, wordsOver } from "./words_over.js";
import { WordsOfMap } from "./words_of_map.js";

/** @typedef {import("./message.js").Frame} Frame */

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
    this.wordsOfMap = new WordsOfMap(this.root);
    this.painter = new FramePainter(this.canvas, this.view);
    this.marks = new Marks(this.over, this.view);
    this.thermometer = new Thermometer(this.over, this.view, () => this.measure());
    this.feed = new VideoFeed(aircraft.id, (frame) => this.showLive(frame));
    this.held = new Still(aircraft.id, (frame) => this.showKept(frame));
    this.liveNs = "0"; // stamp of the newest picture
    this.still = false;
    listen(this.over, this.gestures());
    new ResizeObserver(() => this.resize()).observe(this.over);
  }

  build() {
    this.canvas = element("canvas", {});
    this.over = element("div", {
      class: "over",
      tabindex: "0",
      role: "application",
    });
    this.name = element("span", { class: "name" });
    this.recording = element("span", { class: "rec", text: t("bar.recording"), hidden: true });
    this.latency = element("span", { class: "latency", title: t("video.latency") });
    this.title = element("strong", {});
    this.detail = element("span", {});
    this.words = element(
      "div",
      { class: "words-over", role: "alert", hidden: true },
      this.title,
      this.detail,
    );
    this.chips = element("div", { class: "chips" }, this.name, this.recording, this.latency);
    this.root = element(
      "article",
      { class: "stage", data: { aircraft: this.aircraft.id } },
      this.canvas,
      this.over,
      this.chips,
      this.words,
    );
  }

  /** @param {string} name  that the aircraft has now */
  call(name) {
    setText(this.name, name);
    this.over.setAttribute("aria-label", t("video.label", { name: name || t("video.aircraft") }));
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
  showLive(frame) {
    if (this.kept) return frame.bitmap.close(); // decoded since
    this.liveNs = frame.stampNs;
    this.show(frame);
    if (this.still) this.follow(true); // the first one is kept
  }

  /** @param {Frame} frame  the one on the screen at full size, or of another moment */
  showKept(frame) {
    if (frame.stampNs !== this.frame?.stampNs) this.marks.cross.hidden = true; // on other ground
    this.show(frame);
  }

  /** Draws a frame: its picture, its map and its words at once. @param {Frame} frame */
  show(frame) {
    this.frame?.bitmap.close();
    this.frame = frame;
    this.view.setPicture(frame.width, frame.height);
    this.draw(frame.decodeMs);
    this.marks.follow(frame.shapes?.targets ?? []);
  }

  /** @param {number} decodeMs  that a new frame took */
  draw(decodeMs = 0) {
    if (!this.frame) return;
    this.wordsOfMap.show(this.frame.shapes);
    this.painter.paint(this.frame, decodeMs);
    this.measure();
  }

  measure() {
    if (this.frame) this.thermometer.show(this.frame, this.painter.picture);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.over;
    this.painter.resize(width, height);
    this.changed(() => this.view.setBox(width, height));
  }

  /** Starts or stops the video: a hidden tile takes no bandwidth. @param {boolean} on */
  follow(on) {
    this.root.hidden = !on;
    if (on && !this.kept) this.feed.start();
    else this.feed.stop();
    if (on && this.kept && !this.held.on) this.held.begin(this.kept.stampNs);
  }

  /** Keeps the picture that is on the screen, or goes on. @param {boolean} on */
  hold(on) {
    if (on === this.still) return;
    this.still = on;
    this.held.end();
    if (!this.root.hidden) this.follow(true);
  }

  /** @returns {Frame | null} the one that stays; before the first one none does */
  get kept() {
    return store.get("still") ? this.frame : null;
  }

  /** Asks for pictures over a new connection: the old one may be dead without an error. */
  renew() {
    this.feed.renew();
    this.held.renew();
  }

  /** @returns {number} seconds since the picture on the screen was the newest */
  get ageS() {
    const before = this.frame ? BigInt(this.liveNs) - BigInt(this.frame.stampNs) : 0n;
    return this.feed.ageS + Number(before) / 1e9;
  }

  /** @returns {number | null | undefined} when the newest picture came; null: none is expected */
  get watched() {
    if (this.kept || this.root.hidden || document.hidden) return null;
    return this.feed.arrivedAt || undefined;
  }

  /** Writes over the picture what is wrong with it and how old it is; called every 200 ms. */
  tell() {
    const state = store.get("states")[this.aircraft.id] ?? null;
    const stillS = this.still ? this.ageS : null;
    const why = store.get("verdicts")[this.aircraft.id]?.text ?? "";
    const warning = wordsOver({ ageS: this.ageS, stillS, why });
    this.root.dataset.tone = warning?.tone ?? "good";
    this.words.hidden = !warning;
    setText(this.title, warning?.title ?? "");
    setText(this.detail, warning?.detail ?? "");
    this.recording.hidden = !state?.recording;
    const words = [this.chips, this.wordsOfMap.notices, this.wordsOfMap.status];
    if (this.painter.keepFree(words) && this.still) this.draw(); // a live one comes anyway
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
