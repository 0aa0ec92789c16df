// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The card of one target: all its data, and the commands for it. */

import { button, byId, element, setText } from "../shell/dom.js";
import { called, dateAndTime, ellipse, quantity } from "../shell/words.js";
import { store, targetOf } from "../store.js";
import { baseOf, dropDraft, draftOf, edit, leaveOut, remove, shownOf } from "./changes.js";
import { coordinateRows } from "./coordinates.js";
import { badge, kindButton } from "./symbols.js";

/** @typedef {import("../store.js").Target} Target */

/** Builds the card's holder, and fills it each time a target is selected. */
export function buildCard() {
  const holder = element("div", { id: "target-card", hidden: true });
  byId("targets").append(holder);
  let update = () => {};
  store.watch(["selected"], () => {
    const target = targetOf(store.get("selected"));
    holder.hidden = !target;
    update = target ? fill(holder, target) : () => {};
    update();
  });
  store.watch(["targets", "drafts", "link", "role"], () => {
    if (store.get("selected") && !targetOf(store.get("selected"))) {
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
  const own = [head(now), kindButtons(now), texts(now), choices(now)];
  const parts = [...own, place(now), pictures(now), actions(now)];
  holder.replaceChildren(...parts.map((part) => part.node));
  byId("panel").scrollTo(0, 0);
  return () => parts.forEach((part) => part.update());
}

/** @typedef {{node: HTMLElement, update: () => void}} Part */

/** @param {() => Target} now @returns {Part} */
function head(now) {
  const title = element("h2", { class: "grow" });
  const holder = element("span", {});
  const back = button("back", "List", () => store.set({ selected: null }), { class: "plain" });
  const update = () => {
    const shown = { ...now(), ...draftOf(now().id).fields };
    setText(title, called(shown));
    holder.replaceChildren(badge(shown));
  };
  return { node: element("header", { class: "list-head" }, back, holder, title), update };
}

/** @param {() => Target} now @returns {Part} */
function kindButtons(now) {
  const buttons = store
    .get("kinds")
    .map((/** @type {string} */ kind) => kindButton(kind, () => edit(now(), "kind", kind), {}));
  const node = element(
    "div",
    { class: "kinds operator-only", role: "group", "aria-label": "Kind" },
    ...buttons,
  );
  const update = () => {
    const kind = shownOf(now(), "kind");
    for (const one of buttons) one.setAttribute("aria-pressed", String(one.dataset.kind === kind));
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
    placeholder: "Name",
    "aria-label": "Name",
    autocomplete: "off",
    on: { change: save("name") },
  });
  const note = element("textarea", {
    maxlength: store.get("most").note,
    rows: "2",
    placeholder: "Note",
    "aria-label": "Note",
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
        words ||= `Changed elsewhere meanwhile: ${shown || "emptied"}. Yours is kept beside it`;
      }
    }
    setText(status, words);
    status.hidden = !words;
  };
  name.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    if (event.key === "Enter") name.blur();
  });
  name.addEventListener("input", () => dropDraft(now().id));
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
    button("", "Use this", () => edit(now(), key, text)),
    key === "note" ? button("", "Keep both", both) : null,
    button("", "Leave out", () => leaveOut(now(), key, text)),
  ];
  return element(
    "div",
    { class: "choice" },
    element("p", { class: "said", text: `Also written as the ${key}:` }),
    element("p", { class: "other", text: text || "(emptied)" }),
    element("div", { class: "actions operator-only" }, ...buttons),
  );
}

/** @param {string} id @returns {string} */
function stateOfDraft(id) {
  const { open, refusal } = draftOf(id);
  if (refusal) return `Not saved: ${refusal}`;
  if (!open) return "";
  return store.get("link").phase === "open"
    ? "Saving…"
    : "Not saved yet: it is sent as soon as the connection is back";
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
      "95 % ellipse",
      ({ ellipse: axes, clicks }) =>
        `${ellipse(axes)}${clicks > 1 ? `, ${clicks} presses` : ""}`,
    ),
    fact("Height above sea level", ({ height_msl_m: height }) => quantity(height, 1, "m")),
    fact("Height above ellipsoid", ({ height_m: height }) => quantity(height, 1, "m")),
    fact("Set", ({ created_ns: created }) => dateAndTime(created)),
  ];
  const list = element(
    "dl",
    { class: "facts" },
    ...facts.map(({ words, value }) => element("div", {}, element("dt", { text: words }), value)),
  );
  const disagree = element("p", {
    class: "said",
    hidden: true,
    text:
      "The presses disagree: they may " +
      "be of different things, or something was wrong at one of them.",
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
  const gone = (/** @type {Event} */ event) => {
    /** @type {HTMLElement} */ (event.target).closest("figure")?.setAttribute("hidden", "");
  };
  const cut = element("img", {
    class: "picture",
    alt: `Picture of target ${number}`,
    on: { error: gone },
    src: `/targets/${id}/picture`,
  });
  const code = element("img", {
    class: "qr",
    alt: "Code with the coordinate, to scan",
    on: { error: gone },
  });
  const figure = (/** @type {HTMLElement} */ image, /** @type {string} */ words) =>
    element("figure", {}, image, element("figcaption", { text: words }));
  const node = element(
    "div",
    { class: "pictures" },
    figure(cut, "as pressed"),
    figure(code, "scan: place"),
  );
  const update = () => {
    const source = `/targets/${id}/qr?clicks=${now().clicks}`;
    if (code.getAttribute("src") !== source) code.setAttribute("src", source);
  };
  return { node, update };
}

/** @param {() => Target} now @returns {Part} */
function actions(now) {
  const again = button("refine", "Press again", () => store.set({ refine: now().id }), {
    class: "operator-only",
    id: "refine",
    title: "Press on it once more: the presses are averaged",
  });
  const show = button("map", "On the map", () =>
    store.set({ tab: "map", shown: { id: now().id } }),
  );
  const gone = button("delete", "Delete", () => remove(now()), {
    class: "danger operator-only",
    id: "delete",
  });
  return { node: element("div", { class: "actions" }, again, show, gone), update: () => {} };
}
