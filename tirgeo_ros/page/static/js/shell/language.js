// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The page's words in the language of this screen: all that people read goes through `t`. */

import english from "../words/en.js";
import { keptSettings } from "./settings.js";

/** The languages that have a dictionary in js/words, each with its own name. */
export const LANGUAGES = { de: "Deutsch", en: "English", es: "Español", fr: "Français" };

const SAID = "said."; // begins the keys of the server's texts
const REST = "{rest}"; // stands for the end of a server's text, whatever it is

/** The language of this screen: the one chosen in the menu, else the browser's. */
export const language = chosen();
/** @type {Record<string, string>} */
const words = await dictionary();
const openTexts = Object.keys(words).filter((key) => key.startsWith(SAID) && key.endsWith(REST));

/** @returns {string} */
function chosen() {
  const wanted = [keptSettings().language, ...navigator.languages];
  const known = wanted.map((one) => String(one ?? "").slice(0, 2));
  return known.find((one) => one in LANGUAGES) ?? "en";
}

/** @returns {Promise<Record<string, string>>} English if the other file does not come */
async function dictionary() {
  if (language === "en") return english;
  return import(`../words/${language}.js`).then(
    (file) => file.default,
    () => english,
  );
}

/**
 * Returns the words of a key; `{name}` in them becomes the value of that name.
 * @param {string} key  e.g. "measure.first"
 * @param {Record<string, string | number>} values
 * @returns {string}
 */
export function t(key, values = {}) {
  const text = words[key] ?? /** @type {Record<string, string>} */ (english)[key] ?? key;
  return filled(text, values);
}

/**
 * Returns a text of the server in this language. The dictionaries have its fixed texts under
 * "said." and the English words, with {0}, {1} for the numbers and {rest} for an open end. What
 * the dictionary lacks stays as it is; parts between colons and semicolons are looked up alone.
 * @param {string} text
 * @returns {string}
 */
export function said(text) {
  /** @type {Record<string, string>} */
  const numbers = {};
  let count = 0;
  const form = text.replace(/\d+(?:\.\d+)?/g, (number) => {
    numbers[count] = number;
    return `{${count++}}`;
  });
  const own = words[SAID + form];
  return own ? filled(own, numbers) : withOpenEnd(text);
}

/** @param {string} text */
function withOpenEnd(text) {
  const key = openTexts.find((one) => text.startsWith(one.slice(SAID.length, -REST.length)));
  if (!key) return inParts(text);
  return filled(words[key], { rest: text.slice(key.length - SAID.length - REST.length) });
}

/** @param {string} text  e.g. "NO MAP: no pose at this frame": a part and what follows */
function inParts(text) {
  const [whole, first, mark, more] = /^(.+?)([:;] )(.+)$/s.exec(text) ?? [];
  return whole ? `${said(first)}${mark}${said(more)}` : text;
}

/** @param {string} text @param {Record<string, string | number>} values */
function filled(text, values) {
  return text.replace(/\{(\w+)\}/g, (place, name) => String(values[name] ?? place));
}

/** Writes the words of index.html: an element names the keys of its text and of its label. */
export function writeDocument() {
  document.documentElement.lang = language;
  for (const node of document.querySelectorAll("[data-words]")) {
    node.textContent = t(node.getAttribute("data-words") ?? "");
  }
  for (const node of document.querySelectorAll("[data-label]")) {
    node.setAttribute("aria-label", t(node.getAttribute("data-label") ?? ""));
  }
}
