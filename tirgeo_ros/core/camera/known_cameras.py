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
"""Know the cameras of which a calibration or a data sheet is published."""

from __future__ import annotations

from tirgeo_ros.core.camera.camera_model import Camera

#: The FLIR XT2's thermal camera (Ren et al. 2022, Table 9).
XT2 = Camera(640, 512, 803.5593, 797.6270, 349.3325, 251.8215, (0.0540, 0.3462, -0.0037, 0.0076))
