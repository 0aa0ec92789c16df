"""The figures of the bench over DDS, from what its two ends write."""

from __future__ import annotations

import json

import numpy as np
import pytest

from dev.bench_dds import times_of
from tirgeo_ros.core.types.errors import GraphError

START, FRAME, MS = 1_700_000_000_000_000_000, 33_333_333, 1_000_000
SENT = [START + k * FRAME for k in range(420)]
#: Those after the first five seconds, and a stamp is sent later than the fifth second's end.
COUNTED = [stamp for stamp in SENT if stamp > START + 5_000_000_000]


def run(shown, *, lines=True, inside_ms=6.5, node="overlay_node", spent_s=1.8):
    """As read from the files."""
    words = {"shown": shown, "lines": lines, "inside_ms": inside_ms}
    return times_of({"sent": SENT}, json.loads(json.dumps(words)), node, spent_s)


def test_median_and_percentile_are_those_of_the_settled_frames():
    ages = np.random.default_rng(1).integers(5 * MS, 20 * MS, len(SENT))
    slow_start = np.where(np.isin(SENT, COUNTED), ages, 900 * MS)
    found = run([[stamp, int(age)] for stamp, age in zip(SENT, slow_start, strict=True)])
    settled = np.sort(ages[np.isin(SENT, COUNTED)]) * 1e-9
    assert found.sent == len(COUNTED) == 269
    assert found.lost == 0
    # Between the two values next to the place in order, whatever way is taken between them.
    assert settled[133] <= found.p50_s <= settled[135]
    assert settled[254] <= found.p95_s <= settled[256]
    assert found.cpu_s == pytest.approx(1.8 / 420)
    assert found.inside_s == pytest.approx(6.5e-3)


def test_frames_without_a_picture_are_lost_and_strange_pictures_do_not_count():
    shown = [[stamp, 8 * MS] for stamp in COUNTED[::2]]
    strange = [[START - FRAME, 5_000 * MS], [COUNTED[-1] + FRAME, 5_000 * MS]]
    found = run([*strange, *shown])
    assert found.lost == len(COUNTED) // 2
    assert found.p95_s == pytest.approx(8e-3)


@pytest.mark.parametrize(
    ("shown", "lines", "message"),
    [
        ([[stamp, MS] for stamp in SENT], False, "no picture with lines"),
        ([], True, "overlay_node gave next to no pictures"),
        ([[stamp, MS] for stamp in SENT[:30]], True, "next to no pictures"),
    ],
)
def test_a_run_that_measured_nothing_is_an_error(shown, lines, message):
    with pytest.raises(GraphError, match=message):
        run(shown, lines=lines)
