/** Changes of targets: sent until confirmed, kept in the form till then, undone by one press. */

import { ask } from "../link/state_link.js";
import { toast } from "../shell/toast.js";
import { capital } from "../shell/words.js";
import { store, targetOf } from "../store.js";

/**
 * What was typed and is not confirmed: target id -> its fields, and what became of them.
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

/**
 * Sends an edit; without a connection it waits in the form and goes as soon as there is one.
 * @param {import("../store.js").Target} target
 * @param {Record<string, string>} fields  name, kind or note
 */
export async function edit(target, fields) {
  const before = draftOf(target.id);
  const draft = { fields: { ...before.fields, ...fields }, open: before.open + 1, refusal: "" };
  setDraft(target.id, draft);
  const answer = await ask("edit", { id: target.id, ...fields }, { keep: true });
  const now = draftOf(target.id);
  setDraft(target.id, {
    ...now,
    open: now.open - 1,
    refusal: answer.ok ? "" : (answer.reason ?? ""),
  });
  if (answer.ok) changed(`Target ${target.number} changed`, target.id);
  else toast(`Target ${target.number} not changed: ${answer.reason}`, { tone: "bad" });
}

/** @param {string} id  forgets a refused edit */
export function dropDraft(id) {
  const draft = draftOf(id);
  if (draft.refusal) setDraft(id, { ...draft, fields: {}, refusal: "" });
}

/** @param {import("../store.js").Target} target */
export async function remove(target) {
  store.set({ selected: null });
  const answer = await ask("delete", { id: target.id }, { keep: true });
  const gone = !targetOf(target.id); // by an earlier try whose answer was lost
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
 * Says what changed, with the way back: others may have changed other targets since.
 * @param {string} words
 * @param {string} id  of the target
 */
export function changed(words, id) {
  toast(words, { action: { icon: "undo", words: "Undo", run: () => takeBack({ id }) } });
}
