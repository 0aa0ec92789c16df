"""Damaged bags through tirgeo import --map-topic: one line, or a bag and what was lost."""

from __future__ import annotations

import pytest
from damaged_files import read_damaged
from recorded_bags import record
from ros1_bags import BEGUN_NS, Bag

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.convert.import_flight import import_flight
from tirgeo_ros.tools.convert.import_mapped import MappedTopics

MAPPED = MappedTopics((("/xsens/imu", "imu/data"),))


def ros1_bag(path):
    bag = Bag()
    for k in range(200):
        at_ns = BEGUN_NS + k * 10_000_000
        bag.add(at_ns, "/xsens/imu", bag.imu(at_ns, (1, 0, 0, 0), (0, 0, 0.1), (0, 0, 9.8)))
    return bag.write(path, chunk_bytes=10_000)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """The same messages as a bag of ROS 1, as MCAP and as SQLite."""
    folder = tmp_path_factory.mktemp("whole")
    ros1 = ros1_bag(folder / "imu.bag")
    import_flight(ros1, folder / "imu.mcap", mapped=MAPPED)
    messages = [
        one._replace(topic="/xsens/imu") for one in BagReader(folder / "imu.mcap").messages()
    ]
    mcap, sqlite = (record(folder / form, [messages], form) for form in ("mcap", "sqlite3"))
    return ros1, next(mcap.glob("*.mcap")), next(sqlite.glob("*.db3"))


@pytest.mark.slow
@pytest.mark.parametrize("form", range(3))
def test_a_damaged_bag_gives_a_line_or_what_can_be_read(recordings, tmp_path, form):
    """Cut, with flipped bits, zeros and noise."""
    whole, path = recordings[form], tmp_path / recordings[form].name
    out = tmp_path / "out.mcap"

    def read(damaged):
        out.unlink(missing_ok=True)
        try:
            import_flight(damaged, out, mapped=MAPPED)
        except BagError:
            assert not out.exists()
            raise
        return list(BagReader(out).messages())

    assert read_damaged(read, whole.read_bytes(), path, 60) > 10


def test_what_a_cut_recording_lost_is_an_error_beside_the_bag(recordings, tmp_path):
    """As for the other commands: the rest is written, and the command ends with exit code 1."""
    whole = recordings[1].read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: len(whole) - 100])
    result = import_flight(path, tmp_path / "out.mcap", mapped=MAPPED)
    assert result["error"].startswith(f"{path}: ")
    assert "messages were read" in result["error"]
    assert len(list(BagReader(tmp_path / "out.mcap").messages())) == 200
