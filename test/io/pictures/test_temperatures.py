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
"""Temperatures of FLIR's R-JPEG by its constants, and of TIFFs beside stills."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from flir_files import flir_jpeg
from stills import still_jpeg

from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.io.pictures.jpeg_segments import metadata_of
from tirgeo_ros.io.pictures.temperatures import temperatures

RAWS = np.array([[17000, 16000], [18000, 20000]])
#: By hand: 1501 / ln(21106.77 / (0.012545258 (S - 7340)) + 1) - 273.15.
CELSIUS = np.array([[17.4184, 11.4307], [23.0323, 33.3607]])
#: Half a step of the scale, and the digits of the numbers by hand.
STEP = 0.01 + 2e-3
STILL = Path("DJI_0001_T.JPG")


def celsius(jpeg, tiff=None):
    png = np.frombuffer(temperatures(STILL, jpeg, tiff), np.uint8)
    return cv2.imdecode(png, cv2.IMREAD_UNCHANGED) * 0.02 - 273.15


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("png", [False, True])
@pytest.mark.parametrize("piece", [100, 60_000])
def test_a_black_body_without_air(order, png, piece):
    jpeg = flir_jpeg(RAWS, order=order, png=png, piece=piece)
    assert celsius(jpeg) == pytest.approx(CELSIUS, abs=STEP)


# U(20 C) = 21106.77 / (0.012545258 (exp(1501 / 293.15) - 1)) + 7340 = 17452.31;
# U_object = (17000 - 0.2 17452.31) / 0.8 = 16886.92, which is 16.7613 C.
# At 10 C and 60 %: water 0.6 exp(1.5587 + 0.6939 - 0.027816 + 0.00068455) = 5.5547; over 60 m
# transmission 1.9 exp(-7.74597 (0.006569 - 0.002276 2.35684))
# - 0.9 exp(-7.74597 (0.01262 - 0.00667 2.35684)) = 0.960477.
# U(10 C) = 15771.11; U_object = (17000 - 0.039523 15771.11) / 0.960477 = 17050.57, 17.7107 C.
AIR = {"distance": 60.0, "air": 283.15, "humidity": 60.0}


@pytest.mark.parametrize(("change", "degrees"), [({"emissivity": 0.8}, 16.7613), (AIR, 17.7107)])
def test_what_the_object_reflects_and_the_air_between(change, degrees):
    assert celsius(flir_jpeg(RAWS, **change))[0, 0] == pytest.approx(degrees, abs=STEP)


def test_other_pictures_have_none():
    plain = cv2.imencode(".jpg", np.zeros((2, 2), np.uint8))[1].tobytes()
    assert temperatures(STILL, plain) == temperatures(STILL, b"") == b""
    assert temperatures(STILL, plain + b"FLIR\0") == b""


@pytest.mark.parametrize("change", [{"emissivity": 0.0}, {"reflected": 1e-3}, {"air": -5.0}])
def test_impossible_constants(change):
    with pytest.raises(MessageError, match=r"DJI_0001_T\.JPG: FLIR's raw data are damaged"):
        temperatures(STILL, flir_jpeg(RAWS, **change))


def test_damaged_raw_data_are_an_error_in_words():
    whole, random = flir_jpeg(RAWS, png=True), np.random.default_rng(5)
    refused = 0
    for _ in range(300):
        data = bytearray(whole)
        for place in random.integers(20, 1400, 8):
            data[place] = random.integers(256)
        try:
            temperatures(STILL, bytes(data))
        except MessageError:
            refused += 1
    assert refused > 20


def test_raw_data_are_not_metadata_of_the_drawn_still():
    assert metadata_of(flir_jpeg(RAWS)) == b""


def written(path, values):
    path.write_bytes(cv2.imencode(".tiff", values)[1].tobytes())
    return path


def test_a_tiff_of_degrees_beside_a_still(tmp_path):
    degrees = np.array([[1.5, -2.25], [1037.7, np.nan]], np.float32)
    tiff = written(tmp_path / "a.tiff", degrees)
    # Of DJI's raw data, which needs it; what the scale does not hold is 0 K: unknown.
    expected = [[1.5, -2.25], [-273.15, -273.15]]
    assert celsius(still_jpeg(1), tiff) == pytest.approx(np.array(expected), abs=STEP)


@pytest.mark.parametrize("values", [np.zeros((2, 2), np.uint16), np.zeros((2, 2, 3), np.float32)])
def test_a_tiff_of_counts_or_colours_is_refused(tmp_path, values):
    tiff = written(tmp_path / "a.tif", values)
    with pytest.raises(MessageError, match=r"a\.tif: no picture of one number with decimals"):
        temperatures(STILL, still_jpeg(1), tiff)
