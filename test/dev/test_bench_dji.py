"""What make bench decodes: a capture as an aircraft sends it, clean and decoded in full."""

from __future__ import annotations

from collections import Counter

import pytest

from dev import bench_dji
from tirgeo_ros.dji.link.framing import FrameReader


@pytest.fixture(scope="module")
def frames():
    return list(bench_dji.capture(2))


def test_the_capture_is_what_an_aircraft_sends(frames):
    reader = FrameReader()
    found = reader.feed(b"".join(frames))
    assert reader.counts["skipped_bytes"] == reader.held == 0
    kinds = Counter((f.cmd_id, f.value[0] if f.cmd_id == 5 else None) for f in found)
    rates_hz = {kind: count / 2 for kind, count in kinds.items()}
    assert rates_hz == {
        (0, None): 100,
        (5, 0): 5,
        (5, 1): 50,
        (5, 2): 100,
        (5, 3): 400,
        (5, 4): 200,
    }
    masks = Counter(f.value[:2].hex() for f in found if f.cmd_id == 0)
    assert masks == {"ff3f": 20, "ff0e": 80, "1700": 100}
    # It must fit the line that it stands for: 92160 bytes a second at 921600 baud.
    assert 0.75 < sum(map(len, frames)) / (2 * 92160) < 0.85


@pytest.mark.parametrize("read", [1, bench_dji.PORT_READ, bench_dji.FILE_READ])
def test_all_of_it_is_decoded(frames, read):
    assert bench_dji.decode(b"".join(frames), read) == len(frames) == 1710
