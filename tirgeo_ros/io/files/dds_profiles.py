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
"""Choose this process's profile of Fast DDS, before rclpy is imported."""

from __future__ import annotations

import os

#: Variables with the path of a Fast DDS profile; later versions use the second name.
PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def take_small_profile() -> None:
    """Name the DDS profile with a small segment of shared memory, if the project's own is named.

    Fast DDS writes to the whole segment at the start, so each process holds all of it.
    """
    for variable in PROFILES:
        stem, ending = os.path.splitext(os.environ.get(variable, ""))  # noqa: PTH122
        if os.path.isfile(f"{stem}_small{ending}"):  # noqa: PTH113
            os.environ[variable] = f"{stem}_small{ending}"
