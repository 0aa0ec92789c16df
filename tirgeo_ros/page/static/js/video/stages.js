// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** The videos of all aircraft: side by side where there is room, else the current one. */

import { byId } from "../shell/dom.js";
import { t } from "../shell/language.js";
import { toast } from "../shell/toast.js";
import { store } from "../store.js";
import { pressed } from "./clicks.js";
import { Stage } from "./stage.js";

const TELL_MS = 200;
const DRAWN_WITH = ["look", "layersOff", "labelsOff", "units", "theme", "targets"];

/** @type {Map<string, Stage>} */
const stages = new Map();
let wasLost = false; // the link
const wide = window.matchMedia("(min-width: 1000px)");

/** @param {string} id @returns {Stage | undefined} of an aircraft */
export function stageOf(id) {
  return stages.get(id);
}

/** Places all marks again, in every video: what covers these has changed. */
export function layMarks() {
  stages.forEach((stage) => stage.marks.layAll());
}

/** Builds a stage for each aircraft as soon as they are known. */
export function buildStages() {
  store.watch(["aircraft"], rebuild);
  store.watch(["current"], arrange);
  store.watch(DRAWN_WITH, () => stages.forEach((stage) => stage.draw()));
  store.watch(["still"], () => stages.forEach((stage) => stage.hold(store.get("still"))));
  store.watch(["link"], renew);
  wide.addEventListener("change", arrange);
  new ResizeObserver(layMarks).observe(byId("banner")); // it may come over an answer
  setInterval(() => stages.forEach((stage) => stage.tell()), TELL_MS);
}

/** Renews what asks for pictures as soon as a lost link is back. */
function renew() {
  const { phase } = store.get("link");
  if (wasLost && phase === "open") stages.forEach((stage) => stage.renew());
  wasLost = phase === "lost";
}

function rebuild() {
  /** @type {import("../store.js").Aircraft[]} */
  const aircraft = store.get("aircraft");
  for (const [id, stage] of stages) {
    if (aircraft.some((one) => one.id === id)) continue;
    stage.follow(false);
    stage.hold(false);
    stage.root.remove();
    stages.delete(id);
  }
  const beside = () => toast(t("press.beside"), { tone: "bad", milliseconds: 3000 });
  for (const one of aircraft.filter(({ id }) => !stages.has(id))) {
    const stage = new Stage(one, { pressed, beside });
    stage.hold(store.get("still"));
    stages.set(one.id, stage);
  }
  aircraft.forEach((one) => stages.get(one.id)?.call(one.name));
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
