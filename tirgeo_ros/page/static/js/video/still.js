// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The still picture of one aircraft, at full size, and those of the last minutes before it. */

import { t } from "../shell/language.js";
import { store } from "../store.js";
import { frameOf } from "./message.js";

const REFRESH_MS = 10_000;

/** @typedef {import("./message.js").Frame} Frame */

/**
 * @param {string[]} stamps  oldest first
 * @param {bigint} stamp
 * @returns {number} index of the nearest one; -1 of none
 */
export function nearest(stamps, stamp) {
  let best = -1;
  let least = Infinity;
  stamps.forEach((one, index) => {
    const away = Math.abs(Number(BigInt(one) - stamp));
    if (away < least) [best, least] = [index, away];
  });
  return best;
}

export class Still {
  /**
   * @param {string} aircraft
   * @param {(frame: Frame) => void} show
   */
  constructor(aircraft, show) {
    this.path = encodeURIComponent(aircraft);
    this.show = show;
    this.on = false;
    /** @type {string[]} */
    this.stamps = [];
    this.stampNs = "0"; // of the picture that is shown or fetched
    /** @type {string | null} */
    this.wanted = null;
    this.fetching = false;
    this.words = "";
    this.ready = Promise.resolve(); // when the stamps are known
    this.cut = new AbortController(); // of all that is fetched for this still picture
  }

  /** @param {string} stampNs  of the picture on the screen, which stays until its full size came */
  begin(stampNs) {
    this.on = true;
    this.cut = new AbortController();
    this.stampNs = stampNs;
    this.stamps = [];
    this.want(stampNs);
    this.ready = this.refresh();
    this.timer = setInterval(() => this.refresh(), REFRESH_MS);
  }

  /** Asks again for what a dead connection may never bring. */
  renew() {
    if (!this.on) return;
    this.cut.abort();
    this.cut = new AbortController();
    if (this.fetching) this.want(this.stampNs);
    this.ready = this.refresh();
  }

  end() {
    this.on = false;
    this.wanted = null;
    this.cut.abort(); // a thin link is free for the live video again
    clearInterval(this.timer);
  }

  /** @returns {number} of the picture among `stamps`; -1 while none are known */
  get index() {
    return nearest(this.stamps, BigInt(this.stampNs));
  }

  /** @param {number} frames  forward, or back if negative */
  async step(frames) {
    await this.ready;
    this.go(this.index + frames);
  }

  /** @param {number} seconds  forward, or back if negative */
  async stepSeconds(seconds) {
    await this.ready;
    const to = nearest(this.stamps, BigInt(this.stampNs) + BigInt(Math.round(seconds * 1e9)));
    this.go(to === this.index ? to + Math.sign(seconds) : to); // few pictures a second are kept
  }

  /** @param {number} index */
  go(index) {
    if (!this.on || !this.stamps.length) return;
    const inside = Math.min(Math.max(index, 0), this.stamps.length - 1);
    this.stampNs = this.stamps[inside];
    this.want(this.stampNs);
    if (index > inside) this.refresh();
  }

  /**
   * Fetches the pictures that are wanted one by one; of those that wait the last.
   * @param {string} stampNs
   */
  async want(stampNs) {
    this.wanted = stampNs;
    this.say(t("rewind.fetching"));
    if (this.fetching) return;
    this.fetching = true;
    while (this.wanted) {
      const next = this.wanted;
      this.wanted = null;
      await this.fetch(next);
    }
    this.fetching = false;
  }

  /** @param {string} stampNs */
  async fetch(stampNs) {
    const { signal } = this.cut;
    const words = await this.bring(stampNs, signal);
    if (!signal.aborted && !this.wanted) this.say(words);
  }

  /**
   * Fetches a picture and shows it.
   * @param {string} stampNs @param {AbortSignal} signal
   * @returns {Promise<string>} why it is not shown, or nothing
   */
  async bring(stampNs, signal) {
    const answer = await fetch(`/frame/${this.path}/${stampNs}`, { signal }).catch(() => null);
    if (answer?.status === 404) return t("rewind.gone");
    const data = answer?.ok ? await answer.arrayBuffer().catch(() => null) : null;
    if (!data) return t("rewind.no_connection");
    const frame = await frameOf(data).catch(() => null);
    if (signal.aborted) frame?.bitmap.close();
    else if (frame) this.show(frame);
    return frame ? "" : t("rewind.damaged");
  }

  async refresh() {
    const { signal } = this.cut;
    const answer = await fetch(`/frames/${this.path}`, { signal }).catch(() => null);
    const kept = answer?.ok ? await answer.json().catch(() => null) : null;
    if (!kept || signal.aborted) return;
    this.stamps = kept.stamps_ns;
    this.say(this.words);
  }

  /** @param {string} words  of the bar */
  say(words) {
    this.words = words;
    store.set({ rewound: {} }); // another object: a change, for the bar
  }
}
