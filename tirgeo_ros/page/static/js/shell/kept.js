/** What was made of each thing: made again only where the thing has changed. */

/**
 * @template {{id: string}} Thing
 * @template Made
 */
export class Kept {
  /**
   * @param {(thing: Thing) => Made} make
   * @param {(made: Made) => void} drop  of what has changed or gone
   */
  constructor(make, drop) {
    this.make = make;
    this.drop = drop;
    /** @type {Map<string, {thing: Thing, made: Made}>} */
    this.known = new Map();
  }

  /**
   * @param {Thing[]} things
   * @returns {Made[]} in the same order
   */
  of(things) {
    const before = this.known;
    this.known = new Map(things.map((thing) => [thing.id, this.entry(thing, before)]));
    for (const [id, entry] of before) {
      if (this.known.get(id) !== entry) this.drop(entry.made);
    }
    return [...this.known.values()].map(({ made }) => made);
  }

  /** @param {Thing} thing @param {Map<string, {thing: Thing, made: Made}>} before */
  entry(thing, before) {
    const known = before.get(thing.id);
    if (!known || !same(known.thing, thing)) return { thing, made: this.make(thing) };
    known.thing = thing;
    return known;
  }
}

/** @param {any} one @param {any} other */
function same(one, other) {
  const alike = Object.keys({ ...one, ...other }).every((key) => one[key] === other[key]);
  return alike || JSON.stringify(one) === JSON.stringify(other); // much slower
}
