// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The verdict on each aircraft: a fault that only this screen sees, else the server's. */

import { said, t } from "../shell/language.js";
import { store } from "../store.js";
import { stageOf } from "../video/stages.js";

/**
 * @typedef {object} Verdict  kind: its subject, the same while its text counts seconds
 * @property {string} word  GO, CAUTION, NO GO, ...
 * @property {import("./tones.js").Tone} tone
 * @property {string} kind
 * @property {string} text  for the operator; empty if the word or the checks say it
 * @property {string} more  for the engineer
 * @property {boolean} alarm
 */

const LOOK_MS = 100;
const NO_VIDEO_MS = 1250; // longer than the server's limits: its fault is nearer the cause
const LONGEST_STEP_MS = 400; // in a longer one this page did not run: messages still wait
const STATE_MS = 1200; // states come at 5 Hz

/** @type {Verdict} */
const UNKNOWN = { word: "NO DATA", tone: "", kind: "", text: "", more: "", alarm: false };
/** @type {Map<string, {value: any, ms: number}>} the newest of each stream, and its age */
const newest = new Map();
let lookedAt = performance.now();

/** Keeps `verdicts` in the store. */
export function watchVerdicts() {
  store.watch(["states", "link", "aircraft"], () => look(0));
  setInterval(() => {
    const now = performance.now();
    look(Math.min(now - lookedAt, LONGEST_STEP_MS));
    lookedAt = now;
  }, LOOK_MS);
}

/** @returns {Verdict} on the selected aircraft */
export function currentVerdict() {
  return store.get("verdicts")[store.get("current")] ?? UNKNOWN;
}

/** @returns {import("../store.js").Aircraft[]} before all are known, a nameless one without link */
export function aircraftWithVerdicts() {
  const { aircraft, link } = store.values;
  return aircraft.length || link.phase !== "lost" ? aircraft : [{ id: "", name: "" }];
}

/** @param {number} stepMs  since the last look */
function look(stepMs) {
  const all = aircraftWithVerdicts().map(({ id }) => [id, verdictOn(id, stepMs)]);
  const verdicts = Object.fromEntries(all);
  if (JSON.stringify(verdicts) !== JSON.stringify(store.get("verdicts"))) store.set({ verdicts });
}

/** @param {string} id @param {number} stepMs @returns {Verdict} the nearest cause first */
function verdictOn(id, stepMs) {
  const { link, states } = store.values;
  const stateMs = silence(`state ${id}`, states[id], stepMs);
  const pictureMs = silence(`picture ${id}`, stageOf(id)?.watched, stepMs);
  if (link.phase === "lost") return withoutLink(retryWords(link.retryAt));
  if (stateMs > STATE_MS) return withoutLink(t("verdict.silent", { seconds: seconds(stateMs) }));
  const state = states[id];
  const verdict = spoken(state?.verdict ?? UNKNOWN);
  if (verdict.tone === "bad" || !state || pictureMs <= NO_VIDEO_MS) return verdict;
  const text = t("verdict.no_picture", { seconds: seconds(pictureMs) });
  const more = `/video: ${stageOf(id)?.feed.phase}`;
  return { word: "NO VIDEO", tone: "bad", kind: "screen", text, more, alarm: true };
}

/** @param {string} key @param {any} value @param {number} stepMs @returns {number} silence, ms */
function silence(key, value, stepMs) {
  const before = newest.get(key);
  const same = before && (value === undefined || value === before.value);
  const now = same ? { value: before.value, ms: before.ms + stepMs } : { value, ms: 0 };
  newest.set(key, now);
  return value === null ? 0 : now.ms;
}

/** @param {string} text @returns {Verdict} */
function withoutLink(text) {
  return { word: "NO DATA", tone: "bad", kind: "link", text, more: "/state", alarm: true };
}

/** @param {number} retryAt */
function retryWords(retryAt) {
  const wait = Math.max(0, Math.ceil((retryAt - performance.now()) / 1000));
  return wait ? t("verdict.lost", { seconds: wait }) : t("verdict.retrying");
}

/** @param {number} ms */
function seconds(ms) {
  return (ms / 1000).toFixed(0);
}

/** @param {Verdict} verdict @returns {Verdict} with its text in this screen's language */
function spoken(verdict) {
  return { ...verdict, text: said(verdict.text) };
}
