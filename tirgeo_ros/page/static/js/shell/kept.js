// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** A cache of what is made of each thing: it is made again only if the thing has changed. */

/**
 * @template {{id: string}} Thing
 * @template Made
 */
export class Kept {
  /**
   * @param {(thing: Thing) => Made} make
   * @param {(made: Made) => void} drop  removes what was made of a thing that has changed or gone
   */
  constructor(make, drop) {
    this.make = make;
    this.drop = drop;
    /** @type {Map<string, {thing: Thing, made: Made}>} */
    this.entries = new Map();
  }

  /**
   * @param {Thing[]} things
   * @returns {Made[]} in the same order
   */
  of(things) {
    const before = this.entries;
    this.entries = new Map(things.map((thing) => [thing.id, this.entry(thing, before)]));
    for (const [id, entry] of before) {
      if (this.entries.get(id) !== entry) this.drop(entry.made);
    }
    return [...this.entries.values()].map(({ made }) => made);
  }

  /** @param {Thing} thing @param {Map<string, {thing: Thing, made: Made}>} before */
  entry(thing, before) {
    const entry = before.get(thing.id);
    if (!entry || !same(entry.thing, thing)) return { thing, made: this.make(thing) };
    entry.thing = thing;
    return entry;
  }
}

/** @param {any} one @param {any} other */
function same(one, other) {
  const alike = Object.keys({ ...one, ...other }).every((key) => one[key] === other[key]);
  return alike || JSON.stringify(one) === JSON.stringify(other); // deep, but much slower
}
