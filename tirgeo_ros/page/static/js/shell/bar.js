/** The bar at the top: go or no go, the big numbers, record, mark, share, night, menu. */

import { READINGS } from "../checks/readings.js";
import { currentVerdict } from "../checks/verdict.js";
import { currentState, store } from "../store.js";
import { mark, record, share, sharingWords } from "./commands.js";
import { button, byId, element, setIcon, setText } from "./dom.js";
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
    button("mark", "Mark", mark, {
      id: "mark",
      class: "operator-only wide-only",
      label: "Mark this moment",
    }),
    shareButton(),
    nightButton(),
    soundButton(),
    button("menu", "", openMenu, { id: "menu-button", label: "Menu" }),
  );
  store.watch(["role"], () => {
    document.body.dataset.role = store.get("role");
  });
}

/** @returns {HTMLElement} */
function verdictButton() {
  const made = button("", "–", () => store.set({ tab: "checks" }), {
    id: "verdict",
    title: "Show the checks",
  });
  store.watch(["verdicts", "current"], () => {
    const { tone, word } = currentVerdict();
    made.dataset.tone = tone;
    setText(made.querySelector(".words"), word);
  });
  return made;
}

/** @returns {HTMLElement} selects the aircraft, if there are several */
function aircraftSwitch() {
  const holder = element("div", { id: "aircraft", role: "radiogroup", "aria-label": "Aircraft" });
  store.watch(["aircraft", "current"], () => {
    const { aircraft, current } = store.values;
    holder.hidden = aircraft.length < 2;
    holder.replaceChildren(
      ...aircraft.map((/** @type {import("../store.js").Aircraft} */ { id, name }) =>
        element("button", {
          type: "button",
          role: "radio",
          "aria-checked": String(id === current),
          text: name || id,
          on: { click: () => store.set({ current: id, still: false }) },
        }),
      ),
    );
  });
  return holder;
}

/** @returns {HTMLElement} the big numbers, where there is room */
function readings() {
  const values = SHOWN.map(() => element("b", {}));
  const cells = SHOWN.map(({ words }, index) =>
    element("span", {}, element("small", { text: words }), values[index]),
  );
  store.watch(["states", "current"], () => {
    const state = currentState() ?? {};
    SHOWN.forEach(({ text, tone }, index) => {
      setText(values[index], text(state));
      values[index].dataset.tone = tone?.(state) ?? "";
    });
  });
  return element("div", { id: "readings" }, ...cells);
}

/** @returns {HTMLElement} */
function role() {
  return element("span", { class: "viewer-only role", text: "Viewer" });
}

/** @returns {HTMLElement} */
function recordButton() {
  const made = button("record", "Record", record, { id: "record", class: "operator-only" });
  store.watch(["states", "current", "asked"], () => {
    const on = Boolean(currentState()?.recording);
    showCommand(made, "record", on, on ? "REC" : "Record");
  });
  return made;
}

/** @returns {HTMLElement} */
function shareButton() {
  const made = button("share", "Share", share, {
    id: "share",
    class: "operator-only wide-only",
    title: "Share the targets with the team, by Cursor-on-Target",
  });
  store.watch(["states", "current", "asked"], () => {
    const { tone, words } = sharingWords(currentState()?.sharing);
    made.dataset.tone = tone;
    showCommand(made, "share", Boolean(currentState()?.sharing?.on), words);
  });
  return made;
}

/**
 * Shows a command that is on or off, or waits for its answer; it keeps the keyboard's focus then.
 * @param {HTMLButtonElement} made @param {string} type @param {boolean} on @param {string} words
 */
function showCommand(made, type, on, words) {
  const waits = store.get("asked").includes(type);
  made.setAttribute("aria-pressed", String(on));
  made.setAttribute("aria-busy", String(waits));
  made.setAttribute("aria-disabled", String(waits));
  setText(made.querySelector(".words"), waits ? "Wait…" : words);
}

/** @returns {HTMLElement} */
function nightButton() {
  const made = button("night", "", changeTheme, {
    id: "night",
    class: "wide-only",
    label: "Red night mode",
  });
  store.watch(["theme"], () =>
    made.setAttribute("aria-pressed", String(store.get("theme") === "red")),
  );
  return made;
}

/** @returns {HTMLElement} */
function soundButton() {
  const made = button("sound", "", () => store.set({ sound: !store.get("sound") }), {
    id: "sound",
    label: "Alarm sound",
  });
  store.watch(["sound"], () => {
    const on = store.get("sound");
    setIcon(made, on ? "sound" : "mute");
    made.setAttribute("aria-pressed", String(on));
    made.setAttribute(
      "aria-label",
      on ? "Alarm sound is on: silence it" : "Alarm sound is off: switch it on",
    );
  });
  return made;
}
