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
"""Process flights on a Dask cluster, whose workers share a file system: one task per flight.

A worker runs each flight in a child process, as this computer does. If a worker is killed, Dask's
scheduler starts its flight again on another worker.
"""

from __future__ import annotations

import asyncio
import logging
import re
import time
import uuid
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from tirgeo_ros import __version__
from tirgeo_ros.core.types.errors import ManyFlightsError, shown
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.tools.many_flights.flight_process import FlightProgress, run_flight
from tirgeo_ros.tools.many_flights.flight_record import (
    FlightTask,
    Record,
    running_mark,
    written_record,
)
from tirgeo_ros.tools.presentation.progress import silent

_SHOW_S = 0.2  # between two reports of progress
_ADDRESS = re.compile(r"([a-z]+://)?[^/\s]+:\d+")


def run_on_cluster(
    tasks: Sequence[FlightTask], scheduler: str, progress: FlightProgress
) -> Generator[tuple[FlightTask, Record], None, None]:
    """Yield each task with its record, in the order in which they end.

    When the generator is closed, the tasks are cancelled, and their processes end. Raise
    ManyFlightsError if the scheduler has no workers or is lost, or if a worker has another version
    of tirgeo or does not see the folder.
    """
    with _client(scheduler) as client:
        _check(client, tasks[0].folder)
        run = f"{uuid.uuid4()}"  # without it, Dask could return the result of an earlier run
        pending = {
            client.submit(run_on_worker, task, key=f"{task.name}-{run}", pure=False): task
            for task in tasks
        }
        try:
            while pending:
                progress.show()
                time.sleep(_SHOW_S)
                done = [future for future in pending if future.done()]
                if client.status != "running":  # the client itself has cancelled all tasks
                    raise ConnectionError
                for future in done:
                    task = pending.pop(future)
                    progress.part(task.name, 1.0)
                    yield task, _record(task, future)
        except OSError:  # Dask's own errors of connections are OSErrors
            raise ManyFlightsError(
                f"--scheduler {scheduler}: the connection is lost; finished flights are kept: "
                "run the same command again when the scheduler is back"
            ) from None
        finally:
            with suppress(OSError):
                client.cancel(list(pending))


def run_on_worker(task: FlightTask) -> Record:
    """Process a flight on a worker; stop if the command has ended."""
    if task.made_from["version"] != __version__:
        raise ManyFlightsError(_other_version(__version__))
    mark = running_mark(Path(task.folder))
    return run_flight(task, lambda: not mark.exists(), silent)


def worker_sees(folder: str) -> tuple[str, bool]:
    """Return a worker's version of tirgeo, and whether it sees the run in this folder."""
    return __version__, running_mark(Path(folder)).exists()


@contextmanager
def _client(scheduler: str) -> Iterator[Any]:
    """Connect to a scheduler; raise ManyFlightsError if there is none."""
    if not _ADDRESS.fullmatch(scheduler):
        raise ManyFlightsError(
            f"--scheduler {scheduler}: give an address, as tcp://192.168.1.5:8786"
        )
    dask = needed("distributed", f"--scheduler {scheduler}", ManyFlightsError)
    for name in ("distributed", "distributed.client"):  # the package sets a level for each
        logging.getLogger(name).setLevel(logging.CRITICAL)  # their errors are raised here too
    try:
        client = dask.Client(scheduler, timeout=10.0, set_as_default=False, name="tirgeo")
    except (OSError, ValueError, TypeError) as error:
        why = shown(str(error).partition("\n")[0], 200)
        raise ManyFlightsError(
            f"--scheduler {scheduler}: no Dask scheduler answers: {why}"
        ) from None
    with client:
        yield client


def _check(client: Any, folder: str) -> None:
    """Raise ManyFlightsError unless there are workers, of this version, that see the folder."""
    try:
        client.wait_for_workers(1, timeout=30.0)
    except asyncio.TimeoutError:
        raise ManyFlightsError(
            "the scheduler has no worker: start workers with dask worker"
        ) from None
    for worker, answer in client.run(worker_sees, folder, on_error="return").items():
        if isinstance(answer, BaseException):
            why = shown(answer, 200)
            raise ManyFlightsError(f"worker {worker}: cannot run tirgeo {__version__}: {why}")
        version, sees = answer
        if version != __version__:
            raise ManyFlightsError(f"worker {worker}: {_other_version(version)}")
        if not sees:
            raise ManyFlightsError(
                f"worker {worker} does not see {folder}: flights, files and outputs must be on a "
                "file system that all workers share, under the same names"
            )


def _other_version(version: str) -> str:
    return f"has tirgeo {version}, another version than this computer; install the same version"


def _record(task: FlightTask, future: Any) -> Record:
    """Return the record that a worker wrote, or a record of its error if it wrote none."""
    if future.status == "finished":
        record: Record = future.result()
        return record
    error = future.exception() if future.status == "error" else None
    why = shown(error or "cancelled by the scheduler", 300)
    if type(error).__name__ == "KilledWorker":
        why = "each worker that began it was killed; check that there is enough memory"
    return written_record(task, {"error": f"{task.bag}: {why}"}, 1)
