// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Opens a dialog of index.html with a title, a button that closes it, and its content. */

import { button, byId, element } from "./dom.js";
import { t } from "./language.js";

/**
 * @param {string} id  of the dialog
 * @param {string} title
 * @param {...Node} content
 */
export function openDialog(id, title, ...content) {
  const dialog = byId(id);
  const head = element(
    "header",
    { class: "list-head" },
    element("h2", { class: "grow", text: title }),
    button("close", "", () => dialog.close(), { label: t("shell.close"), class: "plain" }),
  );
  dialog.replaceChildren(head, ...content);
  dialog.onclick = (/** @type {Event} */ event) => {
    if (event.target === dialog) dialog.close(); // beside it
  };
  dialog.showModal();
}
