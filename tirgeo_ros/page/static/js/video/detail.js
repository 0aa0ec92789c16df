// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** How finely the map is drawn: coarser where this screen needs too long for it, and back. */

const LIMIT_MS = 4; // of script for a frame, at p95
const OFTEN_MS = 2; // at the median too: one that waits for other programs alone is not slow
const EASY_MS = 1; // at the median: then a finer level is tried
const FRAMES = 40; // over which the time is judged
const FEW = 1000; // vertices
const EASY_TIMES = 3; // in succession

/** CSS pixels: a vertex nearer than this to the last drawn one is left out. */
const LEVELS_PX = [0, 1, 2, 4];
const COARSEST = LEVELS_PX.length - 1;

export class Detail {
  constructor() {
    this.level = 0;
    this.easy = 0;
    /** @type {number[]} */
    this.times = [];
    this.p95Ms = 0; // of the last frames that were judged
  }

  /** @returns {number} CSS pixels */
  get skipPx() {
    return LEVELS_PX[this.level];
  }

  /**
   * @param {number} ms  that one frame took to decode and to draw
   * @param {number} vertices  in it: leaving some out of a few makes nothing faster
   */
  took(ms, vertices) {
    if (vertices < FEW && !this.level) return;
    this.times.push(ms);
    if (this.times.length < FRAMES) return;
    const sorted = this.times.sort((one, other) => one - other);
    this.times = [];
    this.judge(sorted[FRAMES / 2], sorted[Math.ceil(FRAMES * 0.95) - 1]);
  }

  /** @param {number} median @param {number} p95  ms */
  judge(median, p95) {
    this.p95Ms = p95;
    this.easy = median < EASY_MS ? this.easy + 1 : 0;
    if (p95 > LIMIT_MS && median > OFTEN_MS) this.level = Math.min(this.level + 1, COARSEST);
    if (this.easy < EASY_TIMES) return;
    this.easy = 0;
    this.level = Math.max(this.level - 1, 0);
  }
}
