// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The numbers of an aircraft's state, with the tone of each: for the bar and for the checks. */

import { t } from "../shell/language.js";
import { bearing, length, plain, quantity, speed } from "../shell/words.js";
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
    words: t("reading.navigation"),
    text: (s) => plain(s.navigation?.state),
    tone: judged.navigationTone,
  },
  rtk: { words: t("reading.rtk"), text: (s) => plain(s.rtk), tone: judged.rtkTone },
  heading_sigma: {
    words: t("reading.heading_sigma"),
    text: (s) => quantity(s.heading_sigma_deg, 2, "°"),
    tone: (s) => judged.headingTone(s.heading_sigma_deg),
  },
  position_sigma: {
    words: t("reading.position_sigma"),
    text: (s) => length(s.position_sigma_m, 2),
    tone: (s) => judged.positionTone(s.position_sigma_m),
  },
  heading: { words: t("reading.heading"), text: (s) => bearing(s.heading_deg) },
  height: { words: t("reading.height"), text: (s) => length(s.above_ground_m, 0) },
  speed: { words: t("reading.speed"), text: (s) => speed(s.speed_m_s) },
  video: { words: t("reading.video"), text: (s) => quantity(s.video_hz, 0, "Hz") },
};
