// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The banner, and the sound and vibration while a verdict is an alarm. */

import { button, byId, element, icon, setText } from "../shell/dom.js";
import { t } from "../shell/language.js";
import { store } from "../store.js";
import { aircraftWithVerdicts } from "./verdict.js";

const REPEAT_MS = 4200; // also between two alarms; over 4 s even if a tone begins late
const BEEPS_HZ = [880, 660, 880];
const BEEP_S = 0.16;

/** @typedef {import("./verdict.js").Verdict & {key: string}} Shown  key: kind and aircraft */

/** @type {AudioContext | undefined} */
let audio;
let soundedAt = -REPEAT_MS;
/** @type {Set<string>} keys of alarms that still last and were silenced */
let silenced = new Set();

/** Builds the banner, and updates it with each verdict. */
export function buildAlarm() {
  const words = element("strong", {});
  const hint = element("span", { class: "hint" });
  const more = element("p", {});
  const details = element("details", {}, element("summary", { text: t("alarm.more") }), more);
  const hush = () => {
    silenced = new Set(alarms().map(({ key }) => key));
    update();
  };
  const silence = button("mute", t("alarm.silence"), hush, { label: t("alarm.silence_this") });
  const grow = element("div", { class: "grow" }, words, hint);
  byId("banner").append(icon("warning"), grow, details, silence);
  document.addEventListener("pointerdown", allowSound, { capture: true });
  document.addEventListener("keydown", allowSound, { capture: true });
  const update = () => {
    const sounding = sound();
    const worst = alarms()[0] ?? shown()[0];
    byId("banner").hidden = !worst;
    byId("banner").dataset.tone = worst?.tone ?? "";
    setText(words, worst?.text ?? "");
    setText(more, worst?.more ?? "");
    details.hidden = !worst?.more;
    silence.hidden = !sounding;
    setText(hint, worst?.alarm ? hintOf(sounding) : "");
  };
  store.watch(["verdicts", "sound", "soundAllowed"], update);
  setInterval(update, 500); // repeats the sound
}

/** @returns {Shown[]} verdicts with a text, of all aircraft; a lost connection only once */
function shown() {
  const { verdicts, aircraft } = store.values;
  const all = aircraftWithVerdicts().map(({ id, name }) => {
    const verdict = verdicts[id] ?? { text: "" };
    if (verdict.kind === "link") return { ...verdict, key: "link" };
    const text = aircraft.length > 1 && verdict.text ? `${name}: ${verdict.text}` : verdict.text;
    return { ...verdict, text, key: `${verdict.kind} ${id}` };
  });
  return all.filter((/** @type {Shown} */ { text }) => text);
}

const alarms = () => shown().filter(({ alarm }) => alarm);

/** @param {boolean} sounding */
function hintOf(sounding) {
  if (!store.get("sound")) return t("alarm.off");
  if (!sounding) return t("alarm.silenced");
  return store.get("soundAllowed") ? "" : t("alarm.press");
}

/** Sounds when an alarm begins and again while it lasts. @returns {boolean} whether one sounds */
function sound() {
  const keys = alarms().map(({ key }) => key);
  silenced = new Set(keys.filter((key) => silenced.has(key))); // one that ended may sound again
  if (!store.get("sound") || keys.every((key) => silenced.has(key))) return false;
  if (performance.now() - soundedAt < REPEAT_MS) return true;
  soundedAt = performance.now();
  beep();
  if (store.get("soundAllowed")) navigator.vibrate?.([300, 120, 300]); // not before a press either
  return true;
}

/** Allows sound: browsers require a press before. */
function allowSound() {
  audio ??= new AudioContext();
  wake(audio);
  if (!store.get("soundAllowed")) store.set({ soundAllowed: true });
}

/**
 * Lets sound go on: a tablet whose screen was off has interrupted it.
 * @param {AudioContext} context
 */
function wake(context) {
  if (context.state !== "running") context.resume().catch(() => {}); // at the next press or beep
}

export function beep() {
  if (!audio) return;
  wake(audio);
  if (audio.state !== "running") return;
  BEEPS_HZ.forEach((hz, index) => tone(/** @type {AudioContext} */ (audio), hz, index * 0.22));
}

/** @param {AudioContext} context @param {number} hz @param {number} afterS */
function tone(context, hz, afterS) {
  const from = context.currentTime + afterS;
  const [oscillator, gain] = [context.createOscillator(), context.createGain()];
  oscillator.type = "square";
  oscillator.frequency.value = hz;
  gain.gain.setValueAtTime(0.25, from);
  gain.gain.exponentialRampToValueAtTime(0.001, from + BEEP_S);
  oscillator.connect(gain).connect(context.destination);
  oscillator.start(from);
  oscillator.stop(from + BEEP_S);
}
