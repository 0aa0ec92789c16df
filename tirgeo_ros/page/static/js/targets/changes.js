// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Changes of targets: sent and kept in the form until confirmed; one press undoes them. */

import { ask } from "../link/state_link.js";
import { toast } from "../shell/toast.js";
import { capital } from "../shell/words.js";
import { store, targetOf } from "../store.js";

/** @typedef {import("../store.js").Target} Target */
/** @typedef {"name" | "kind" | "note"} Field */

/**
 * What was typed and is not confirmed: target id -> its fields, requests open, and a refusal.
 * @typedef {{fields: Record<string, string>, open: number, refusal: string}} Draft
 */

store.set({ drafts: {} });

/** @param {string} id @returns {Draft} */
export function draftOf(id) {
  return store.get("drafts")[id] ?? { fields: {}, open: 0, refusal: "" };
}

/** @param {string} id @param {Draft} draft */
function setDraft(id, draft) {
  const { [id]: _, ...others } = store.get("drafts");
  const done = draft.open === 0 && !draft.refusal;
  store.set({ drafts: done ? others : { ...others, [id]: draft } });
}

/** @param {Target} target @param {Field} key @returns {string} */
export function shownOf(target, key) {
  return draftOf(target.id).fields[key] ?? target[key];
}

/** @param {Target} target @param {Field} key @returns {string} the text that an edit begins with */
export function baseOf(target, key) {
  return draftOf(target.id).refusal ? target[key] : shownOf(target, key);
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
  setDraft(id, { fields, open: before.open + 1, refusal: "" });
  const answer = await ask("edit", { id, was: { [key]: base }, [key]: value }, { keep: true });
  const newest = (/** @type {Target} */ one) => (one.id === id ? answer.target : one);
  if (answer.ok && !answer.again) store.set({ targets: store.get("targets").map(newest) });
  const now = draftOf(id);
  const deleted = !answer.ok && !targetOf(id); // undoing the deletion brings the text back
  const refusal = answer.ok || deleted ? "" : (answer.reason ?? "");
  setDraft(id, { ...now, open: now.open - 1, refusal });
  const late = answer.target?.alternatives.some(([field]) => field === key);
  const both = `Target ${number}: changed elsewhere meanwhile. Its card has both texts: choose`;
  const action = deleted ? wayBack(id) : undefined;
  if (!answer.ok) toast(`Target ${number} not changed: ${answer.reason}`, { tone: "bad", action });
  else if (late && answer.target[key] !== value) toast(both, { tone: "bad" });
  else changed(`Target ${number} changed`, id);
}

/** @param {string} id  forgets a refused edit */
export function dropDraft(id) {
  const draft = draftOf(id);
  if (draft.refusal) setDraft(id, { ...draft, fields: {}, refusal: "" });
}

/** @param {Target} target @param {Field} field @param {string} text  an alternative */
export async function leaveOut({ id, number }, field, text) {
  const answer = await ask("leave_out", { id, field, text });
  if (answer.ok) changed(`Target ${number}: left out`, id);
  else toast(`Not left out: ${answer.reason}`, { tone: "bad" });
}

/** @param {Target} target */
export async function remove(target) {
  store.set({ selected: null });
  const base = (/** @type {Field} */ key) => baseOf(target, key);
  const was = { name: base("name"), kind: base("kind"), note: base("note") };
  const answer = await ask("delete", { id: target.id, was }, { keep: true });
  const gone = !targetOf(target.id); // deleted by an earlier try whose answer was lost
  if (answer.ok || gone) changed(`Target ${target.number} deleted`, target.id);
  else toast(`Target ${target.number} not deleted: ${answer.reason}`, { tone: "bad" });
}

/** Undoes the last change, whoever made it. */
export function undo() {
  return takeBack({});
}

/** @param {{id?: string}} which  the target whose last change is undone; none: the last of all */
async function takeBack(which) {
  const answer = await ask("undo", which);
  if (answer.ok) toast(capital(answer.text));
  else toast(`Not undone: ${answer.reason}`, { tone: "bad" });
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
  return { icon: "undo", words: "Undo", run: () => takeBack({ id }) };
}
