// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The numbers of an aircraft's state, with the tone of each: for the bar and for the checks. */

import { bearing, plain, quantity } from "../shell/words.js";
import * as judged from "./tones.js";

/**
 * @typedef {object} Reading
 * @property {string} words
 * @property {(state: any) => string} text
 * @property {(state: any) => string} [tone]
 */

/** @type {Record<string, Reading>} */
export const READINGS = {
  navigation: {
    words: "Navigation",
    text: (s) => plain(s.navigation?.state),
    tone: judged.navigationTone,
  },
  rtk: { words: "RTK", text: (s) => plain(s.rtk), tone: judged.rtkTone },
  heading_sigma: {
    words: "Heading sigma",
    text: (s) => quantity(s.heading_sigma_deg, 2, "°"),
    tone: (s) => judged.headingTone(s.heading_sigma_deg),
  },
  position_sigma: {
    words: "Position sigma",
    text: (s) => quantity(s.position_sigma_m, 2, "m"),
    tone: (s) => judged.positionTone(s.position_sigma_m),
  },
  heading: { words: "Heading", text: (s) => bearing(s.heading_deg) },
  height: { words: "Above ground", text: (s) => quantity(s.above_ground_m, 0, "m") },
  speed: { words: "Speed", text: (s) => quantity(s.speed_m_s, 1, "m/s") },
  video: { words: "Video", text: (s) => quantity(s.video_hz, 0, "Hz") },
};
