"""Plots: the ticks of a logarithmic axis are plain numbers that keep apart."""

from __future__ import annotations

import itertools
import re

import pytest

from tirgeo_ros.tools.presentation.plots import figure, logarithmic

RANGES = [(6e-3, 1.1e-2), (0.15, 9.0), (0.01, 12.0), (1e-6, 1.5), (2, 3)]


@pytest.mark.parametrize("which", ["x", "y"])
@pytest.mark.parametrize("ends", RANGES)
def test_ticks_of_a_logarithmic_axis_keep_apart(which, ends):
    """In a figure as narrow as the report's, with its axis label."""
    made, axes = figure(4.4, 2.1)
    axes.plot(ends, ends)
    axes.set(xlabel="sigma as predicted, m", ylabel="error, m")
    logarithmic(axes, which)
    made.draw_without_rendering()
    axis = getattr(axes, f"{which}axis")
    low, high = sorted(axis.get_view_interval())
    shown = [
        label
        for place, label in zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=True)
        if low <= place <= high
    ]
    assert len(shown) >= 2
    assert all(re.fullmatch(r"[0-9.]+(e-0[0-9])?", label.get_text()) for label in shown)
    boxes = [label.get_window_extent() for label in shown]
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))
    assert not any(label.get_text() for label in axis.get_ticklabels(minor=True))
