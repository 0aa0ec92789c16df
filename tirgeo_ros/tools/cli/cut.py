# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Cut a part out of a recorded flight.

Copies the messages of all topics, as they are, into a new bag (MCAP). The last message before the
part is written at its beginning for latched topics (origin, static transforms, robot description)
and for a calibration that was sent once. The filter aligns anew in a part: begin it 20 s earlier
if you need the poses of its first seconds.

example:
  tirgeo cut bags/sample/flight.mcap -o part.mcap --from 10 --to 20
"""

from __future__ import annotations

import argparse
import math
from contextlib import suppress
from typing import TYPE_CHECKING

from tirgeo_ros.tools.cli._verb import BAG, NEEDED, call, utc_time

if TYPE_CHECKING:
    from tirgeo_ros.tools.replay.cut import Instant

_MOST_S = 1e9  # 30 years: no flight is longer, and its nanoseconds are whole
_FROM = "begin, in seconds after the first message, or UTC as 2024-06-11T07:44:39"
_TO = "end, in the same forms; default: the end of the bag"


def instant(text: str) -> Instant:
    """Return seconds or a time, which is UTC without a zone; a type of option."""
    with suppress(ValueError):
        if 0 <= float(text) < _MOST_S:
            return float(text)
    with suppress(ValueError):
        return utc_time(text)
    raise argparse.ArgumentTypeError(f"{text}: not seconds, nor a time as 2024-06-11T07:44:39")


OPTIONS = (
    *BAG,
    ("-o --output", "OUT", "the new bag (.mcap)", NEEDED),
    ("--from", "T", _FROM, {"dest": "begin", "type": instant, "default": 0.0}),
    ("--to", "T", _TO, {"dest": "end", "type": instant, "default": math.inf}),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Cut the flight; return what was written."""
    from tirgeo_ros.tools.replay.cut import cut  # noqa: PLC0415 heavy

    return call(cut, args, "cutting, s")
