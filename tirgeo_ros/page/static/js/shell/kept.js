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
    /** @type {Map<string, {key: string, made: Made}>} */
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

  /** @param {Thing} thing @param {Map<string, {key: string, made: Made}>} before */
  entry(thing, before) {
    const key = JSON.stringify(thing);
    const known = before.get(thing.id);
    return known?.key === key ? known : { key, made: this.make(thing) };
  }
}
