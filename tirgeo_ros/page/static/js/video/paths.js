// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Makes paths of a frame's shapes, in pixels of the picture: one for each pen. */

const QUARTERS = 4; // opacity of an opaque line

/**
 * @typedef {import("./shapes.js").Runs} Runs
 * @typedef {{path: Path2D, rule: CanvasFillRule}} Area
 * @typedef {{opacity: number, path: Path2D}} Stroke
 * @typedef {{skip: number, areas: Area[][], strokes: Stroke[][]}} Paths  by layer
 */

/** @type {WeakMap<import("./shapes.js").Shapes, Paths>} */
const kept = new WeakMap();

/**
 * Returns the paths of shapes; they are made once for a frame, however often it is drawn.
 * @param {import("./shapes.js").Shapes} shapes
 * @param {number} skip  px: a vertex nearer than this to the last one is left out
 * @returns {Paths}
 */
export function pathsOf(shapes, skip) {
  const before = kept.get(shapes);
  if (before?.skip === skip) return before;
  const count = shapes.layers.length;
  const made = {
    skip,
    areas: areasOf(shapes.rings, count, skip),
    strokes: strokesOf(shapes.lines, count, skip),
  };
  kept.set(shapes, made);
  return made;
}

/** @param {Runs} lines @param {number} layers @param {number} skip @returns {Stroke[][]} */
function strokesOf(lines, layers, skip) {
  /** @type {(Path2D | undefined)[]} */
  const paths = new Array(layers * QUARTERS);
  for (let k = 0; k < lines.layers.length; k += 1) {
    if (!lines.values[k]) continue; // not to be seen
    const pen = lines.layers[k] * QUARTERS + lines.values[k] - 1;
    addRun((paths[pen] ??= new Path2D()), lines, k, skip);
  }
  const strokes = (/** @type {number} */ layer) =>
    paths
      .slice(layer * QUARTERS, (layer + 1) * QUARTERS)
      .flatMap((path, index) => (path ? [{ opacity: (index + 1) / QUARTERS, path }] : []));
  return Array.from({ length: layers }, (_, layer) => strokes(layer));
}

/**
 * Areas of one ring share a path, and turn the same way, so that they cover as one where they
 * overlap. An area with holes is a path of its own.
 * @param {Runs} rings @param {number} layers @param {number} skip @returns {Area[][]}
 */
function areasOf(rings, layers, skip) {
  /** @type {Area[][]} */
  const areas = Array.from({ length: layers }, () => []);
  /** @type {Map<number, Path2D>} */
  const simple = new Map();
  const { layers: layer, values: flags } = rings;
  for (let k = 0; k < layer.length; k += 1) {
    const follows = Boolean(flags[k]);
    const alone = !follows && !flags[k + 1];
    const rule = alone ? "nonzero" : "evenodd";
    if (!follows && !(alone && simple.has(layer[k]))) {
      areas[layer[k]]?.push({ path: new Path2D(), rule });
      if (alone) simple.set(layer[k], areas[layer[k]].at(-1)?.path ?? new Path2D());
    }
    const path = alone ? simple.get(layer[k]) : areas[layer[k]].at(-1)?.path;
    if (path) addRing(path, rings, k, skip, alone);
  }
  return areas;
}

/**
 * @param {Path2D} path @param {Runs} runs @param {number} k  which one @param {number} skip  px
 */
function addRun(path, { points, starts }, k, skip) {
  const last = 2 * starts[k + 1] - 2;
  let at = 2 * starts[k];
  if (at > last) return;
  let [u, v] = [points[at], points[at + 1]];
  path.moveTo(u, v);
  for (at += 2; at <= last; at += 2) {
    const [nextU, nextV] = [points[at], points[at + 1]];
    const near = Math.abs(nextU - u) < skip && Math.abs(nextV - v) < skip;
    if (near && at < last) continue;
    path.lineTo(nextU, nextV);
    u = nextU;
    v = nextV;
  }
}

/**
 * @param {Path2D} path @param {Runs} rings @param {number} k @param {number} skip
 * @param {boolean} turned  to a positive area
 */
function addRing(path, rings, k, skip, turned) {
  const points = rings.points.subarray(2 * rings.starts[k], 2 * rings.starts[k + 1]);
  const ring = turned && twiceArea(points) < 0 ? backwards(points) : points;
  addRun(path, { ...rings, points: ring, starts: Int32Array.of(0, ring.length / 2) }, 0, skip);
  path.closePath();
}

/** @param {Float32Array} points @returns {number} positive if the ring turns from u towards v */
function twiceArea(points) {
  let sum = 0;
  for (let k = 0, last = points.length - 2; k < points.length; last = k, k += 2) {
    sum += points[last] * points[k + 1] - points[k] * points[last + 1];
  }
  return sum;
}

/** @param {Float32Array} points @returns {Float32Array} */
function backwards(points) {
  const result = new Float32Array(points.length);
  for (let k = 0; k < points.length; k += 2) {
    result[k] = points[points.length - 2 - k];
    result[k + 1] = points[points.length - 1 - k];
  }
  return result;
}
