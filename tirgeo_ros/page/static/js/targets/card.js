// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The card of one target: all its data, and the commands for it. */

import { button, byId, element, setText } from "../shell/dom.js";
import { t } from "../shell/language.js";
import { toast } from "../shell/toast.js";
import { called, dateAndTime, ellipse, length } from "../shell/words.js";
import { mayChange, store, targetOf } from "../store.js";
import { baseOf, draftOf, edit, leaveOut, remove, shownOf } from "./changes.js";
import { coordinateRows } from "./coordinates.js";
import { mergePart } from "./merging.js";
import { badge, kindButton, showChosen, statusButton } from "./symbols.js";

/** @typedef {import("../store.js").Target} Target */

const FIELDS = {
  name: t("card.name"),
  kind: t("card.kind"),
  note: t("card.note"),
  status: t("card.status"),
};

/** Builds the card's holder, and fills it each time a target is selected. */
export function buildCard() {
  const holder = element("div", { id: "target-card", hidden: true });
  byId("targets").append(holder);
  let update = () => {};
  let number = 0; // of the target
  store.watch(["selected"], () => {
    const target = targetOf(store.get("selected"));
    holder.hidden = !target;
    number = target?.number ?? 0;
    update = target ? fill(holder, target) : () => {};
    update();
  });
  store.watch(["targets", "drafts", "link", "role", "units", "form"], () => {
    const { selected, refine } = store.values;
    if (refine && !targetOf(refine)) store.set({ refine: null }); // also if it comes back
    if (selected && !targetOf(selected)) {
      toast(t("card.gone", { number }), { tone: "bad" });
      /** @type {HTMLElement} */ (document.activeElement).blur(); // sends a text being typed
      store.set({ selected: null });
    }
    update();
  });
}

/**
 * Fills the card.
 * @param {HTMLElement} holder
 * @param {Target} first
 * @returns {() => void} shows the target's newest data, but keeps the text that is being typed
 */
function fill(holder, first) {
  const now = () => targetOf(first.id) ?? first;
  const own = [head(now), statusButtons(now), kindButtons(now), texts(now), choices(now)];
  const parts = [...own, place(now), pictures(now), actions(now), mergePart(now)];
  holder.replaceChildren(...parts.map((part) => part.node));
  byId("panel").scrollTo(0, 0);
  return () => parts.forEach((part) => part.update());
}

/** @typedef {{node: HTMLElement, update: () => void}} Part */

/** @param {() => Target} now @returns {Part} */
function head(now) {
  const title = element("h2", { class: "grow" });
  const holder = element("span", {});
  const back = button("back", t("card.list"), () => store.set({ selected: null }), {
    class: "plain",
  });
  const update = () => {
    const shown = { ...now(), ...draftOf(now().id).fields };
    setText(title, called(shown));
    holder.replaceChildren(badge(shown));
  };
  return { node: element("header", { class: "list-head" }, back, holder, title), update };
}

/** @param {() => Target} now @returns {Part} */
function kindButtons(now) {
  const make = (/** @type {string} */ kind) =>
    kindButton(kind, () => edit(now(), "kind", kind), {});
  const part = choosers(now, "kind", store.get("kinds").map(make), t("card.kind"));
  part.node.classList.add("operator-only");
  return part;
}

/** @param {() => Target} now @returns {Part} */
function statusButtons(now) {
  const make = (/** @type {string} */ status) =>
    statusButton(status, () => edit(now(), "status", status));
  return choosers(now, "status", store.get("statuses").map(make), t("card.status"));
}

/**
 * @param {() => Target} now
 * @param {"kind" | "status"} field
 * @param {HTMLButtonElement[]} buttons  each with its word in its data
 * @param {string} label
 * @returns {Part}
 */
function choosers(now, field, buttons, label) {
  const node = element("div", { class: "kinds", role: "group", "aria-label": label }, ...buttons);
  const update = () => {
    const chosen = shownOf(now(), field);
    showChosen(buttons, ({ dataset }) => dataset[field] === chosen);
    for (const one of buttons) one.disabled = !mayChange();
  };
  return { node, update };
}

/** @param {() => Target} now @returns {Part} name and note, saved when a field is left */
function texts(now) {
  /** @type {Record<string, {shown: string, was: string}>} each field's text when it was filled */
  const filled = {};
  const save = (/** @type {"name" | "note"} */ key) => (/** @type {Event} */ event) => {
    const value = /** @type {HTMLInputElement} */ (event.target).value.trim();
    const { shown, was } = filled[key];
    filled[key] = { shown: value, was: value };
    if (value !== shown) edit(now(), key, value, was);
  };
  const name = element("input", {
    maxlength: store.get("most").name,
    placeholder: t("card.name"),
    "aria-label": t("card.name"),
    autocomplete: "off",
    on: { change: save("name") },
  });
  const note = element("textarea", {
    maxlength: store.get("most").note,
    rows: "2",
    placeholder: t("card.note"),
    "aria-label": t("card.note"),
    on: { change: save("note") },
  });
  const status = element("p", { class: "said", role: "status" });
  const fields = /** @type {const} */ ([
    { field: name, key: "name" },
    { field: note, key: "note" },
  ]);
  const update = () => {
    let words = stateOfDraft(now().id);
    for (const { field, key } of fields) {
      const shown = shownOf(now(), key);
      const typing = document.activeElement === field && field.value !== filled[key]?.shown;
      field.readOnly = store.get("role") !== "operator";
      if (!typing) {
        filled[key] = { shown, was: baseOf(now(), key) };
        if (field.value !== shown) field.value = shown; // the same would move the caret
      } else if (shown !== filled[key].shown) {
        words ||= t("card.changed", { text: shown || t("card.emptied") });
      }
    }
    setText(status, words);
    status.hidden = !words;
  };
  name.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    if (event.key === "Enter") name.blur();
  });
  return { node: element("div", { class: "texts" }, name, note, status), update };
}

/** @param {() => Target} now @returns {Part} texts that two users wrote at once, to choose from */
function choices(now) {
  const node = element("div", { class: "choices" });
  const update = () => {
    const key = JSON.stringify(now().alternatives);
    if (node.dataset.key === key) return;
    node.dataset.key = key;
    node.replaceChildren(...now().alternatives.map((one) => choice(now, ...one)));
  };
  return { node, update };
}

/**
 * @param {() => Target} now
 * @param {import("./changes.js").Field} key
 * @param {string} text
 */
function choice(now, key, text) {
  const both = () => edit(now(), key, `${baseOf(now(), key)}\n${text}`.trim());
  const buttons = [
    button("", t("card.use"), () => edit(now(), key, text)),
    key === "note" ? button("", t("card.both"), both) : null,
    button("", t("card.leave_out"), () => leaveOut(now(), key, text)),
  ];
  return element(
    "div",
    { class: "choice" },
    element("p", { class: "said", text: t("card.also", { field: FIELDS[key] }) }),
    element("p", { class: "other", text: text || `(${t("card.emptied")})` }),
    element("div", { class: "actions operator-only" }, ...buttons),
  );
}

/** @param {string} id @returns {string} */
function stateOfDraft(id) {
  const { open, refused } = draftOf(id);
  const [reason] = Object.values(refused);
  if (reason !== undefined) return t("card.not_saved", { reason });
  if (!open) return "";
  return store.get("link").phase === "open" ? t("card.saving") : t("card.waiting");
}

/** @param {() => Target} now @returns {Part} the place of the target, and its accuracy */
function place(now) {
  const rows = coordinateRows(() => now().coordinates);
  const fact = (/** @type {string} */ words, /** @type {(target: Target) => string} */ text) => {
    const value = element("dd", {});
    return { words, value, text };
  };
  const facts = [
    fact(
      t("card.ellipse"),
      ({ ellipse: axes, clicks }) =>
        `${ellipse(axes)}${clicks > 1 ? `, ${t("card.presses", { count: clicks })}` : ""}`,
    ),
    fact(t("card.msl"), ({ height_msl_m: height }) => length(height, 1)),
    fact(t("card.ellipsoid"), ({ height_m: height }) => length(height, 1)),
    fact(t("card.set"), ({ created_ns: created }) => dateAndTime(created)),
  ];
  const list = element(
    "dl",
    { class: "facts" },
    ...facts.map(({ words, value }) => element("div", {}, element("dt", { text: words }), value)),
  );
  const disagree = element("p", {
    class: "said",
    hidden: true,
    text: t("card.disagree"),
  });
  const update = () => {
    rows.update();
    facts.forEach(({ value, text }) => setText(value, text(now())));
    disagree.hidden = now().clicks_agree;
  };
  return { node: element("div", { class: "place" }, rows.node, list, disagree), update };
}

/** @param {() => Target} now @returns {Part} cut-out and code to scan */
function pictures(now) {
  const { id, number } = now();
  const cut = figure("picture", t("card.picture", { number }), t("card.as_pressed"));
  const code = figure("qr", t("card.code"), t("card.scan"));
  const node = element("div", { class: "pictures" }, cut.node, code.node);
  const update = () => {
    const { latitude_deg: latitude, longitude_deg: longitude } = now();
    cut.show(`/targets/${id}/picture`);
    code.show(`/targets/${id}/qr?at=${latitude},${longitude}`); // of this place, not of an older
  };
  return { node, update };
}

/**
 * Returns a picture that is hidden if it does not come, and asked for again after a reconnection.
 * @param {string} look  its class
 * @param {string} alt
 * @param {string} words  below it
 * @returns {{node: HTMLElement, show: (source: string) => void}}
 */
function figure(look, alt, words) {
  /** @type {import("../store.js").Link | undefined} the connection at which it did not come */
  let missed;
  const error = () => {
    node.hidden = true;
    missed = store.get("link");
  };
  const image = element("img", { class: look, alt, on: { error } });
  const node = element("figure", {}, image, element("figcaption", { text: words }));
  const show = (/** @type {string} */ source) => {
    const { link } = store.values;
    const again = node.hidden && link.phase === "open" && link !== missed;
    if (image.getAttribute("src") === source && !again) return;
    node.hidden = false;
    image.setAttribute("src", source);
  };
  return { node, show };
}

/** @param {() => Target} now @returns {Part} */
function actions(now) {
  const again = button("refine", t("card.again"), () => store.set({ refine: now().id }), {
    class: "operator-only",
    id: "refine",
    title: t("card.again_more"),
  });
  const show = button("map", t("card.on_map"), () =>
    store.set({ tab: "map", shown: { id: now().id } }),
  );
  const gone = button("delete", t("card.delete"), () => remove(now()), {
    class: "danger operator-only",
    id: "delete",
  });
  return { node: element("div", { class: "actions" }, again, show, gone), update: () => {} };
}
