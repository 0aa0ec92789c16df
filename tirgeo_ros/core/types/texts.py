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
"""Format times, and texts that people typed, so that every program can read them."""

from __future__ import annotations

from datetime import datetime, timedelta

#: Unprintable characters to keep: line end, zero-width non-joiner, zero-width joiner.
_KEPT = "\n\u200c\u200d"
_EPOCH = datetime(1970, 1, 1)  # noqa: DTZ001  UTC; a time zone would add "+00:00"


def legible(text: str) -> str:
    """Return a text without control characters; tabs and other spaces become plain spaces."""
    spaced = (" " if c.isspace() and c != "\n" else c for c in text)
    return "".join(c for c in spaced if c.isprintable() or c in _KEPT)


def utc(stamp_ns: int) -> str:
    """Return a stamp (ns) as ISO 8601, UTC with Z, rounded down to a millisecond."""
    moment = _EPOCH + timedelta(milliseconds=stamp_ns // 1_000_000)
    return moment.isoformat(timespec="milliseconds") + "Z"
