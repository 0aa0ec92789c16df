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
"""The pictures of the sample flight as ``ExportFrame``s, without the verb that makes products."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

from tirgeo_ros.tools.export.frames import ExportFrame, frames, register
from tirgeo_ros.tools.presentation.progress import silent
from tirgeo_ros.tools.replay.flight_pictures import FlightPictures, Window
from tirgeo_ros.tools.replay.node_configs import open_flight

GROUND_M = 11.5
UNDULATION_M = -9.0


class Exported(NamedTuple):
    """The frames of a flight, the stamps of all its pictures, the filter's state at exposures."""

    frames: list[ExportFrame]
    stamps_ns: list[int]
    states: dict[int, str]

    def state_at(self, stamp_ns: int) -> str:
        return self.states[stamp_ns]


@cache
def exported(folder: Path) -> Exported:
    """The sample flight: pictures before the alignment have no pose and are left out."""
    bag, params = folder / "flight.mcap", folder / "params.yaml"
    opened = open_flight(bag, (), params, "", {"ground_height": GROUND_M})
    pictures = FlightPictures(opened.reader, "")
    flight = register(opened, pictures.chosen(Window()), silent)
    return Exported([*frames(pictures, flight, silent)], pictures.stamps_ns, flight.states)
