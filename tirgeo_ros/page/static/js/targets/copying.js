// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Copies text, also where browsers give no clipboard: on plain http from another computer. */

/**
 * Copies the text of a node; if that is refused, leaves it selected, to be copied by hand.
 * @param {Element} node
 * @returns {Promise<boolean>} whether the text is in the clipboard
 */
export async function copy(node) {
  if (navigator.clipboard && window.isSecureContext) {
    try {
      await navigator.clipboard.writeText(node.textContent ?? "");
      return true;
    } catch {
      // no permission: copy the old way
    }
  }
  window.getSelection()?.selectAllChildren(node);
  return document.execCommand("copy");
}
