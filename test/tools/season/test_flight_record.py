"""Records: what makes a flight be processed anew, and what is no record."""

from __future__ import annotations

import json
import os
from dataclasses import replace

import pytest

from tirgeo_ros.tools.season import flight_task
from tirgeo_ros.tools.season.flight_record import is_done, read_records, record_of, written_record
from tirgeo_ros.tools.season.flight_task import FlightTask, bag_stamps, digests_of, made_from


@pytest.fixture
def made(tmp_path):
    """A flight with its parameter file, processed: a function of its task, and the record."""
    bag, params = tmp_path / "flight.mcap", tmp_path / "params.yaml"
    bag.write_bytes(b"bag")
    params.write_text("a: 1")
    out = tmp_path / "out"
    out.mkdir()
    (out / "flight.mcap").write_bytes(b"output")

    def task(**options):
        digests = digests_of([params, tmp_path / "no"])
        source = made_from(bag_stamps(bag), {"method": None} | options, digests)
        here = str(tmp_path)
        return FlightTask("flight", str(bag), str(out), here, options, "", source)

    found = {"output": "out/flight.mcap", "error": None, "speed": float("nan")}
    season = {"outputs": {"flight.mcap": 6}, "facts": {"begin_utc": "2026-05-01T10:00:00Z"}}
    written_record(task(), found | {"season": season}, 1)
    return task, read_records(out)["flight"]


def test_a_record_comes_back(made, tmp_path):
    task, record = made
    assert is_done(record, task())
    assert record["speed"] is None
    assert record["season"]["bag"] == str(tmp_path / "flight.mcap")
    assert record["season"]["facts"] == {"begin_utc": "2026-05-01T10:00:00Z"}


def changed_flight(folder):
    (folder / "flight.mcap").write_bytes(b"BAG")
    os.utime(folder / "flight.mcap", ns=(5, 5))


@pytest.mark.parametrize(
    "change",
    [
        changed_flight,
        lambda folder: (folder / "params.yaml").write_text("a: 2"),
        lambda folder: (folder / "no").write_text("the map is there now"),
        lambda folder: (folder / "out/flight.mcap").write_bytes(b"cut"),
        lambda folder: (folder / "out/flight.mcap").unlink(),
    ],
    ids=["flight", "parameters", "new file", "output", "no output"],
)
def test_a_change_makes_it_anew(made, tmp_path, change):
    task, record = made
    change(tmp_path)
    assert not is_done(record, task())


def test_another_option_or_version_makes_it_anew(made, monkeypatch):
    task, record = made
    assert not is_done(record, task(method="rtk"))
    monkeypatch.setattr(flight_task, "__version__", "99.0")
    assert not is_done(record, task())


def test_a_file_that_was_only_touched_is_the_same(made, tmp_path):
    task, record = made
    os.utime(tmp_path / "params.yaml", ns=(5, 5))
    assert is_done(record, task())


def test_a_failed_flight_is_tried_again(made):
    task, _ = made
    assert not is_done(record_of(task(), {"error": "no space"}, 1), task())
    assert not is_done(None, task())


def test_other_files_are_passed_over(made, tmp_path):
    season = '{"season": {"name": "x"}}'
    for text in ("", "{", "[]", "3", "{}", '{"season": {}}', season, "[" * 99999):
        (tmp_path / "out/other.json").write_text(text)
        assert list(read_records(tmp_path / "out")) == ["flight"]


def test_each_needed_part_of_a_record_is_looked_for(made, tmp_path):
    _, record = made
    for key in ("name", "bag", "made_from", "outputs", "facts"):
        cut = record | {"season": {k: v for k, v in record["season"].items() if k != key}}
        (tmp_path / "out/cut.json").write_text(json.dumps(cut))
        assert list(read_records(tmp_path / "out")) == ["flight"]


def test_stamps_of_a_folder_are_those_of_its_bag(tmp_path):
    for name in ("rec_0.mcap", "rec_1.mcap", "notes.txt"):
        (tmp_path / name).write_bytes(b"x")
    assert [name for name, _, _ in bag_stamps(tmp_path)] == ["rec_0.mcap", "rec_1.mcap"]
    assert bag_stamps(tmp_path / "absent.mcap") == [["absent.mcap", None, None]]


def test_a_record_that_cannot_be_written_is_an_error_of_its_flight(made, tmp_path):
    task, _ = made
    (tmp_path / "out/flight.json").unlink()
    (tmp_path / "out/flight.json").mkdir()
    record = written_record(task(), {"output": "out/flight.mcap", "error": None}, 1)
    assert (
        record["error"] == f"{tmp_path}/out/flight.json: not a file; give the output another name"
    )
    assert written_record(task(), {"error": "worse"}, 1)["error"] == "worse"


def test_a_name_too_long_for_the_file_system_is_an_error_of_its_flight(made):
    task = replace(made[0](), name="n" * 255)
    record = written_record(task, {"output": None, "error": None}, 1)
    assert record["error"].endswith(".json: cannot be written: File name too long")
