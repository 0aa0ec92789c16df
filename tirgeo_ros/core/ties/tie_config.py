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
"""Define how ties are searched for."""

from __future__ import annotations

from dataclasses import dataclass

RELIEF = 0.1  # standard deviation of the ground's height, in heights above the ground


@dataclass(frozen=True)
class TieConfig:
    """Hold the sizes and limits of the search; the defaults suit stills and videos."""

    features: int = 1200  # of a picture, at most: the strongest ones; some places count twice
    #: A picture is taken if it shows less than this share of what the last one taken shows; if it
    #: is nearer in time than ``apart_s``, less than ``most_overlap_soon``.
    most_overlap: float = 0.9
    most_overlap_soon: float = 0.75
    apart_s: float = 0.9  # stills come once a second and slower
    #: Pictures kept, at most, 0.25 MB each. When there are more, every second one is dropped, and
    #: every second one of those that follow is left out.
    most_pictures: int = 600
    pairs_per_picture: int = 4  # that a picture asks for: P pictures have P times this at most
    relief: float = RELIEF
    #: Standard deviation, about each axis, of what the poses' covariances leave out: the angles of
    #: the mounting. With 1 deg, half of the pairs of opposite headings of a real strip are lost.
    mounting_sigma_deg: float = 2.0
    least_ties: int = 12  # of a pair, and those expected by chance besides
    cells: tuple[int, int] = (10, 8)  # of a picture, across and down; each keeps one tie of a pair
