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
"""One evaluation of the sample flight for all tests of this folder."""

from __future__ import annotations

import pytest
from process_bags import RTK, files, rewritten

from tirgeo_ros.tools.evaluate.evaluate import evaluate

BORESIGHT = "/**/gimbal_node:\n  ros__parameters: {boresight_rpy_deg: [0.0, 0.0, 5.0]}\n"


@pytest.fixture(scope="session")
def result(sample, tmp_path_factory):
    """The sample flight, evaluated with a boresight file that turns the camera by 5 deg."""
    boresight = tmp_path_factory.mktemp("boresight") / "boresight.yaml"
    boresight.write_text(BORESIGHT)
    return evaluate(
        *files(sample),
        params=sample / "params.yaml",
        boresight=boresight,
        truth=sample / "truth.mcap",
    )


@pytest.fixture(scope="session")
def raw_flight(sample, tmp_path_factory):
    """The sample's files, of the bag as much as the method raw needs: quickly evaluated."""
    bag = tmp_path_factory.mktemp("raw") / "raw.mcap"
    pictures = {"/thermal/image_raw/compressed"}
    rewritten(sample / "flight.mcap", bag, without=RTK | pictures, seconds=16)
    return [bag, *files(sample)[1:]]
