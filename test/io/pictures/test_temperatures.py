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
"""Temperatures of FLIR's R-JPEG by its constants, of TIFFs beside stills, and of counts."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from flir_files import flir_jpeg
from stills import RAW, still_jpeg

from tirgeo_ros.core.config.overlay_parameters import PictureConfig
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.io.pictures.jpeg_segments import metadata_of
from tirgeo_ros.io.pictures.temperatures import flir_thermal, thermal_of, tiff_thermal

RAWS = np.array([[17000, 16000], [18000, 20000]])
#: By hand: 1501 / ln(21106.77 / (0.012545258 (S - 7340)) + 1) - 273.15.
CELSIUS = np.array([[17.4184, 11.4307], [23.0323, 33.3607]])
COMPRESSED = "thermal/image_raw/compressed"


def celsius(jpeg):
    """The temperatures where four raw values lie in a picture of 640x512."""
    thermal = flir_thermal(jpeg)
    return np.array([[thermal(u, v) for u in (160, 480)] for v in (128, 384)])


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("png", [False, True])
@pytest.mark.parametrize("piece", [100, 60_000])
def test_a_black_body_without_air(order, png, piece):
    jpeg = flir_jpeg(RAWS, order=order, png=png, piece=piece)
    assert celsius(jpeg) == pytest.approx(CELSIUS, abs=2e-3)


def test_what_the_object_reflects():
    # U(20 C) = 21106.77 / (0.012545258 (exp(1501 / 293.15) - 1)) + 7340 = 17452.31;
    # U_object = (17000 - 0.2 17452.31) / 0.8 = 16886.92, which is 16.7613 C.
    jpeg = flir_jpeg(RAWS, emissivity=0.8)
    assert celsius(jpeg)[0, 0] == pytest.approx(16.7613, abs=2e-3)


def test_air_between():
    # At 10 C and 60 %: water 0.6 exp(1.5587 + 0.6939 - 0.027816 + 0.00068455) = 5.5547; over 60 m
    # transmission 1.9 exp(-7.74597 (0.006569 - 0.002276 2.35684))
    # - 0.9 exp(-7.74597 (0.01262 - 0.00667 2.35684)) = 0.960477.
    # U(10 C) = 15771.11; U_object = (17000 - 0.039523 15771.11) / 0.960477 = 17050.57, 17.7107 C.
    jpeg = flir_jpeg(RAWS, distance=60.0, air=283.15, humidity=60.0)
    assert celsius(jpeg)[0, 0] == pytest.approx(17.7107, abs=5e-3)


def test_raw_values_of_another_size_than_the_picture():
    thermal = flir_thermal(flir_jpeg(RAWS))
    assert thermal(319.4, 255.4) == pytest.approx(CELSIUS[0, 0], abs=2e-3)
    assert thermal(319.6, 255.6) == pytest.approx(CELSIUS[1, 1], abs=2e-3)
    assert np.isnan(thermal(639.6, 10.0))
    assert np.isnan(thermal(-0.6, 10.0))


def test_other_pictures_have_none():
    assert flir_thermal(still_jpeg(1)) is None
    assert flir_thermal(b"") is None
    assert flir_thermal(still_jpeg(1) + b"FLIR\0") is None


@pytest.mark.parametrize("change", [{"emissivity": 0.0}, {"reflected": 1e-3}, {"air": -5.0}])
def test_impossible_constants(change):
    with pytest.raises(MessageError, match="FLIR's raw data are damaged"):
        flir_thermal(flir_jpeg(RAWS, **change))


def test_damaged_raw_data_are_an_error_in_words():
    whole, random = flir_jpeg(RAWS, png=True), np.random.default_rng(5)
    refused = 0
    for _ in range(300):
        data = bytearray(whole)
        for place in random.integers(20, 1400, 8):
            data[place] = random.integers(256)
        try:
            thermal = flir_thermal(bytes(data))
            assert thermal is None or isinstance(thermal(3.0, 3.0), float)
        except MessageError:
            refused += 1
    assert refused > 20


def test_raw_data_are_not_metadata_of_the_drawn_still():
    assert metadata_of(flir_jpeg(RAWS)) == b""


def written(path, values):
    path.write_bytes(cv2.imencode(".tiff", values)[1].tobytes())
    return path


def test_a_tiff_of_degrees_beside_a_still(tmp_path):
    path = written(tmp_path / "a.tiff", np.array([[1.5, -2.25], [3.0, 4.0]], np.float32))
    thermal = tiff_thermal(path, (640, 512), PictureConfig())
    assert thermal(639.0, 0.0) == -2.25


def test_a_tiff_of_counts_needs_their_scale(tmp_path):
    path = written(tmp_path / "a.tif", np.array([[2932, 3000]], np.uint16))
    with pytest.raises(MessageError, match=r"a.tif: .*set picture.celsius_per_count"):
        tiff_thermal(path, (2, 1), PictureConfig())
    thermal = tiff_thermal(path, (2, 1), PictureConfig(celsius_per_count=0.1))
    assert thermal(0.0, 0.0) == pytest.approx(20.05)  # 293.2 K


def test_a_tiff_of_colours_is_refused(tmp_path):
    path = written(tmp_path / "a.tif", np.zeros((2, 2, 3), np.uint8))
    with pytest.raises(MessageError, match="no picture of one value a pixel"):
        tiff_thermal(path, (2, 2), PictureConfig())


def test_counts_of_a_16_bit_picture():
    png = cv2.imencode(".png", np.array([[7000, 7500]], np.uint16))[1].tobytes()
    message, scale = SimpleNamespace(data=png, format="png"), PictureConfig(celsius_per_count=0.04)
    assert thermal_of(COMPRESSED, message, scale)(1.4, 0.0) == pytest.approx(26.85)
    assert thermal_of(COMPRESSED, message, PictureConfig()) is None


def test_djis_raw_data_are_refused_in_words():
    message = SimpleNamespace(data=still_jpeg(1), format="jpeg")
    assert RAW in message.data
    with pytest.raises(MessageError, match="DJI's own tool: put its TIFF beside the still"):
        thermal_of(COMPRESSED, message, PictureConfig())
