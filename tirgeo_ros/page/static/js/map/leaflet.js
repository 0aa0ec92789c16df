/** Leaflet, which is a plain script that leaves `L` behind: taken from there in this one place. */

import "../../vendor/leaflet/leaflet.js";

export default /** @type {any} */ (globalThis).L;
