"""Whose topics a receiver's samples become."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.io.logs.log_contents import LogContents, say_receiver


@pytest.mark.parametrize(
    ("is_rtk", "sources", "words"),
    [
        (True, [Source.RTK_POSITION, Source.RTK_VELOCITY], "was RTK float or fixed"),
        (False, [Source.GPS_POSITION, Source.GPS_VELOCITY], "was never RTK float or fixed"),
    ],
)
def test_a_receiver_that_was_never_rtk_is_ordinary_gps(is_rtk, sources, words):
    cov = np.eye(3)
    heading = HeadingSample(1, 0.0, 1e-4)
    contents = LogContents(
        [
            PositionSample(1, Source.RTK_POSITION, FixStatus.SINGLE, 0.8, 0.2, 100.0, cov),
            VelocitySample(1, Source.RTK_VELOCITY, np.zeros(3), cov),
            heading,
        ]
    )
    say_receiver(contents, "NAV-PVT", is_rtk=is_rtk)
    position, velocity, kept = contents.samples
    assert [position.source, velocity.source] == sources
    assert (position.height_m, kept) == (100.0, heading)
    assert words in contents.notes[0]
