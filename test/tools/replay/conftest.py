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
"""Outputs of process for the first seconds of the sample flight."""

from __future__ import annotations

import pytest

from tirgeo_ros.tools.replay.process import process


@pytest.fixture(scope="session")
def whole(cut, options, tmp_path_factory):
    """The cut with all outputs: folder and summary."""
    folder = tmp_path_factory.mktemp("whole")
    files = {"raw_images": True, "video": folder / "out.mp4"}
    return folder, process(cut, folder / "out.mcap", **files, **options)


@pytest.fixture(scope="session")
def poses_only(cut, options, tmp_path_factory):
    """The cut without pictures."""
    path = tmp_path_factory.mktemp("poses") / "out.mcap"
    return path, process(cut, path, images=False, **options)
