"""The sheet of thermal pictures: one for each palette, all with the map on them."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from project import PROJECT

from dev.contact_sheet import PHONE_PX, contact_sheet
from tirgeo_ros.core.config.overlay_parameters import PALETTES

SAMPLES = "shared/thermal_samples"


def written(folder, name, pixels):
    (folder / name).write_bytes(cv2.imencode(Path(name).suffix, pixels)[1].tobytes())


def ground(dtype=np.uint8, size=(256, 320)):
    rng = np.random.default_rng(1)
    low, high = (90, 110) if dtype == np.uint8 else (20000, 21000)
    return rng.integers(low, high, size).astype(dtype)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_row_for_a_picture_and_a_column_for_a_palette(tmp_path, dtype):
    written(tmp_path, "a.png", ground(dtype))
    written(tmp_path, "b_0_80_60_0_00001.png", ground(dtype))
    sheet = contact_sheet(tmp_path, 60.0, 40.0)
    height = round(256 * PHONE_PX / 320)
    assert sheet.shape == (2 * (height + 4), len(PALETTES) * PHONE_PX, 3)
    rows = sheet.reshape(2, height + 4, len(PALETTES), PHONE_PX, 3)
    means = rows[0].mean(axis=(0, 2))
    assert len(np.unique(means.round(1), axis=0)) == len(PALETTES)
    assert np.abs(rows[0].astype(int) - rows[1]).max() > 100  # the name told another pose


def test_real_frames(tmp_path):
    folder = PROJECT.parent / SAMPLES
    if not folder.is_dir():
        pytest.skip(f"no {SAMPLES} beside the project")
    sheet = contact_sheet(folder, 60.0, 40.0)
    assert sheet.shape[1] == len(PALETTES) * PHONE_PX
