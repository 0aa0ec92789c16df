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
"""Define the array types and the tuples of floats that the whole package uses."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
#: A picture to draw on or to show: (h, w) grey or (h, w, 3) BGR, uint8.
Pixels = npt.NDArray[np.uint8]
#: A picture as a camera delivers it: (h, w) or (h, w, 3), uint8 or uint16.
RawPixels = npt.NDArray[Any]

# Tuples of floats: at 3 x 3 their arithmetic costs a fraction of array calls.
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # w, x, y, z
#: R_nb row by row.
Rotation = tuple[float, float, float, float, float, float, float, float, float]
