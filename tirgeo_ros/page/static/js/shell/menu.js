// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The menu: commands without room in the bar of a small screen, and those seldom needed. */

import { beep } from "../checks/alarm.js";
import { store } from "../store.js";
import { undo } from "../targets/changes.js";
import { mark, share } from "./commands.js";
import { button, byId, element } from "./dom.js";
import { KEYS } from "./keys.js";
import { changeTheme } from "./settings.js";

/** Opens the menu. */
export function openMenu() {
  const menu = byId("menu");
  const close = () => menu.close();
  const item = (
    /** @type {string} */ symbol,
    /** @type {string} */ words,
    /** @type {() => void} */ run,
    operator = false,
  ) =>
    button(
      symbol,
      words,
      () => {
        close();
        run();
      },
      { class: operator ? "operator-only" : "" },
    );
  const head = element(
    "header",
    { class: "list-head" },
    element("h2", { class: "grow", text: "Menu" }),
    button("close", "", close, { label: "Close", class: "plain" }),
  );
  const { theme, sound } = store.values;
  menu.replaceChildren(
    head,
    element(
      "div",
      { class: "items" },
      item("undo", "Undo the last change", undo, true),
      item("mark", "Mark this moment", mark, true),
      item("share", "Share with the team, or end it", share, true),
      item("night", theme === "red" ? "Dark colours" : "Red night colours", changeTheme),
      item(sound ? "mute" : "sound", sound ? "Silence the alarm" : "Switch the alarm on", () =>
        store.set({ sound: !sound }),
      ),
      item("sound", "Try the alarm", beep),
    ),
    keyList(),
  );
  menu.addEventListener("click", (/** @type {Event} */ event) => {
    if (event.target === menu) close(); // beside it
  });
  menu.showModal();
}

/** @returns {HTMLElement} */
function keyList() {
  const rows = KEYS.map(([key, words]) =>
    element("div", {}, element("dt", { text: key }), element("dd", { text: words })),
  );
  return element(
    "details",
    { class: "keys" },
    element("summary", { text: "Keys" }),
    element("dl", {}, ...rows),
  );
}
