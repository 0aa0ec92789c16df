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
"""Run the node graph; do the work of ``tirgeo demo`` and ``tirgeo run``."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import tirgeo_ros


def find_resource(relative: str) -> Path | None:
    """Return the path of ``bags/...`` or ``config/...``, or None if it is not installed.

    The search goes through the source tree, the ROS prefixes of the environment and the virtual
    environment. ``get_package_share_directory`` alone would not find a file outside a ROS prefix.
    """
    source = Path(tirgeo_ros.__file__).resolve().parents[1]
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    folders = [Path(prefix) / "share" / "tirgeo" for prefix in prefixes if prefix]
    if (source / "package.xml").is_file():
        folders.insert(0, source)
    return next((path for folder in folders if (path := folder / relative).exists()), None)
