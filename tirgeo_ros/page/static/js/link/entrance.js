// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The entrance: gives the server the token of the address bar, or asks for one. */

import { byId, element } from "../shell/dom.js";
import { said, t } from "../shell/language.js";
import { capital } from "../shell/words.js";

/**
 * Resolves as soon as the server lets this browser in; until then it asks for the token.
 * @returns {Promise<void>}
 */
export async function enter() {
  const token = new URLSearchParams(location.search).get("token");
  if (token !== null) history.replaceState(null, "", location.pathname);
  const refusal = token === null ? await refusalNow() : await handOver(token);
  if (refusal) await askForToken(refusal);
}

/** @returns {Promise<string>} why this browser may not come in; "" if it may */
async function refusalNow() {
  const answer = await reach(async () => {
    const response = await fetch("/enter");
    if (response.status === 429 || response.status >= 500) throw new Error("later");
    return response;
  });
  return answer.ok ? "" : t("entrance.needs_token");
}

/**
 * @param {string} token
 * @returns {Promise<string>} the refusal; "" if the token was taken
 */
async function handOver(token) {
  const body = JSON.stringify({ token });
  const headers = { "Content-Type": "application/json" };
  const answer = await reach(() => fetch("/enter", { method: "POST", headers, body }));
  if (answer.ok) return "";
  const { reason = "wrong token" } = await answer.json().catch(() => ({}));
  return capital(said(reason));
}

/**
 * Repeats a request until the server can be reached.
 * @param {() => Promise<Response>} request
 * @returns {Promise<Response>}
 */
async function reach(request) {
  for (;;) {
    try {
      return await request();
    } catch {
      await new Promise((resolve) => setTimeout(resolve, 1000));
    }
  }
}

/**
 * @param {string} refusal
 * @returns {Promise<void>} when a token was taken
 */
function askForToken(refusal) {
  const dialog = byId("enter");
  const reason = element("h1", { text: refusal });
  const field = element("input", {
    "aria-label": t("entrance.field"),
    autocomplete: "off",
    placeholder: t("entrance.hint"),
    spellcheck: "false",
  });
  const send = element("button", { class: "primary", text: t("entrance.enter") });
  const form = element(
    "form",
    {},
    reason,
    element("p", { text: t("entrance.where") }),
    field,
    send,
  );
  dialog.replaceChildren(form);
  dialog.onclose = () => dialog.showModal(); // by Escape, or by a tablet's own Back
  dialog.showModal();
  return new Promise((resolve) => {
    form.addEventListener("submit", async (/** @type {Event} */ event) => {
      event.preventDefault();
      reason.textContent = await handOver(tokenOf(field.value.trim()));
      if (reason.textContent) return;
      dialog.onclose = null;
      dialog.close();
      resolve();
    });
  });
}

/** @param {string} text  a token, or the link with it */
function tokenOf(text) {
  return text.match(/[?&]token=([^&#\s]+)/)?.[1] ?? text;
}
