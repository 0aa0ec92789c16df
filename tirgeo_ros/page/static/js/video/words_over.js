/** What stands over a video, from how old it is and what the aircraft says: plain functions. */

import { age, plain } from "../shell/words.js";

const FROZEN_S = 1.5;
const SLOW_MS = 250;
const LATE_MS = 600;

/**
 * @typedef {{tone: "old" | "bad" | "caution" | "still", title: string, detail: string}} Told
 * @typedef {{ageS: number, phase: string, stillS: number | null, state: any}} Seen
 */

/**
 * Returns the gravest thing to say over the picture, or null: the video first, then the map.
 * @param {Seen} seen
 * @returns {Told | null}
 */
export function wordsOver({ ageS, phase, stillS, state }) {
  if (stillS !== null && Number.isFinite(stillS)) {
    const detail = `${stillS.toFixed(0)} s old; press on it as usual`;
    return { tone: "still", title: "STILL PICTURE", detail };
  }
  if (ageS > FROZEN_S) return withoutVideo(ageS, phase);
  if (state?.navigation?.state === "lost") {
    return { tone: "bad", title: "LOST", detail: state.navigation.reason || "no position" };
  }
  if (state?.no_map) return withoutMap(state.no_map);
  if (state?.navigation && !sound(state.navigation)) return poor(state.navigation);
  return null;
}

/** @param {number} ageS @param {string} phase @returns {Told} */
function withoutVideo(ageS, phase) {
  const detail = phase === "open" ? "no new picture comes" : "connection lost, retrying";
  if (Number.isFinite(ageS)) return { tone: "old", title: `FROZEN ${age(ageS)}`, detail };
  const wait = phase === "open" ? "waiting for the first picture" : "connecting";
  return { tone: "old", title: "NO VIDEO", detail: wait };
}

/** @param {string} words  e.g. "no camera info", or "NO MAP: no camera info" @returns {Told} */
function withoutMap(words) {
  const [, title, detail] = words.match(/^(NO MAP[A-Z ]*):?\s*(.*)$/) ?? ["", "NO MAP", words];
  return { tone: "bad", title, detail };
}

/** @param {{state: string}} navigation */
function sound({ state }) {
  return state === "running" || state === "degraded";
}

/** @param {{state: string, reason: string}} navigation @returns {Told} */
function poor({ state, reason }) {
  return { tone: "caution", title: plain(state).toUpperCase(), detail: reason };
}

/** @param {number | null} ms @returns {"good" | "caution" | "bad" | ""} */
export function latencyTone(ms) {
  if (ms === null) return "";
  if (ms < SLOW_MS) return "good";
  return ms < LATE_MS ? "caution" : "bad";
}
