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
"""Damage files in the ways that transfers and power cuts do, and read them."""

from __future__ import annotations

import random
from collections.abc import Callable, Sized
from pathlib import Path

from tirgeo_ros.core.types.errors import TirgeoError


def damaged(whole: bytes, rng: random.Random) -> bytes:
    """Return a file's bytes cut, with flipped bits, zeros or noise."""
    data = bytearray(whole)
    at = rng.randrange(8, len(data))
    match rng.randrange(4):
        case 0:
            del data[at:]
        case 1:
            for _ in range(rng.choice((1, 10, 100))):
                data[rng.randrange(8, len(data))] ^= 1 << rng.randrange(8)
        case 2:
            data[at : at + 200] = bytes(200)
        case 3:
            data[at : at + 200] = rng.randbytes(200)
    return bytes(data)


def read_damaged(read: Callable[[Path], Sized], whole: bytes, path: Path, times: int) -> int:
    """Read a file that is damaged in another way each time; return how often it gave something.

    It may raise TirgeoError in one line that names the file, and nothing else.
    """
    rng, result = random.Random(17), 0
    for _ in range(times):
        path.write_bytes(damaged(whole, rng))
        try:
            result += len(read(path)) > 0
        except TirgeoError as error:
            line = str(error)
            if not line.startswith(f"{path}: ") or "\n" in line:
                raise
    return result
