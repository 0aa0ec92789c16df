// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Changes of targets: sent and kept in the form until confirmed; one press undoes them. */

import { ask } from "../link/state_link.js";
import { said, t } from "../shell/language.js";
import { toast } from "../shell/toast.js";
import { capital } from "../shell/words.js";
import { store, targetOf } from "../store.js";

/** @typedef {import("../store.js").Target} Target */
/** @typedef {"name" | "kind" | "note" | "status"} Field */

/**
 * What was typed and is not confirmed: target id -> its fields, requests open, and why fields were
 * refused.
 * @typedef {Record<string, string>} Texts  by field
 * @typedef {{fields: Texts, open: number, refused: Texts}} Draft
 */

store.set({ drafts: {} });

/** @param {string} id @returns {Draft} */
export function draftOf(id) {
  return store.get("drafts")[id] ?? { fields: {}, open: 0, refused: {} };
}

/** @param {string} id @param {Draft} draft  of which only what was refused stays in the end */
function setDraft(id, { fields, open, refused }) {
  const { [id]: _, ...others } = store.get("drafts");
  const left = Object.entries(fields).filter(([key]) => open || key in refused);
  const draft = { fields: Object.fromEntries(left), open, refused };
  store.set({ drafts: left.length ? { ...others, [id]: draft } : others });
}

/** @param {Target} target @param {Field} key @returns {string} */
export function shownOf(target, key) {
  return draftOf(target.id).fields[key] ?? target[key];
}

/** @param {Target} target @param {Field} key @returns {string} the text that an edit begins with */
export function baseOf(target, key) {
  return key in draftOf(target.id).refused ? target[key] : shownOf(target, key);
}

/**
 * Sends an edit; without a connection it waits in the form and goes as soon as there is one.
 * @param {Target} target
 * @param {Field} key
 * @param {string} value
 * @param {string} base  the text that the operator began with
 */
export async function edit(target, key, value, base = baseOf(target, key)) {
  const { id, number } = target;
  const before = draftOf(id);
  const fields = { ...before.fields, [key]: value };
  setDraft(id, { fields, open: before.open + 1, refused: without(before.refused, key) });
  const answer = await ask("edit", { id, was: { [key]: base }, [key]: value }, { keep: true });
  const newest = (/** @type {Target} */ one) => (one.id === id ? answer.target : one);
  if (answer.ok && !answer.again) store.set({ targets: store.get("targets").map(newest) });
  const now = draftOf(id);
  const deleted = !answer.ok && !targetOf(id); // undoing the deletion brings the text back
  const reason = said(answer.reason ?? "");
  const others = without(now.refused, key);
  const refused = answer.ok || deleted ? others : { ...others, [key]: reason };
  setDraft(id, { ...now, open: now.open - 1, refused });
  const late = answer.target?.alternatives.some((/** @type {string[]} */ [field]) => field === key);
  const both = t("change.both", { number });
  const action = deleted ? wayBack(id) : undefined;
  if (!answer.ok) toast(t("change.refused", { number, reason }), { tone: "bad", action });
  else if (late && answer.target[key] !== value) toast(both, { tone: "bad" });
  else changed(t("change.done", { number }), id);
}

/** @param {Texts} texts @param {Field} key @returns {Texts} */
function without(texts, key) {
  const { [key]: _, ...others } = texts;
  return others;
}

/** @param {Target} target @param {Field} field @param {string} text  an alternative */
export async function leaveOut({ id, number }, field, text) {
  const answer = await ask("leave_out", { id, field, text });
  if (answer.ok) changed(t("change.left_out", { number }), id);
  else toast(t("change.not_left_out", { reason: said(answer.reason ?? "") }), { tone: "bad" });
}

/** @param {Target} target */
export async function remove(target) {
  store.set({ selected: null });
  if (store.get("link").phase !== "open") toast(t("card.waiting"), { tone: "bad" });
  const base = (/** @type {Field} */ key) => baseOf(target, key);
  const texts = { name: base("name"), kind: base("kind"), note: base("note") };
  const was = { ...texts, status: base("status") };
  const answer = await ask("delete", { id: target.id, was }, { keep: true });
  const gone = !targetOf(target.id); // deleted by an earlier try whose answer was lost
  if (answer.ok || gone) changed(t("change.deleted", { number: target.number }), target.id);
  else {
    const words = { number: target.number, reason: said(answer.reason ?? "") };
    toast(t("change.not_deleted", words), { tone: "bad" });
  }
}

/** Undoes the last change, whoever made it. */
export function undo() {
  return takeBack({});
}

/** @param {{id?: string}} which  the target whose last change is undone; none: the last of all */
async function takeBack(which) {
  const answer = await ask("undo", which);
  if (answer.ok) toast(capital(said(answer.text)));
  else toast(t("change.not_undone", { reason: said(answer.reason ?? "") }), { tone: "bad" });
}

/**
 * Says what changed, with an undo of that target: others may have changed other targets since.
 * @param {string} words
 * @param {string} id  of the target
 */
export function changed(words, id) {
  toast(words, { action: wayBack(id) });
}

/** @param {string} id  of the target whose last change the button undoes */
function wayBack(id) {
  return { icon: "undo", words: t("shell.undo"), run: () => takeBack({ id }) };
}
