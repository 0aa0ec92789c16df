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
"""Print the frames of a capture of the aircraft's serial port.

Prints one JSON object for each frame on stdout (--json or not): offset, header, kind and contents,
with raw and SI values; fields that cannot be read are empty, NaN and infinities are null. Prints
one line of counts on stderr. Bytes outside frames are skipped and counted, because a capture may
begin and end within a frame, and a cable may lose bytes. The exit code is 0 if there is a frame,
else 1.

--packages tells the contents of the subscription packages; by default they are the usual five of
DJI's ROS wrapper.

example:
  tirgeo dump capture.bin | head -3

--packages takes
  packages:
    0:                       # the package's id
      rate_hz: 5
      with_timestamp: true
      topics: [RTK_POSITION, RTK_YAW]   # in the order of the request
"""

from __future__ import annotations

import argparse
import json
import sys

from tirgeo_ros.tools.cli._verb import WORD, Option
from tirgeo_ros.tools.presentation.results import plain

#: Options for captures, which ``import`` has too.
CAPTURE: tuple[Option, ...] = (
    ("--packages", "YAML", "contents of the subscription packages"),
    ("--key", "HEX", "application key, for encrypted frames", WORD | {"default": ""}),
)
OPTIONS = (("capture", "CAPTURE", "the recorded bytes"), *CAPTURE)


def run(args: argparse.Namespace) -> int:
    """Print the frames; return the exit code."""
    from tirgeo_ros.tools.convert.dump import CaptureDump  # noqa: PLC0415 heavy

    dump = CaptureDump(args.capture, args.packages, args.key)
    for record in dump.records():
        print(_line(record))
    print(f"tirgeo dump: {_summary(dump.counts, dump.kinds)}", file=sys.stderr)
    return 0


def _line(record: dict[str, object]) -> str:
    try:
        return json.dumps(record, allow_nan=False)
    except ValueError:  # a NaN, which is rare: looking for it each time would cost more
        return json.dumps(plain(record), allow_nan=False)


def _summary(counts: dict[str, int], kinds: dict[str, int]) -> str:
    parts = [f"{number} {kind}" for kind, number in sorted(kinds.items())]
    plural = "" if counts["frames"] == 1 else "s"
    frames = f"{counts['frames']} frame{plural} ({', '.join(parts)})"
    rest = {
        "bytes skipped": counts["skipped_bytes"],
        "damaged or cut": counts["bad_crc32"] + counts["truncated"],
        "unreadable": counts["unreadable"],
        "not decrypted": kinds.get("encrypted", 0),
    }
    return "; ".join([frames, *[f"{number} {name}" for name, number in rest.items() if number]])
