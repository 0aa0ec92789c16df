// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The videos of all aircraft: side by side where there is room, else the current one. */

import { byId } from "../shell/dom.js";
import { toast } from "../shell/toast.js";
import { store } from "../store.js";
import { pressed } from "./clicks.js";
import { Stage } from "./stage.js";

const TELL_MS = 200;

/** @type {Map<string, Stage>} */
const stages = new Map();
const wide = window.matchMedia("(min-width: 1000px)");

/** @param {string} id @returns {Stage | undefined} of an aircraft */
export function stageOf(id) {
  return stages.get(id);
}

/** Builds a stage for each aircraft as soon as they are known. */
export function buildStages() {
  store.watch(["aircraft"], rebuild);
  store.watch(["current"], arrange);
  store.watch(["still"], () => stages.forEach((stage) => stage.hold(store.get("still"))));
  wide.addEventListener("change", arrange);
  setInterval(() => stages.forEach((stage) => stage.tell()), TELL_MS);
}

function rebuild() {
  /** @type {import("../store.js").Aircraft[]} */
  const aircraft = store.get("aircraft");
  for (const [id, stage] of stages) {
    if (aircraft.some((one) => one.id === id)) continue;
    stage.follow(false);
    stage.root.remove();
    stages.delete(id);
  }
  const beside = () => toast("There is no picture there.", { tone: "bad", milliseconds: 3000 });
  for (const one of aircraft.filter(({ id }) => !stages.has(id))) {
    stages.set(one.id, new Stage(one, { pressed, beside }));
  }
  byId("stages").replaceChildren(...aircraft.map(({ id }) => stages.get(id)?.root ?? ""));
  arrange();
}

function arrange() {
  const several = stages.size > 1;
  byId("stages").dataset.tiles = String(several && wide.matches ? stages.size : 1);
  for (const [id, stage] of stages) {
    const isCurrent = id === store.get("current");
    stage.root.classList.toggle("current", several && isCurrent);
    stage.follow(isCurrent || wide.matches);
  }
}
