// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Colours for grey thermal pictures: the same palettes as the overlay's. Plain functions. */

/** Sixteen colours from cold to hot, "rrggbb"; between them the colours are interpolated. */
const COLOURS = {
  white_hot: "000000 ffffff",
  black_hot: "ffffff 000000",
  iron:
    "000004 0c0826 240c4f 420a68 5d126e 781c6d 932667 ae305c " +
    "c73e4c dd513a ed6925 f8850f fca50a fac62d f2e661 fcffa4",
  rainbow:
    "30123b 4143a7 4771e9 3e9bfe 22c5e2 1ae4b6 46f884 88ff4e " +
    "b9f635 e1dd37 faba39 fd8d27 f05b12 d63506 af1801 7a0403",
  arctic:
    "00224e 002e6c 1e3a6f 35456c 47516c 575d6d 666970 757575 " +
    "848279 948e77 a59c74 b7a96e c8b866 dbc75a eed649 fee838",
  lava:
    "000000 2a0000 550000 800000 aa0000 d40000 fd0200 ff2a00 " +
    "ff5500 ff8000 ffaa00 ffd400 fffd05 ffff55 ffffaa ffffff",
};

/** What is above the isotherm, from just above to hottest: not in the grey of the rest. */
const HOT = "ff8c00 ffb000 ffe000 ffff60";

/** @typedef {keyof typeof COLOURS} Palette */

export const PALETTES = /** @type {Palette[]} */ (Object.keys(COLOURS));

/** @param {string} colours @param {number} share  0 to 1 @returns {number[]} red, green, blue */
function colourAt(colours, share) {
  const all = colours.split(" ");
  const place = share * (all.length - 1);
  const below = Math.min(Math.floor(place), all.length - 2);
  const part = place - below;
  const [low, high] = [all[below], all[below + 1]].map((text) => parseInt(text, 16));
  return [16, 8, 0].map((shift) => {
    const [from, to] = [(low >> shift) & 0xff, (high >> shift) & 0xff];
    return Math.round(from + part * (to - from));
  });
}

/** @param {Palette} palette @returns {string} of CSS: a strip from cold to hot */
export function gradient(palette) {
  const colours = COLOURS[palette].split(" ").map((colour) => `#${colour}`);
  return `linear-gradient(90deg, ${colours.join(", ")})`;
}

/**
 * @param {Palette} palette
 * @param {(grey: number) => number} tone  0 to 255 of 0 to 255
 * @returns {Uint32Array} the pixel of ImageData for each grey value
 */
export function table(palette, tone) {
  return pixelsOf((grey) => colourAt(COLOURS[palette] ?? COLOURS.white_hot, tone(grey) / 255));
}

/** @param {number} level  grey value @returns {Uint32Array} for grey values from the level on */
export function hotTable(level) {
  const span = Math.max(255 - level, 1);
  return pixelsOf((grey) => colourAt(HOT, Math.min(Math.max((grey - level) / span, 0), 1)));
}

/** @param {(grey: number) => number[]} colour @returns {Uint32Array} */
function pixelsOf(colour) {
  const bytes = new Uint8Array(4 * 256);
  for (let grey = 0; grey < 256; grey += 1) bytes.set([...colour(grey), 255], 4 * grey);
  return new Uint32Array(bytes.buffer);
}
