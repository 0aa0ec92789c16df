"""A Dask cluster of real processes on this machine: a scheduler and workers."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager

from project import PROJECT

_LIMIT_S = 120.0


@contextmanager
def dask_cluster(folder, workers=2):
    """Run a scheduler and workers of one thread; yield its address and the workers' processes.

    Without a nanny: a worker that is killed is gone.
    """
    told = folder / "scheduler.json"
    with ExitStack() as stack:
        words = ["--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(told)]
        stack.enter_context(_process(folder / "scheduler.log", "dask_scheduler", *words))
        address = _address(told)
        yield (
            address,
            [
                stack.enter_context(_worker(folder / f"worker_{number}.log", address))
                for number in range(workers)
            ],
        )


def _worker(log, address):
    return _process(log, "dask_worker", address, "--nthreads", "1", "--no-nanny")


@contextmanager
def _process(log, program, *words):
    command = [sys.executable, "-m", f"distributed.cli.{program}", *words, "--no-dashboard"]
    with log.open("wb") as out:
        # The project's folder is where a worker finds tirgeo.
        process = subprocess.Popen(command, cwd=PROJECT, stdout=out, stderr=out)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def _address(path):
    end_s = time.monotonic() + _LIMIT_S
    while not (path.exists() and path.read_text().endswith("}")):
        assert time.monotonic() < end_s, f"no scheduler within {_LIMIT_S:g} s"
        time.sleep(0.05)
    return json.loads(path.read_text())["address"]
