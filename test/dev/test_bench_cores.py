"""The measurement of several cores, over one run of each kind."""

from __future__ import annotations

import shutil

import pytest
from project import PROJECT

from dev.bench_cores import core_figures
from tirgeo_ros.tools.replay.cut import cut


@pytest.mark.slow
def test_each_kind_is_run_and_the_outputs_are_compared(sample, tmp_path):
    for name in ("params.yaml", "map.geojson"):
        shutil.copy(sample / name, tmp_path)
    cut(sample / "flight.mcap", tmp_path / "flight.mcap", end=3.0)
    found = {one.what: one.value for one in core_figures(tmp_path, 1, "out.mp4", PROJECT)}
    times = [value for name, value in found.items() if name.startswith("process with images")]
    assert len(times) == 6
    assert min(times) > 0.5  # s: Python and OpenCV alone take as long to load
    one_core_s = found["process with images, one core"]
    gain = one_core_s / found["process with images, all cores"]
    assert found["all cores over one"] == pytest.approx(gain)
    assert found["different outputs"] == 0
