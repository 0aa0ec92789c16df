// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Makes elements. Text is always set as text: no module sets innerHTML. */

const SVG = "http://www.w3.org/2000/svg";

/**
 * @typedef {object} Properties
 * @property {string} [class]
 * @property {string} [text]
 * @property {Record<string, (event: any) => void>} [on]  listeners by event
 * @property {Record<string, string>} [data]
 */

/**
 * Makes an element; other names than those of Properties are set as attributes (true: no value).
 * @param {string} tag
 * @param {Properties & Record<string, any>} properties
 * @param {...(Node | string | null)} children
 * @returns {any}
 */
export function element(tag, properties = {}, ...children) {
  const node = document.createElement(tag);
  const { class: classes, text, on = {}, data = {}, ...attributes } = properties;
  if (classes) node.className = classes;
  if (text !== undefined) node.textContent = text;
  for (const [event, listener] of Object.entries(on)) node.addEventListener(event, listener);
  Object.assign(node.dataset, data);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== false && value !== null) node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children.filter((child) => child !== null));
  return node;
}

/**
 * @param {string} name  of a symbol in index.html, without "icon-"
 * @returns {SVGElement}
 */
export function icon(name) {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  const use = document.createElementNS(SVG, "use");
  use.setAttribute("href", `#icon-${name}`);
  svg.append(use);
  return svg;
}

/**
 * Changes the symbol of an icon that `icon` made.
 * @param {Element} holder  the icon's parent
 * @param {string} name
 */
export function setIcon(holder, name) {
  holder.querySelector("use")?.setAttribute("href", `#icon-${name}`);
}

/**
 * Makes a button with an icon and words; `label` is what is read aloud (default: the words).
 * @param {string} iconName
 * @param {string} words
 * @param {(event: any) => void} pressed
 * @param {Properties & Record<string, any>} properties
 * @returns {HTMLButtonElement}
 */
export function button(iconName, words, pressed, { label, on = {}, ...properties } = {}) {
  const all = { type: "button", title: label, "aria-label": label ?? null, ...properties };
  if (!label) delete all.title;
  const listeners = { ...on, click: pressed };
  return element(
    "button",
    { ...all, on: listeners },
    iconName ? icon(iconName) : null,
    words ? element("span", { class: "words", text: words }) : null,
  );
}

/**
 * Sets the text only if it differs, so that the same text is not laid out or read aloud again.
 * @param {Element | null} node
 * @param {string} text
 */
export function setText(node, text) {
  if (node && node.textContent !== text) node.textContent = text;
}

/**
 * Hides a node after `milliseconds`, unless this was called for it again meanwhile.
 * @param {HTMLElement} node
 * @param {number} milliseconds
 */
export function hideAfter(node, milliseconds) {
  const mine = String(Number(node.dataset.turn ?? 0) + 1);
  node.dataset.turn = mine;
  setTimeout(() => {
    if (node.dataset.turn === mine) node.hidden = true;
  }, milliseconds);
}

/**
 * @param {string} id
 * @returns {any} the element of index.html
 */
export function byId(id) {
  return document.getElementById(id);
}
