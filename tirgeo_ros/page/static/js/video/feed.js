// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The video of one aircraft: receives pictures, decodes the newest, and says which was shown. */

import { RetryingSocket } from "../link/retrying_socket.js";
import { frameOf, headerOf } from "./message.js";

const SILENT_S = 1;

/** @typedef {import("./message.js").Frame} Frame */

export class VideoFeed {
  /**
   * @param {string} aircraft
   * @param {(frame: Frame) => void} show  draws the frame at once
   */
  constructor(aircraft, show) {
    this.show = show;
    this.arrivedAt = 0; // performance.now() of the newest picture; 0: none yet
    this.phase = "connecting";
    this.recent = /** @type {number[]} */ ([]);
    const path = `/video/${encodeURIComponent(aircraft)}`;
    this.socket = new RetryingSocket(path, {
      opened: () => {
        this.phase = "open";
      },
      received: (data) => this.received(data),
      lost: () => {
        this.phase = "lost";
      },
    });
  }

  start() {
    if (!this.socket.wanted) this.phase = "connecting";
    this.socket.start();
  }

  stop() {
    this.socket.stop();
    this.waiting = undefined;
  }

  /** Opens another connection if this one is silent. */
  renew() {
    if (this.ageS > SILENT_S) this.socket.renew();
  }

  /** @param {ArrayBuffer} data */
  received(data) {
    this.waiting = data; // replaces an older one that still waits
    if (!this.decoding) this.decodeNext();
  }

  async decodeNext() {
    const data = this.waiting;
    this.waiting = undefined;
    if (!data) return;
    this.decoding = true;
    await this.decode(data);
    this.decoding = false;
    this.decodeNext();
  }

  /** @param {ArrayBuffer} data */
  async decode(data) {
    try {
      this.drawn(await frameOf(data));
    } catch {
      this.confirm(headerOf(data).number); // a damaged one: wait for the next
    }
  }

  /** @param {Frame} frame */
  drawn(frame) {
    if (!this.socket.wanted) return;
    this.arrivedAt = performance.now();
    this.recent = [...this.recent.filter((at) => at > this.arrivedAt - 2000), this.arrivedAt];
    this.show(frame);
    requestAnimationFrame(() => this.confirm(frame.number)); // on the screen, not only drawn
  }

  /** @param {number} number */
  confirm(number) {
    if (this.socket.open) this.socket.send(`shown ${number}`);
  }

  /** @returns {number} seconds since the newest picture; Infinity before the first */
  get ageS() {
    return this.arrivedAt ? (performance.now() - this.arrivedAt) / 1000 : Infinity;
  }

  /** @returns {number} pictures a second, over two seconds */
  get hz() {
    const now = performance.now();
    return this.recent.filter((at) => at > now - 2000).length / 2;
  }
}
