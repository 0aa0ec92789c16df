"""Names of flights: their files', told apart by folders, and kept from run to run."""

from __future__ import annotations

from pathlib import Path

import pytest

from tirgeo_ros.tools.season.season import flight_names


def record(bag, stamps=()):
    return {"season": {"bag": str(bag), "made_from": {"flight": list(stamps)}}}


def stamps_of(path):
    return [[Path(path).name, 100, hash(path)]]


def named(*paths, records=None):
    flights = {Path(path): stamps_of(path) for path in paths}
    names = flight_names(flights, records or {})
    return [names[Path(path)] for path in paths]


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["/a/one.mcap", "/a/two.db3"], ["one", "two"]),
        (["/a/rosbag2_2026.05", "/a/x.mcap.zstd"], ["rosbag2_2026.05", "x"]),
        (["/a/may/metadata.yaml"], ["may"]),
        (["/a/flight.mcap", "/b/flight.mcap", "/b/c.mcap"], ["a_flight", "b_flight", "c"]),
        (["/x/a/f.mcap", "/y/a/f.mcap", "/y/b/f.mcap"], ["x_a_f", "y_a_f", "b_f"]),
        (["/a/f.mcap", "/a/f.db3"], ["a_f", "a_f-2"]),
        (["/a/b_c.mcap", "/a_b/c.mcap", "/q/c.mcap", "/q/b_c.mcap"],
         ["a_b_c", "a_b_c-2", "q_c", "q_b_c"]),
    ],
)  # fmt: skip
def test_names(paths, names):
    assert named(*paths) == names
    assert len(set(names)) == len(names)


def test_a_flight_keeps_its_name_and_no_other_gets_it():
    records = {"flight": record("/a/flight.mcap", stamps_of("/a/flight.mcap"))}
    assert named("/a/flight.mcap", "/b/flight.mcap", records=records) == ["flight", "b_flight"]
    assert named("/b/flight.mcap", records=records) == ["b_flight"]


def test_a_flight_that_was_moved_keeps_its_name_and_its_copy_gets_another():
    """Known by its files' names, sizes and times of change."""
    stamps = stamps_of("/old/flight.mcap")
    records = {"may": record("/old/flight.mcap", stamps)}
    moved, copy = Path("/new/flight.mcap"), Path("/copy/flight.mcap")
    assert flight_names({moved: stamps}, records) == {moved: "may"}
    assert flight_names({moved: stamps, copy: stamps}, records) == {moved: "may", copy: "flight"}


def test_an_absent_flight_is_no_other_absent_one():
    nothing = [["flight.mcap", None, None]]
    records = {"flight": record("/old/flight.mcap", nothing)}
    path = Path("/new/flight.mcap")
    assert flight_names({path: nothing}, records) == {path: "new_flight"}


def test_a_link_has_its_own_name_and_keeps_it_where_it_leads_elsewhere(tmp_path):
    link = tmp_path / "may.mcap"
    link.symlink_to(tmp_path / "disk_1.mcap")
    assert flight_names({link: stamps_of(link)}, {}) == {link: "may"}
    records = {"spring": record(link)}
    link.unlink()
    link.symlink_to(tmp_path / "disk_2.mcap")
    assert flight_names({link: stamps_of(link)}, records) == {link: "spring"}
