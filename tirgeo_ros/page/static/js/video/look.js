// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The panel of the picture: palette, tones, isotherm, and what is shown of the map. */

import { button, byId, element, setText } from "../shell/dom.js";
import { t } from "../shell/language.js";
import { flip, store } from "../store.js";
import { PLAIN } from "./look_values.js";
import { gradient, PALETTES } from "./palettes.js";
import { isGrey, isothermLevel } from "./picture.js";
import { stageOf } from "./stages.js";

const TELL_MS = 500;
const COLDEST = -40;
const HOTTEST = 400;

/** @typedef {import("./look_values.js").Look} Look */

const NAMES = {
  white_hot: t("look.white_hot"),
  black_hot: t("look.black_hot"),
  iron: t("look.iron"),
  rainbow: t("look.rainbow"),
  arctic: t("look.arctic"),
  lava: t("look.lava"),
};

/** Builds the panel; `looking` in the store opens it. */
export function buildLook() {
  const parts = [palettes(), tones(), isotherm(), map()];
  const panel = element(
    "section",
    { id: "look", "aria-label": t("look.part"), tabindex: "0", hidden: true },
    head(),
    ...parts.map(({ node }) => node),
  );
  byId("page").append(panel);
  const tell = () => parts.forEach((part) => part.tell());
  store.watch(["looking"], () => {
    panel.hidden = !store.get("looking");
    tell();
  });
  store.watch(["look", "layersOff", "labelsOff", "current"], tell);
  setInterval(() => store.get("looking") && tell(), TELL_MS);
}

/** @param {Partial<Look>} changes */
function change(changes) {
  store.set({ look: { ...store.get("look"), ...changes } });
}

/** @returns {import("./message.js").Frame | null} that the selected aircraft's stage shows */
function frame() {
  return stageOf(store.get("current"))?.frame ?? null;
}

/** @returns {boolean} whether palette and isotherm can be applied */
function grey() {
  const shown = frame();
  return !shown || isGrey(shown);
}

function head() {
  const plain = () => store.set({ look: PLAIN, layersOff: [], labelsOff: [] });
  return element(
    "header",
    { class: "list-head" },
    element("h2", { text: t("look.title") }),
    button("undo", t("look.plain"), plain, { id: "look-plain" }),
    button("close", "", () => store.set({ looking: false }), {
      label: t("shell.close"),
      class: "plain",
    }),
  );
}

/** @typedef {{node: HTMLElement, tell: () => void}} Part */

/** @returns {Part} */
function palettes() {
  const buttons = PALETTES.map((palette) =>
    element(
      "button",
      { type: "button", role: "radio", on: { click: () => change({ palette }) } },
      painted("strip", gradient(palette)),
      element("span", { text: NAMES[palette] }),
    ),
  );
  const why = element("p", { class: "quiet", text: "" });
  const group = element("div", {
    class: "palettes",
    role: "radiogroup",
    "aria-label": t("look.palette"),
  });
  group.append(...buttons);
  const tell = () => {
    const usable = grey();
    setText(why, usable ? "" : t("look.own_colours"));
    why.hidden = usable;
    PALETTES.forEach((palette, index) => {
      buttons[index].setAttribute("aria-checked", String(store.get("look").palette === palette));
      buttons[index].disabled = !usable;
    });
  };
  return { node: element("div", { class: "look-part" }, group, why), tell };
}

/**
 * @param {string} words @param {keyof Look} name  of the value @param {number[]} range
 * @param {(value: number) => string} text
 */
function slider(words, name, [min, max, step], text) {
  const input = element("input", { type: "range", min, max, step, "aria-label": words });
  input.addEventListener("input", () => change({ [name]: Number(input.value) }));
  const value = element("span", { class: "value" });
  const label = element("span", { text: words });
  const tell = () => {
    const number = store.get("look")[name];
    if (Number(input.value) !== number) input.value = String(number);
    setText(value, text(number));
    input.setAttribute("aria-valuetext", text(number));
  };
  return { node: element("div", { class: "slider" }, label, value, input), input, tell };
}

/** @param {number} value */
const signed = (value) => (value > 0 ? `+${value}` : String(value).replace("-", "−"));
/** @param {number} value */
const percent = (value) => `${value} %`;

/** @returns {Part} */
function tones() {
  const sliders = [
    slider(t("look.brightness"), "brightness", [-100, 100, 1], signed),
    slider(t("look.contrast"), "contrast", [-100, 100, 1], signed),
    slider(t("look.local"), "local", [0, 100, 1], percent),
    slider(t("look.map"), "opacity", [0, 100, 5], percent),
  ];
  const node = element("div", { class: "look-part" }, ...sliders.map((one) => one.node));
  return { node, tell: () => sliders.forEach((one) => one.tell()) };
}

/** @returns {Part} */
function isotherm() {
  const toggle = switchOf(t("look.isotherm"), () =>
    change({ isotherm: !store.get("look").isotherm }),
  );
  const degrees = slider(
    t("look.from"),
    "degrees",
    [COLDEST, HOTTEST, 0.5],
    (value) => `${value} °C`,
  );
  const share = slider(t("look.from"), "percent", [0, 100, 1], percent);
  const why = element("p", { class: "quiet", text: "" });
  const node = element("div", { class: "look-part" }, toggle, degrees.node, share.node, why);
  const tell = () => {
    const on = store.get("look").isotherm;
    const shown = frame();
    const celsius = shown?.shapes?.celsius;
    if (celsius) fit(degrees.input, celsius);
    toggle.setAttribute("aria-checked", String(on));
    toggle.disabled = !grey();
    degrees.node.hidden = !on || !grey() || !celsius;
    share.node.hidden = !on || !grey() || Boolean(celsius);
    why.hidden = !shown || degrees.node.hidden || isothermLevel(shown, store.get("look")) < 256;
    setText(why, t("look.above_scale", { degrees: celsius?.[1].toFixed(1) ?? "" }));
    degrees.tell();
    share.tell();
  };
  return { node, tell };
}

/**
 * Lets a slider run over the scale of the picture; the value that was set stays within it.
 * @param {HTMLInputElement} input @param {[number, number]} celsius
 */
function fit(input, [cold, hot]) {
  const value = store.get("look").degrees;
  input.min = String(Math.floor(Math.min(cold, value)));
  input.max = String(Math.ceil(Math.max(hot, value)));
}

/** @param {string} words @param {() => void} pressed @param {string} label  default: the words */
function switchOf(words, pressed, label = words) {
  return element(
    "button",
    {
      type: "button",
      class: "switch",
      role: "switch",
      "aria-label": label,
      on: { click: pressed },
    },
    element("span", { text: words }),
  );
}

/** @returns {Part} the layers, each and its labels on or off */
function map() {
  const node = element("div", { class: "look-part layers" });
  let built = "";
  const tell = () => {
    const layers = frame()?.shapes?.layers ?? [];
    const wanted = JSON.stringify([layers, store.get("layersOff"), store.get("labelsOff")]);
    if (wanted === built) return;
    built = wanted;
    const focused = node.contains(document.activeElement) ? focusedLabel() : null;
    node.replaceChildren(...layers.map(layerRow));
    node.hidden = !layers.length;
    if (focused) node.querySelector(`[aria-label="${CSS.escape(focused)}"]`)?.focus();
  };
  return { node, tell };
}

/** @returns {string | null} */
function focusedLabel() {
  return document.activeElement?.getAttribute("aria-label") ?? null;
}

/** @param {string} name  of the class @param {string} background @returns {HTMLElement} */
function painted(name, background) {
  const node = element("span", { class: name });
  node.style.background = background; // a style attribute is against the page's policy
  return node;
}

/** @param {import("./shapes.js").Layer} layer */
function layerRow({ name, line }) {
  const words = name || t("layers.map");
  const layer = switchOf(words, () => flip("layersOff", name));
  const labels = switchOf(
    t("look.labels"),
    () => flip("labelsOff", name),
    t("look.labels_of", { layer: words }),
  );
  layer.prepend(painted("swatch", line));
  layer.setAttribute("aria-checked", String(!store.get("layersOff").includes(name)));
  labels.setAttribute("aria-checked", String(!store.get("labelsOff").includes(name)));
  return element("div", { class: "layer-row" }, layer, labels);
}
