"""What a node has done before anything slow is imported."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from project import PROJECT

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="counts Linux faults")

#: Page faults a round of a thread that fills four pictures anew, once it has done so for a while.
PICTURES = """
import resource, sys, threading
import numpy as np
from tirgeo_ros.nodes.start import keep_memory
if "keep" in sys.argv:
    keep_memory()
def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
def rounds(number):
    for _ in range(number):
        pictures = [np.ones(983_040, np.uint8) for _ in range(4)]
        del pictures
def work():
    rounds(30)
    before = faults()
    rounds(30)
    print((faults() - before) / 30)
thread = threading.Thread(target=work)
thread.start()
thread.join()
"""


def faults_a_round(*words: str) -> float:
    project = str(PROJECT)
    return float(
        subprocess.run(
            [sys.executable, "-c", PICTURES, *words],
            env=os.environ | {"PYTHONPATH": project},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
    )


def test_a_pictures_memory_is_kept_for_the_next():
    """Four pictures have 960 pages of 4 KiB; without a word to the C library most fault again."""
    if os.confstr("CS_GNU_LIBC_VERSION") is None:
        pytest.skip("no glibc")
    assert faults_a_round() > 100
    assert faults_a_round("keep") < 10
