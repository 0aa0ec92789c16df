// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Leaflet, a plain script that sets the global `L`: only this module reads that. */

import "../../vendor/leaflet/leaflet.js";

export default /** @type {any} */ (globalThis).L;
