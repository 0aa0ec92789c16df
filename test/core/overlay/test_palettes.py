"""Palettes: what is hotter looks hotter, in every one of them."""

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.config.overlay import PALETTES
from tirgeo_ros.core.overlay.palettes import palette_table
from tirgeo_ros.core.types.errors import ConfigError


def luminance(table):
    """(256,) relative luminance of sRGB colours (IEC 61966-2-1)."""
    unit = table[:, 0] / 255
    linear = np.where(unit <= 0.04045, unit / 12.92, ((unit + 0.055) / 1.055) ** 2.4)
    return linear @ [0.0722, 0.7152, 0.2126]


@pytest.mark.parametrize("name", PALETTES)
def test_a_table_has_a_colour_of_its_own_for_each_level(name):
    table = palette_table(name)
    assert (table.shape, table.dtype) == ((256, 1, 3), np.uint8)
    assert len(np.unique(table.reshape(-1, 3), axis=0)) == 256
    step = np.abs(np.diff(table[:, 0].astype(int), axis=0)).max()
    assert step <= 12  # no edge is drawn where the temperature changes smoothly


@pytest.mark.parametrize("name", sorted(set(PALETTES) - {"rainbow"}))
def test_hotter_is_never_darker(name):
    rise = np.diff(luminance(palette_table(name))) * (-1 if name == "black_hot" else 1)
    assert rise.min() > 0


@pytest.mark.parametrize("name", sorted(set(PALETTES) - {"rainbow", "white_hot", "black_hot"}))
def test_lightness_is_even(name):
    """In CIE L*: a step is an even share, and half a unit of rounding in each of two colours."""
    unit = (palette_table(name) / 255).astype(np.float32)
    steps = np.diff(cv2.cvtColor(unit, cv2.COLOR_BGR2LAB)[:, 0, 0].astype(float))
    assert np.abs(steps - steps.mean()).max() < 0.5


def test_white_hot_is_the_picture_itself_and_black_hot_its_opposite():
    white, black = palette_table("white_hot"), palette_table("black_hot")
    assert (white[:, 0] == np.arange(256)[:, None]).all()
    assert (black == 255 - white).all()


def test_rainbow_parts_its_colours_by_hue():
    ends = palette_table("rainbow")[[20, 128, 218], 0].astype(int)
    assert ends.argmax(axis=1).tolist() == [0, 1, 2]  # blue, green, red


def test_an_unknown_palette_is_refused():
    with pytest.raises(ConfigError, match="'sepia' is not one of white_hot, black_hot"):
        palette_table("sepia")
