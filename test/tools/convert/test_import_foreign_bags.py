"""Bags of others through tirgeo import --map-topic: every field by rosbags, damage in one line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from damaged_files import read_damaged
from recorded_bags import record
from ros1_bags import BEGUN_NS, Bag
from rosbags.highlevel import AnyReader

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.measurements import Source
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages import NAVIGATION_INPUTS
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.convert.import_flight import import_flight
from tirgeo_ros.tools.convert.import_mapped import MappedTopics

CDR = Cdr()
GLOBAL = "/mavros/global_position"


@pytest.fixture(scope="module")
def bags(shared):
    return shared / "foreign_logs"


def source_of(path, typenames):
    """Messages by topic as rosbags reads them: record time, message."""
    found = {}
    with AnyReader([path]) as reader:
        wanted = [one for one in reader.connections if one.msgtype in typenames]
        for connection, at_ns, data in reader.messages(wanted):
            one = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((at_ns, one))
    return found


def imported(path, topic):
    return [
        (one.log_time_ns, CDR.deserialize(one.data, one.typename))
        for one in BagReader(path).messages([topic])
    ]


def plain(message):
    """Return a message's values, without constants and the sequence number of ROS 1."""
    if hasattr(message, "__dataclass_fields__"):
        names = [name for name in message.__dataclass_fields__ if name.islower() and name != "seq"]
        return {name: plain(getattr(message, name)) for name in names if name[0] != "_"}
    return message.tolist() if isinstance(message, np.ndarray) else message


@pytest.mark.slow
def test_a_ground_robots_bag_field_by_field(bags, tmp_path):
    """Each message as it was, at its time; its wheels' odometry turned by its attitude."""
    path, out = bags / "ros1" / "husky_imu_fix.bag", tmp_path / "out.mcap"
    odom = "/husky_velocity_controller/odom"
    pairs = (("/imu/data", "imu/data"), ("/fix", "gps/fix"), (odom, "gps/vel"))
    result = import_flight(path, out, mapped=MappedTopics(pairs))
    kinds = ("sensor_msgs/msg/Imu", "sensor_msgs/msg/NavSatFix", "nav_msgs/msg/Odometry")
    theirs = source_of(path, kinds)
    for topic, name in (("/imu/data", "/imu/data"), ("/fix", "/gps/fix")):
        ours = imported(out, name)
        assert len(ours) == len(theirs[topic])
        for (at_ns, one), (their_ns, other) in zip(ours, theirs[topic], strict=True):
            assert (at_ns, plain(one)) == (their_ns, plain(other))
    ours = imported(out, "/gps/vel")
    for (at_ns, one), (their_ns, other) in zip(ours, theirs[odom], strict=True):
        assert (at_ns, plain(one.header.stamp)) == (their_ns, plain(other.header.stamp))
        q, forward = other.pose.pose.orientation, other.twist.twist.linear.x
        yaw = 2 * math.atan2(q.z, q.w)
        expected = forward * math.cos(yaw), forward * math.sin(yaw)
        # The robot's attitude has a tilt of rounding alone; 1 m/s at most.
        linear = one.twist.twist.linear
        assert (linear.x, linear.y) == pytest.approx(expected, abs=1e-9)
    assert "gravity is on +y at the beginning" in result["warning"]
    assert "--imu-rpy 91 0 YAW" in result["warning"]
    assert "989 of status 1 and covariance type 1" in " ".join(result["notes"])


def test_mavros_names_field_by_field(bags, tmp_path):
    path, out = bags / "ros1" / "made_mavros.bag", tmp_path / "out.mcap"
    pairs = (
        ("/mavros/imu/data", "imu/data"),
        (f"{GLOBAL}/raw/fix", "gps/fix"),
        (f"{GLOBAL}/raw/gps_vel", "gps/vel"),
        (f"{GLOBAL}/compass_hdg", "rtk/heading"),
    )
    result = import_flight(path, out, mapped=MappedTopics(pairs))
    assert result["warning"] is None
    kinds = ("Imu", "NavSatFix")
    theirs = source_of(path, [f"sensor_msgs/msg/{kind}" for kind in kinds])
    theirs |= source_of(path, ["geometry_msgs/msg/TwistStamped", "std_msgs/msg/Float64"])
    for topic, name in pairs[:2]:
        ours = [(at_ns, plain(one)) for at_ns, one in imported(out, f"/{name}")]
        assert ours == [(at_ns, plain(one)) for at_ns, one in theirs[topic]]
    ours = imported(out, "/gps/vel")
    for (_, one), (_, other) in zip(ours, theirs[pairs[2][0]], strict=True):
        assert plain(one.twist.twist.linear) == plain(other.twist.linear)
        assert plain(one.header.stamp) == plain(other.header.stamp)
    decode = NAVIGATION_INPUTS[Source.RTK_HEADING][1]
    ours = imported(out, "/rtk/heading")
    for (at_ns, one), (their_ns, other) in zip(ours, theirs[pairs[3][0]], strict=True):
        sample = decode(one)
        assert (at_ns, sample.stamp_ns) == (their_ns, their_ns)
        assert math.degrees(sample.heading_rad) == pytest.approx(other.data, abs=1e-10)


def recordings(bags):
    return sorted((bags / "rosbag2").iterdir())


def test_every_recording_is_answered(bags, tmp_path, capsys):
    """The made ones need no import; the real ones hold nothing that tirgeo takes."""
    for path in recordings(bags):
        assert main(["import", str(path), "-o", str(tmp_path / "out.mcap")]) == 1
        told = capsys.readouterr().err
        words = (
            "needs no import" if path.name.startswith("made_") else "nothing to import: no topic"
        )
        assert told.startswith(f"tirgeo import: {path}: a ROS 2 bag; ")
        assert words in told
        assert told.count("\n") == 1


def test_every_form_of_a_recording_gives_the_same_bag(bags, tmp_path):
    """Ten forms of the same messages, under other names: the same bytes out."""
    names = {"imu/data": "imu/data", "rtk/fix": "gps/fix", "rtk/vel": "gps/vel"}
    mapped = MappedTopics(tuple((f"/{own}", name) for own, name in names.items()))
    found = set()
    for path in recordings(bags):
        if path.name.startswith("made_"):
            result = import_flight(path, tmp_path / "out.mcap", mapped=mapped)
            assert result["error"] is None
            assert result["written"]["/imu/data"]["messages"] == 600
            found.add((tmp_path / "out.mcap").read_bytes())
    assert len(found) == 1


MAPPED = MappedTopics((("/xsens/imu", "imu/data"),))


def ros1_bag(path):
    bag = Bag()
    for k in range(200):
        at_ns = BEGUN_NS + k * 10_000_000
        bag.add(at_ns, "/xsens/imu", bag.imu(at_ns, (1, 0, 0, 0), (0, 0, 0.1), (0, 0, 9.8)))
    return bag.write(path, chunk_bytes=10_000)


@pytest.fixture(scope="module")
def two_recordings(tmp_path_factory):
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
def test_a_damaged_bag_gives_a_line_or_what_can_be_read(two_recordings, tmp_path, form):
    """Cut, with flipped bits, zeros and noise."""
    whole, path = two_recordings[form], tmp_path / two_recordings[form].name
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


def test_what_a_cut_recording_lost_is_an_error_beside_the_bag(two_recordings, tmp_path):
    """As for the other commands: the rest is written, and the command ends with exit code 1."""
    whole = two_recordings[1].read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: len(whole) - 100])
    result = import_flight(path, tmp_path / "out.mcap", mapped=MAPPED)
    assert result["error"].startswith(f"{path}: ")
    assert "messages were read" in result["error"]
    assert len(list(BagReader(tmp_path / "out.mcap").messages())) == 200
