// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The operator's commands that concern no target: record, mark, share. */

import { ask } from "../link/state_link.js";
import { currentState, mayChange, store } from "../store.js";
import { said, t } from "./language.js";
import { toast } from "./toast.js";
import { capital } from "./words.js";

/**
 * @param {string} type
 * @param {Record<string, any>} fields
 * @param {string} done  shown if the answer has no text
 */
async function command(type, fields, done) {
  const asked = store.get("asked");
  if (!mayChange() || asked.includes(type)) return;
  store.set({ asked: [...asked, type] });
  const answer = await ask(type, fields);
  store.set({ asked: store.get("asked").filter((/** @type {string} */ one) => one !== type) });
  if (answer.ok) toast(capital(answer.text ? said(answer.text) : done), { milliseconds: 4000 });
  else toast(t("command.refused", { reason: said(answer.reason ?? "") }), { tone: "bad" });
}

export function record() {
  const on = !currentState()?.recording;
  return command(
    "record",
    { aircraft: store.get("current"), on },
    on ? t("command.recording") : t("command.recorded"),
  );
}

/** Marks a moment: the server knows the time, this tablet's clock may be wrong. */
export function mark() {
  return command("mark", { text: "mark" }, t("command.marked"));
}

export function share() {
  const on = !currentState()?.sharing?.on;
  return command("share", { on }, on ? t("command.sharing") : t("command.shared"));
}

/**
 * @param {any} sharing  {on, queued, connected} or null
 * @returns {{tone: string, words: string}}
 */
export function sharingWords(sharing) {
  if (!sharing?.on) return { tone: "", words: t("bar.share") };
  if (sharing.connected) return { tone: "good", words: t("bar.shared") };
  return {
    tone: "caution",
    words: sharing.queued ? t("bar.queued", { count: sharing.queued }) : t("bar.no_server"),
  };
}
