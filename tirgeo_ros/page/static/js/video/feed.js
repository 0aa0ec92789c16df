// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The video of one aircraft: receives pictures, decodes the newest, and says which was shown. */

import { RetryingSocket } from "../link/retrying_socket.js";

const HEADER_BYTES = 24;

/**
 * @typedef {object} Frame
 * @property {string} stampNs  a 64-bit number, as text
 * @property {number} number
 * @property {number} width  of the full picture; the bitmap may be smaller
 * @property {number} height
 * @property {ImageBitmap} bitmap
 */

/**
 * Reads the 24 bytes before each picture: u64 stamp, u64 sent, u32 number, u16 width, u16 height.
 * @param {ArrayBuffer} data
 */
export function headerOf(data) {
  const view = new DataView(data, 0, HEADER_BYTES);
  return {
    stampNs: view.getBigUint64(0, true).toString(),
    number: view.getUint32(16, true),
    width: view.getUint16(20, true),
    height: view.getUint16(22, true),
  };
}

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
    this.phase = "connecting";
    this.socket.start();
  }

  stop() {
    this.socket.stop();
    this.waiting = undefined;
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
    const header = headerOf(data);
    const jpeg = new Blob([new Uint8Array(data, HEADER_BYTES)], { type: "image/jpeg" });
    try {
      this.drawn({ ...header, bitmap: await createImageBitmap(jpeg) });
    } catch {
      this.confirm(header.number); // a damaged picture: wait for the next one
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
