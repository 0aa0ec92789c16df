// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/**
 * The map of one frame, as the server sends it: a zlib stream of JSON and of varints. Plain
 * functions. All places are pixels of the full picture; (0, 0) is the middle of the first one.
 *
 * @typedef {object} Runs  rings, lines or marks: run k has the points starts[k] .. starts[k + 1] - 1
 * @property {Int32Array} layers  of each run
 * @property {Int32Array} values  of each run: flag of a ring, opacity of a line in quarters
 * @property {Int32Array} starts
 * @property {Float32Array} points  u, v, u, v, ...
 *
 * @typedef {object} Layer
 * @property {string} name
 * @property {string} line  "#rrggbb"
 * @property {number} width  px of a picture of 640 x 512
 * @property {string | null} fill
 * @property {number} fill_opacity
 *
 * @typedef {[text: string, u: number, v: number, layer: number, kind: number, halfU: number,
 *   halfV: number, uncertain: boolean]} Label  the most important first
 * @typedef {[u: number, v: number, major: number, minor: number, angle: number, layer: number,
 *   dotted: boolean]} MapEllipse
 * @typedef {[id: string, text: string, u: number, v: number, major: number, minor: number,
 *   angle: number]} TargetMark
 *
 * @typedef {object} Shapes
 * @property {[number, number]} size  of the full picture
 * @property {boolean} grey  a thermal picture, white hot
 * @property {[number, number] | null} celsius  of grey 0 and of grey 255
 * @property {Layer[]} layers
 * @property {Label[]} labels
 * @property {MapEllipse[]} ellipses
 * @property {TargetMark[]} targets
 * @property {[text: string, severity: number][]} notices
 * @property {[text: string, severity: number][]} status
 * @property {[left: number, right: number, row: number, metres: number] | null} bar
 * @property {number | null} heading_deg
 * @property {Runs} rings
 * @property {Runs} lines
 * @property {Runs} marks
 */

const VERSION = 1;
const STEPS_A_PIXEL = 4;
const LENGTH_BYTES = 4;

/**
 * Inflates a zlib stream.
 * @param {Uint8Array<ArrayBuffer>} zipped
 * @returns {Promise<Uint8Array<ArrayBuffer>>}
 */
export async function inflated(zipped) {
  const stream = new Blob([zipped]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * Reads inflated shapes. Throws an error if they are damaged or of another version.
 * @param {Uint8Array<ArrayBuffer>} bytes
 * @returns {Shapes}
 */
export function shapesOf(bytes) {
  const length = new DataView(bytes.buffer, bytes.byteOffset).getUint32(0, true);
  const numbersAt = LENGTH_BYTES + length;
  if (numbersAt > bytes.length) throw new RangeError("shapes are cut off");
  const head = JSON.parse(new TextDecoder().decode(bytes.subarray(LENGTH_BYTES, numbersAt)));
  if (head.v !== VERSION) throw new RangeError(`shapes of version ${head.v} are unknown`);
  return { ...head, ...geometryOf(new Varints(bytes, numbersAt)) };
}

/** @param {Varints} numbers @returns {{rings: Runs, lines: Runs, marks: Runs}} */
function geometryOf(numbers) {
  const rings = runsOf(numbers, true);
  const lines = runsOf(numbers, true);
  const marks = runsOf(numbers, false);
  const last = { u: 0, v: 0 };
  for (const { points } of [rings, lines, marks]) readPoints(numbers, points, last);
  return { rings, lines, marks };
}

/** @param {Varints} numbers @param {boolean} several  points a run may have  @returns {Runs} */
function runsOf(numbers, several) {
  const count = numbers.count();
  const layers = numbers.array(count);
  const values = several ? numbers.array(count) : new Int32Array(count);
  const counts = several ? numbers.array(count) : new Int32Array(count).fill(1);
  const starts = new Int32Array(count + 1);
  for (let k = 0; k < count; k += 1) starts[k + 1] = starts[k] + counts[k];
  const points = new Float32Array(2 * numbers.checked(starts[count]));
  return { layers, values, starts, points };
}

/**
 * Reads the steps from point to point, in quarters of a pixel.
 * @param {Varints} numbers @param {Float32Array} points @param {{u: number, v: number}} last
 */
function readPoints(numbers, points, last) {
  let { u, v } = last;
  for (let k = 0; k < points.length; k += 2) {
    u += numbers.signed();
    v += numbers.signed();
    points[k] = u / STEPS_A_PIXEL;
    points[k + 1] = v / STEPS_A_PIXEL;
  }
  Object.assign(last, { u, v });
}

/** Reads unsigned numbers of seven bits a byte, the low ones first. */
class Varints {
  /** @param {Uint8Array} bytes @param {number} at */
  constructor(bytes, at) {
    this.bytes = bytes;
    this.at = at;
  }

  /** @returns {number} below 2^32 */
  next() {
    const { bytes } = this;
    let byte = bytes[this.at++];
    if (byte < 0x80) return byte;
    let value = byte & 0x7f;
    for (let shift = 7; shift < 32; shift += 7) {
      byte = bytes[this.at++];
      value |= (byte & 0x7f) << shift;
      if (byte < 0x80) return value >>> 0;
    }
    throw new RangeError("shapes are damaged"); // undefined, after the end, is never below 0x80
  }

  /** @returns {number} a number of either sign, zigzag-coded */
  signed() {
    const value = this.next();
    return (value >>> 1) ^ -(value & 1);
  }

  /** @returns {number} of things that follow, of one byte each at least */
  count() {
    return this.checked(this.next());
  }

  /** @param {number} count @returns {number} the same, unless so many bytes cannot follow */
  checked(count) {
    if (count >= 0 && count <= this.bytes.length - this.at) return count;
    throw new RangeError("shapes are cut off");
  }

  /** @param {number} count @returns {Int32Array} */
  array(count) {
    const result = new Int32Array(count);
    for (let k = 0; k < count; k += 1) result[k] = this.next();
    return result;
  }
}
