// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The menu: commands without room in the bar of a small screen, and those seldom needed. */

import { beep } from "../checks/alarm.js";
import { store } from "../store.js";
import { undo } from "../targets/changes.js";
import { FORMS } from "../targets/coordinates.js";
import { mark, share } from "./commands.js";
import { openDialog } from "./dialog.js";
import { button, byId, element } from "./dom.js";
import { LANGUAGES, language, t } from "./language.js";
import { changeTheme } from "./settings.js";

const UNITS = { metres: t("menu.metres"), feet: t("menu.feet") };

/** Opens the menu. */
export function openMenu() {
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
        byId("menu").close();
        run();
      },
      { class: operator ? "operator-only" : "" },
    );
  const { theme, sound, units, form } = store.values;
  openDialog(
    "menu",
    t("menu.title"),
    element(
      "div",
      { class: "items" },
      item("undo", t("menu.undo"), undo, true),
      item("mark", t("bar.mark_moment"), mark, true),
      item("share", t("menu.share"), share, true),
      item("night", theme === "red" ? t("menu.dark") : t("menu.red"), changeTheme),
      item(sound ? "mute" : "sound", sound ? t("menu.silence") : t("menu.sound"), () =>
        store.set({ sound: !sound }),
      ),
      item("sound", t("menu.try"), beep),
    ),
    choice("units", t("menu.units"), UNITS, units),
    choice("form", t("menu.form"), FORMS, form),
    choice("language", t("menu.language"), LANGUAGES, language, () => location.reload()),
  );
}

/**
 * @param {string} name  of the setting in the store
 * @param {string} words
 * @param {Record<string, string>} options  words by value
 * @param {string} value  the one chosen now
 * @param {() => void} then  called after a change
 * @returns {HTMLElement}
 */
function choice(name, words, options, value, then = () => {}) {
  const all = Object.entries(options).map(([key, text]) =>
    element("option", { value: key, text, selected: key === value }),
  );
  const change = (/** @type {any} */ { target }) => {
    store.set({ [name]: target.value });
    then();
  };
  const field = element("select", { on: { change }, data: { setting: name } }, ...all);
  return element("label", { class: "setting" }, element("span", { text: words }), field);
}
