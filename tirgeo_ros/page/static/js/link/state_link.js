// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The connection for states, targets and requests: messages received go into the store. */

import { store } from "../store.js";
import { enter } from "./entrance.js";
import { Requests } from "./requests.js";
import { RetryingSocket } from "./retrying_socket.js";

const SILENCE_MS = 1500; // then a request tests whether the server answers
const DEAD_MS = 4500;
const QUICK_MS = 900; // an entrance that takes longer had to wait for the server or for a token

const socket = new RetryingSocket("/state", { opened, received, lost });
const requests = new Requests((text) => {
  if (!socket.open || store.get("link").phase !== "open") return false;
  socket.send(text);
  return true;
});
let receivedAt = 0;
/** @type {Map<string, import("../store.js").Target> | null} a list with parts to come */
let coming = null;
/** @type {Promise<void> | null} */
let entering = null;

/** Opens the connection, and keeps it open. */
export function startLink() {
  socket.start();
  setInterval(watchSilence, 1000);
  window.addEventListener("beforeunload", (event) => {
    if (requests.unconfirmed) event.preventDefault(); // the browser asks whether to leave
  });
}

/** @type {typeof requests.ask} */
export function ask(type, fields, options) {
  return requests.ask(type, fields, options);
}

function opened() {
  receivedAt = performance.now(); // the silence before was another connection's
}

/** @param {string} text */
function received(text) {
  receivedAt = performance.now();
  const message = JSON.parse(text);
  if (message.type === "hello") welcomed(message);
  else if (message.type === "targets") targetsOf(message);
  else if (message.type === "state") stateOf(message);
  else if (message.type === "answer") requests.answered(message);
}

/** @param {any} hello */
function welcomed({ role, aircraft, kinds, colours, statuses, tiles, most }) {
  const kept = aircraft.some((/** @type {any} */ one) => one.id === store.get("current"));
  const current = kept ? store.get("current") : (aircraft[0]?.id ?? "");
  const link = { phase: "open", retryAt: 0 };
  const kind = kinds.includes(store.get("kind")) ? store.get("kind") : kinds[0]; // was remembered
  store.set({ role, aircraft, kinds, kind, colours, statuses, tiles, most, current, link });
  requests.reconnected();
}

/** @param {any} message  a part of all targets, begun by `whole`, or of those that changed */
function targetsOf({ whole, more, targets, gone }) {
  if (whole) coming = new Map();
  coming ??= new Map(store.get("targets").map((/** @type {any} */ one) => [one.id, one]));
  for (const id of gone) coming.delete(id);
  for (const target of targets) coming.set(target.id, target);
  if (more) return; // a list that shrinks would close the card
  store.set({ targets: [...coming.values()].sort((one, other) => one.number - other.number) });
  coming = null;
}

/** @param {any} message */
function stateOf(message) {
  const { aircraft, track = [], track_from: from = 0 } = message;
  const before = store.get("tracks")[aircraft] ?? [];
  const changes = { states: { ...store.get("states"), [aircraft]: message } };
  if (track.length) {
    const whole = [...before.slice(0, from), ...track]; // from 0: the server began again
    Object.assign(changes, { tracks: { ...store.get("tracks"), [aircraft]: whole } });
  }
  store.set(changes);
}

/** @param {number} retryAt */
function lost(retryAt) {
  // A server that was started again may have other tokens: then the entrance asks for one.
  const lostAt = performance.now();
  entering ??= enter().finally(() => {
    entering = null;
    if (performance.now() - lostAt > QUICK_MS) socket.retry(); // else the wait is for others
  });
  requests.disconnected();
  store.set({ link: { phase: "lost", retryAt }, states: {} });
}

/** Finds connections that are dead without an error, as when the network is gone. */
function watchSilence() {
  if (!socket.open) return;
  const silence = performance.now() - receivedAt;
  if (silence > DEAD_MS) socket.restart();
  else if (silence > SILENCE_MS) requests.ask("measure", { from: [0, 0], to: [0, 0] });
}
