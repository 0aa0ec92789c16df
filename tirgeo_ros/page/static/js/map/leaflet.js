/** Leaflet, a plain script that sets the global `L`: only this module reads that. */

import "../../vendor/leaflet/leaflet.js";

export default /** @type {any} */ (globalThis).L;
