// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Starts the page: the entrance, then all of its parts, then the connection. */

import { buildAlarm } from "./checks/alarm.js";
import { buildChecks } from "./checks/panel.js";
import { watchVerdicts } from "./checks/verdict.js";
import { enter } from "./link/entrance.js";
import { startLink } from "./link/state_link.js";
import { buildMap } from "./map/moving_map.js";
import { where } from "./map/where.js";
import { buildBar } from "./shell/bar.js";
import { listenToKeys } from "./shell/keys.js";
import { writeDocument } from "./shell/language.js";
import { keepSettings } from "./shell/settings.js";
import { buildTabs } from "./shell/tabs.js";
import { buildCard } from "./targets/card.js";
import { buildList } from "./targets/list.js";
import { buildLook } from "./video/look.js";
import { buildRewind } from "./video/rewind.js";
import { buildStages } from "./video/stages.js";
import { buildTools } from "./video/tools.js";

keepSettings();
writeDocument();
await enter();
buildBar();
buildTabs();
buildList();
buildCard();
buildChecks();
buildStages();
buildTools();
buildRewind();
buildLook();
buildMap(where);
buildAlarm();
watchVerdicts();
listenToKeys();
startLink();
