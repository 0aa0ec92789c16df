// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The bar at the top: go or no go, the big numbers, record, mark, share, night, menu. */

import { READINGS } from "../checks/readings.js";
import { currentVerdict } from "../checks/verdict.js";
import { currentState, store } from "../store.js";
import { mark, record, share, sharingWords } from "./commands.js";
import { button, byId, element, setIcon, setText } from "./dom.js";
import { openHelp } from "./help.js";
import { said, t } from "./language.js";
import { openMenu } from "./menu.js";
import { changeTheme } from "./settings.js";

const SHOWN = ["rtk", "heading_sigma", "height", "heading", "speed"].map((name) => READINGS[name]);

/** Builds the bar, and updates it with the store. */
export function buildBar() {
  byId("stages").before(aircraftSwitch());
  byId("bar").append(
    verdictButton(),
    readings(),
    role(),
    recordButton(),
    button("mark", t("bar.mark"), mark, {
      id: "mark",
      class: "operator-only wide-only",
      label: t("bar.mark_moment"),
    }),
    shareButton(),
    nightButton(),
    soundButton(),
    button("", "?", openHelp, { id: "help-button", label: t("help.title") }),
    button("menu", "", openMenu, { id: "menu-button", label: t("menu.title") }),
  );
  store.watch(["role"], () => {
    document.body.dataset.role = store.get("role");
  });
}

/** @returns {HTMLElement} */
function verdictButton() {
  const node = button("", "–", () => store.set({ tab: "checks" }), {
    id: "verdict",
    title: t("bar.show_checks"),
  });
  store.watch(["verdicts", "current"], () => {
    const { tone, word } = currentVerdict();
    node.dataset.tone = tone;
    setText(node.querySelector(".words"), said(word));
  });
  return node;
}

/** @returns {HTMLElement} selects the aircraft, if there are several */
function aircraftSwitch() {
  const holder = element("div", {
    id: "aircraft",
    role: "radiogroup",
    "aria-label": t("bar.aircraft"),
  });
  store.watch(["aircraft"], () => {
    const { aircraft } = store.values;
    holder.hidden = aircraft.length < 2;
    holder.replaceChildren(
      ...aircraft.map((/** @type {import("../store.js").Aircraft} */ { id, name }) =>
        element("button", {
          type: "button",
          role: "radio",
          text: name || id,
          data: { aircraft: id },
          on: { click: () => store.set({ current: id, still: false }) },
        }),
      ),
    );
  });
  store.watch(["aircraft", "current"], () => {
    for (const one of holder.children) {
      one.setAttribute("aria-checked", String(one.dataset.aircraft === store.get("current")));
    }
  });
  return holder;
}

/** @returns {HTMLElement} the big numbers, where there is room */
function readings() {
  const values = SHOWN.map(() => element("b", {}));
  const cells = SHOWN.map(({ words }, index) =>
    element("span", {}, element("small", { text: words }), values[index]),
  );
  store.watch(["states", "current", "units"], () => {
    const state = currentState() ?? {};
    SHOWN.forEach(({ text, tone }, index) => {
      setText(values[index], text(state));
      values[index].dataset.tone = tone?.(state) ?? "";
    });
  });
  const node = element("div", { id: "readings" }, ...cells);
  new ResizeObserver(() => leaveRoom(node)).observe(node);
  return node;
}

/** Tells the style sheet where the numbers are: the banner lies over them. @param {Element} node */
function leaveRoom(node) {
  const { left, right } = node.getBoundingClientRect();
  const { style, clientWidth } = document.documentElement;
  style.setProperty("--readings-left", `${left}px`);
  style.setProperty("--readings-right", `${clientWidth - right}px`);
}

/** @returns {HTMLElement} */
function role() {
  return element("span", { class: "viewer-only role", text: t("bar.viewer") });
}

/** @returns {HTMLElement} */
function recordButton() {
  const node = button("record", t("bar.record"), record, { id: "record", class: "operator-only" });
  store.watch(["states", "current", "asked"], () => {
    const on = Boolean(currentState()?.recording);
    showCommand(node, "record", on, on ? t("bar.recording") : t("bar.record"));
  });
  return node;
}

/** @returns {HTMLElement} */
function shareButton() {
  const node = button("share", t("bar.share"), share, {
    id: "share",
    class: "operator-only wide-only",
    title: t("bar.share_more"),
  });
  store.watch(["states", "current", "asked"], () => {
    const { tone, words } = sharingWords(currentState()?.sharing);
    node.dataset.tone = tone;
    showCommand(node, "share", Boolean(currentState()?.sharing?.on), words);
  });
  return node;
}

/**
 * Shows a command that is on or off, or waits for its answer; it keeps the keyboard's focus then.
 * @param {HTMLButtonElement} node @param {string} type @param {boolean} on @param {string} words
 */
function showCommand(node, type, on, words) {
  const waits = store.get("asked").includes(type);
  node.setAttribute("aria-pressed", String(on));
  node.setAttribute("aria-busy", String(waits));
  node.setAttribute("aria-disabled", String(waits));
  setText(node.querySelector(".words"), waits ? t("bar.wait") : words);
}

/** @returns {HTMLElement} */
function nightButton() {
  const node = button("night", "", changeTheme, {
    id: "night",
    class: "wide-only",
    label: t("bar.night"),
  });
  store.watch(["theme"], () =>
    node.setAttribute("aria-pressed", String(store.get("theme") === "red")),
  );
  return node;
}

/** @returns {HTMLElement} */
function soundButton() {
  const node = button("sound", "", () => store.set({ sound: !store.get("sound") }), {
    id: "sound",
    label: t("bar.sound"),
  });
  store.watch(["sound"], () => {
    const on = store.get("sound");
    setIcon(node, on ? "sound" : "mute");
    node.setAttribute("aria-pressed", String(on));
    node.setAttribute("aria-label", on ? t("bar.sound_on") : t("bar.sound_off"));
  });
  return node;
}
