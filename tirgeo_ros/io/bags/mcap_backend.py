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
"""Choose what reads and writes MCAP files: the package mcap, or ROS's own rosbag2_py.

A ROS that comes from Ubuntu's packages has rosbag2_py, and no mcap without pip. Files cut off or
damaged are read further with mcap.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.bags.bag_file import BagFile
from tirgeo_ros.io.files.whole_files import PathLike

if TYPE_CHECKING:
    from tirgeo_ros.io.bags.mcap_file import McapSink
    from tirgeo_ros.io.bags.rosbag2_file import Rosbag2Sink


def mcap_backend(path: PathLike) -> tuple[type[BagFile], type[McapSink | Rosbag2Sink]]:
    """Return the classes that read and write; raise BagError for ``path`` if there are none."""
    if find_spec("mcap") is None and find_spec("rosbag2_py") is not None:
        from tirgeo_ros.io.bags.rosbag2_file import (  # noqa: PLC0415
            Rosbag2File,
            Rosbag2Sink,
        )

        return Rosbag2File, Rosbag2Sink
    needed("mcap", f"a bag such as {path}", BagError)
    from tirgeo_ros.io.bags.mcap_file import McapFile, McapSink  # noqa: PLC0415  may be absent

    return McapFile, McapSink
