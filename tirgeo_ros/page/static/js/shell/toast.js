// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** A line at the foot of the page for some seconds, with a big button where one helps. */

import { button, byId, element, hideAfter } from "./dom.js";
import { t } from "./language.js";

/**
 * @param {string} words
 * @param {{tone?: "good" | "bad", action?: {icon: string, words: string, run: () => void},
 *   milliseconds?: number}} options
 */
export function toast(words, { tone = "good", action, milliseconds = 8000 } = {}) {
  const holder = byId("toast");
  const hide = () => {
    holder.hidden = true;
  };
  const act = action
    ? button(
        action.icon,
        action.words,
        () => {
          hide();
          action.run();
        },
        { class: "primary" },
      )
    : null;
  const close = button("close", "", hide, { label: t("shell.close"), class: "plain" });
  holder.replaceChildren(
    element("span", { class: "grow", text: words }),
    ...[act, close].filter(Boolean),
  );
  holder.dataset.tone = tone;
  holder.hidden = false;
  hideAfter(holder, milliseconds);
}
