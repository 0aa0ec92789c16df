/** The banner, and the sound and vibration on `lost`, `NO MAP` and a lost connection. */

import { button, byId, element, icon, setText } from "../shell/dom.js";
import { store } from "../store.js";
import { alarmOf } from "./verdict.js";

const REPEAT_MS = 4000;
const BEEPS_HZ = [880, 660, 880];
const BEEP_S = 0.16;

/** @type {AudioContext | undefined} */
let audio;
/** The words of the alarm that now sounds; "" while all is well. */
let sounding = "";
let soundedAt = 0;

/** Builds the banner and keeps watch. */
export function buildAlarm() {
  const words = element("strong", {});
  const hint = element("span", { class: "hint" });
  const silence = button("mute", "Silence", () => store.set({ sound: false }));
  byId("banner").append(icon("warning"), element("div", { class: "grow" }, words, hint), silence);
  document.addEventListener("pointerdown", allowSound, { capture: true });
  document.addEventListener("keydown", allowSound, { capture: true });
  const update = () => show(words, hint, silence);
  store.watch(["states", "link", "sound", "soundAllowed", "aircraft"], update);
  setInterval(update, 500); // counts down to the next try, repeats the sound
}

/** @returns {{tone: string, words: string, alarm: boolean} | null} the gravest of all aircraft */
function gravest() {
  const { phase, retryAt } = store.get("link");
  if (phase === "lost") {
    const seconds = Math.max(0, Math.ceil((retryAt - performance.now()) / 1000));
    return {
      tone: "bad",
      alarm: true,
      words: `Connection lost, retrying${seconds ? ` in ${seconds} s` : ""}`,
    };
  }
  const { states, aircraft } = store.values;
  const all = aircraft
    .map((/** @type {import("../store.js").Aircraft} */ { id, name }) => {
      const found = alarmOf(states[id]);
      return found && aircraft.length > 1 ? { ...found, words: `${name}: ${found.words}` } : found;
    })
    .filter(Boolean);
  return all.find((/** @type {any} */ one) => one.alarm) ?? all[0] ?? null;
}

/** @param {HTMLElement} words @param {HTMLElement} hint @param {HTMLElement} silence */
function show(words, hint, silence) {
  const found = gravest();
  const { sound, soundAllowed } = store.values;
  const banner = byId("banner");
  banner.hidden = !found;
  banner.dataset.tone = found?.tone ?? "";
  setText(words, found?.words ?? "");
  silence.hidden = !found?.alarm || !sound;
  setText(hint, found?.alarm ? hintOf(sound, soundAllowed) : "");
  alarm(found?.alarm ? found.words.replace(/ in \d+ s$/, "") : "");
}

/** @param {boolean} sound @param {boolean} allowed */
function hintOf(sound, allowed) {
  if (!sound) return "sound is off";
  return allowed ? "" : "press anywhere for sound";
}

/** Sounds at the beginning of an alarm and again while it lasts. @param {string} words */
function alarm(words) {
  const due = words && (words !== sounding || performance.now() - soundedAt > REPEAT_MS);
  sounding = words;
  if (!due || !store.get("sound")) return;
  soundedAt = performance.now();
  beep();
  if (store.get("soundAllowed")) navigator.vibrate?.([300, 120, 300]); // not before a press either
}

/** Takes the first press as the permission that browsers want. */
function allowSound() {
  audio ??= new AudioContext();
  if (audio.state === "suspended") audio.resume();
  if (!store.get("soundAllowed")) store.set({ soundAllowed: true });
}

export function beep() {
  if (!audio || audio.state !== "running") return;
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
