// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** One message of the video: a picture, with the map of the same frame if it has one. */

import { inflated, shapesOf } from "./shapes.js";

const HEADER_BYTES = 28;

/**
 * @typedef {object} Frame
 * @property {string} stampNs  a 64-bit number, as text
 * @property {number} number
 * @property {number} width  of the full picture; the bitmap may be smaller
 * @property {number} height
 * @property {ImageBitmap} bitmap
 * @property {import("./shapes.js").Shapes | null} shapes  null: the picture has no map
 * @property {number} decodeMs  script's time for the shapes
 */

/**
 * Reads the 28 bytes before each picture: u64 stamp, u64 sent, u32 number, u16 width, u16 height,
 * u32 length of the shapes.
 * @param {ArrayBuffer} data
 */
export function headerOf(data) {
  const view = new DataView(data, 0, HEADER_BYTES);
  return {
    stampNs: view.getBigUint64(0, true).toString(),
    number: view.getUint32(16, true),
    width: view.getUint16(20, true),
    height: view.getUint16(22, true),
    shapesBytes: view.getUint32(24, true),
  };
}

/**
 * Decodes picture and map. Throws an error if either is damaged: a picture without the map that
 * belongs to it would hide that there is one.
 * @param {ArrayBuffer} data
 * @returns {Promise<Frame>}
 */
export async function frameOf(data) {
  const { shapesBytes, ...header } = headerOf(data);
  const jpeg = new Uint8Array(data, HEADER_BYTES + shapesBytes);
  const [bitmap, zipped] = await Promise.all([
    createImageBitmap(new Blob([jpeg], { type: "image/jpeg" })),
    shapesBytes ? inflated(new Uint8Array(data, HEADER_BYTES, shapesBytes)) : null,
  ]);
  const begin = performance.now();
  const shapes = zipped && shapesOf(zipped);
  return { ...header, bitmap, shapes, decodeMs: performance.now() - begin };
}
