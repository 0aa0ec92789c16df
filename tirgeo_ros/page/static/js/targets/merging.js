// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Makes one target of two: after a press near an older one, or chosen on a card. */

import { ask } from "../link/state_link.js";
import { button, element, setText } from "../shell/dom.js";
import { said, t } from "../shell/language.js";
import { toast } from "../shell/toast.js";
import { called, distance } from "../shell/words.js";
import { store, targetOf } from "../store.js";
import { changed } from "./changes.js";
import { badge } from "./symbols.js";

/** @typedef {import("../store.js").Target} Target */

const METRES = 111320; // in a degree of latitude
const MOST_OFFERED = 30;

/**
 * Gives the presses of a target to another one; the first is gone then.
 * @param {Target} target
 * @param {Target} into
 */
export async function merge(target, into) {
  const answer = await ask("merge", { id: target.id, into: into.id });
  if (!answer.ok) {
    toast(t("merge.refused", { reason: said(answer.reason ?? "") }), { tone: "bad" });
    return;
  }
  store.set({ selected: into.id });
  const words = t("merge.done", { number: target.number, into: into.number });
  changed(answer.target.clicks_agree ? words : `${words} ${t("merge.disagree")}`, into.id);
}

/**
 * @param {Target} target  just set
 * @param {string[]} near  ids of the targets that it may be, nearest first
 * @returns {HTMLElement | null} a button that makes it one with the nearest
 */
export function sameAs(target, near) {
  const into = near.map(targetOf).find(Boolean);
  if (!into) return null;
  const words = t("merge.same", { target: `${into.number} ${called(into)}` });
  return button("merge", words, () => merge(target, into), { class: "primary same" });
}

/**
 * Returns a part of a target's card: a button, and behind it the other targets, nearest first.
 * @param {() => Target} now
 * @returns {{node: HTMLElement, update: () => void}}
 */
export function mergePart(now) {
  const rows = element("ol", { class: "merge-rows", hidden: true });
  const opener = button("merge", t("merge.with"), () => {
    rows.hidden = !rows.hidden;
    opener.setAttribute("aria-expanded", String(!rows.hidden));
    update();
  });
  opener.setAttribute("aria-expanded", "false");
  const update = () => {
    const others = store.get("targets").length > 1;
    opener.disabled = !others;
    setText(opener.querySelector(".words"), others ? t("merge.with") : t("merge.alone"));
    if (!rows.hidden) rows.replaceChildren(...othersOf(now()).map((one) => row(now, one)));
  };
  return { node: element("div", { class: "merge operator-only" }, opener, rows), update };
}

/** @param {Target} target @returns {Target[]} */
function othersOf(target) {
  const others = store.get("targets").filter((/** @type {Target} */ one) => one.id !== target.id);
  const apart = (/** @type {Target} */ one) => metresBetween(target, one);
  return others
    .sort((/** @type {Target} */ one, /** @type {Target} */ other) => apart(one) - apart(other))
    .slice(0, MOST_OFFERED);
}

/** @param {() => Target} now @param {Target} other */
function row(now, other) {
  const away = element("span", { class: "mono", text: distance(metresBetween(now(), other)) });
  const words = element("strong", { class: "grow", text: called(other), dir: "auto" });
  const choose = () => merge(now(), other);
  const own = { type: "button", class: "row", on: { click: choose }, data: { into: other.id } };
  return element("li", {}, element("button", own, badge(other), words, away));
}

/** @param {Target} one @param {Target} other @returns {number} near enough to order by */
function metresBetween(one, other) {
  const east = ((other.longitude_deg - one.longitude_deg + 540) % 360) - 180;
  const narrow = Math.cos((one.latitude_deg * Math.PI) / 180);
  return METRES * Math.hypot(other.latitude_deg - one.latitude_deg, east * narrow);
}
