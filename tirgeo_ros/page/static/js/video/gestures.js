// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Fingers, mouse and wheel on the video: a press, however long, a pan, a pinch. */

const SLOP_PX = 14; // a gloved finger rolls by some millimetres

/**
 * @typedef {object} Gestures
 * @property {() => any} down  called when the press begins; its result goes to `press`
 * @property {(x: number, y: number, down: any) => void} press
 * @property {(dx: number, dy: number) => void} pan
 * @property {(factor: number, x: number, y: number) => void} zoom
 */

/**
 * Listens to an element. Places are CSS pixels from its left upper corner.
 * @param {HTMLElement} surface
 * @param {Gestures} gestures
 */
export function listen(surface, gestures) {
  /** @type {Map<number, {x: number, y: number}>} */
  const fingers = new Map();
  /** @type {{x: number, y: number, down: any} | null} */
  let press = null;

  const place = (/** @type {MouseEvent} */ event) => {
    const box = surface.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  };

  surface.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    if (event.isPrimary) fingers.clear(); // the page may not have been told that one was lifted
    surface.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, place(event));
    press = fingers.size === 1 ? { ...place(event), down: gestures.down() } : null;
  });

  surface.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const now = place(event);
    if (fingers.size === 2) pinch(event.pointerId, before, now);
    if (press && Math.hypot(now.x - press.x, now.y - press.y) < SLOP_PX) return;
    press = null;
    fingers.set(event.pointerId, now);
    if (fingers.size === 1) gestures.pan(now.x - before.x, now.y - before.y);
  });

  /**
   * @param {number} id
   * @param {{x: number, y: number}} before
   * @param {{x: number, y: number}} now
   */
  function pinch(id, before, now) {
    const other = [...fingers].find(([key]) => key !== id)?.[1];
    if (!other) return;
    const [x, y] = [(now.x + other.x) / 2, (now.y + other.y) / 2];
    const apart = (/** @type {{x: number, y: number}} */ finger) =>
      Math.max(Math.hypot(finger.x - other.x, finger.y - other.y), 1);
    gestures.pan((now.x - before.x) / 2, (now.y - before.y) / 2);
    gestures.zoom(apart(now) / apart(before), x, y);
  }

  const up = (/** @type {PointerEvent} */ event) => {
    fingers.delete(event.pointerId);
    const pressed = press;
    press = null;
    if (pressed && event.type === "pointerup") gestures.press(pressed.x, pressed.y, pressed.down);
  };
  surface.addEventListener("pointerup", up);
  surface.addEventListener("pointercancel", up);
  surface.addEventListener("contextmenu", (event) => event.preventDefault()); // of a long press

  surface.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const { x, y } = place(event);
      gestures.zoom(Math.exp(-event.deltaY / (event.deltaMode ? 20 : 400)), x, y);
    },
    { passive: false },
  );
}
