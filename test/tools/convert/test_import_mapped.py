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
"""tirgeo import --map-topic: any bag's topics become those of the contract; wrong use, damage."""

from __future__ import annotations

import math

import numpy as np
import pytest
from damaged_files import read_damaged
from recorded_bags import record
from ros1_bags import BEGUN_NS, Bag, by_time

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.measurements import FixStatus, Source
from tirgeo_ros.io.bags.bag import BagMessage, BagReader, Cdr
from tirgeo_ros.io.bags.ros1_bag import Ros1Bag
from tirgeo_ros.io.messages import NAVIGATION_INPUTS, TOPIC_TYPES
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.convert.import_flight import import_flight
from tirgeo_ros.tools.convert.import_mapped import MappedTopics

CDR = Cdr()
MAVROS = (
    ("/mavros/imu/data", "imu/data"),
    ("mavros/fix", "gps/fix"),
    ("/mavros/gps_vel", "gps/vel"),
    ("/mavros/compass_hdg", "rtk/heading"),
)
#: The IMU stands on its side: its y is up, its x east.
ON_SIDE = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)


def mavros_bag(seconds=3.0, force=(0.0, 0.0, 9.8), q=(1.0, 0.0, 0.0, 0.0), lag_ns=5_000_000):
    """A bag of ROS 1 with MAVROS's topics, of an aircraft at rest."""
    bag = Bag()
    for k in range(round(seconds * 100)):
        at_ns = BEGUN_NS + k * 10_000_000
        bag.add(at_ns + lag_ns, "/mavros/imu/data", bag.imu(at_ns, q, (0.0, 0.0, 0.1), force))
        if k % 20 == 0:
            fix = bag.fix(at_ns, 52.0116, 4.3575, 44.0, "/gps")
            bag.add(at_ns + lag_ns, "/mavros/fix", fix)
            bag.add(at_ns + lag_ns, "/mavros/gps_vel", twist_stamped(bag, at_ns, 1.0, 2.0, 3.0))
            compass = bag.new("std_msgs/msg/Float64", data=355.0)
            bag.add(at_ns + lag_ns, "/mavros/compass_hdg", compass)
            bag.add(at_ns + lag_ns, "/chatter", bag.new("std_msgs/msg/String", data="hello"))
    return bag


def twist_stamped(bag, at_ns, *linear):
    twist = bag.new(
        "geometry_msgs/msg/Twist", linear=bag.vector(*linear), angular=bag.vector(0, 0, 0)
    )
    return bag.new("geometry_msgs/msg/TwistStamped", header=bag.header(at_ns), twist=twist)


@pytest.fixture
def mapped(tmp_path):
    """Import a bag's topics; return the result. The new bag is out.mcap."""

    def imported(bag, pairs, **options):
        path = tmp_path / "a.bag"
        if not path.exists():
            bag.write(path)
        return import_flight(path, tmp_path / "out.mcap", mapped=MappedTopics(pairs, **options))

    return imported


def samples(path, source):
    topic, decode = NAVIGATION_INPUTS[source]
    return [decode(message) for _, message in by_time(path, f"/{topic}")]


def test_topics_of_ros_1_with_their_stamps_and_log_times(mapped, tmp_path):
    result, out = mapped(mavros_bag(), MAVROS), tmp_path / "out.mcap"
    assert BagReader(out).topics() == {f"/{to}": TOPIC_TYPES[to] for _, to in sorted(
        MAVROS, key=lambda pair: pair[1]
    )}  # fmt: skip
    imu = samples(out, Source.IMU)
    assert [sample.stamp_ns for sample in imu] == [BEGUN_NS + k * 10_000_000 for k in range(300)]
    assert imu[7].specific_force_b.tolist() == [0.0, 0.0, -9.8]
    logged = [message.log_time_ns for message in BagReader(out).messages(["/imu/data"])]
    assert logged == [sample.stamp_ns + 5_000_000 for sample in imu]
    (velocity, *_), (fix, *_) = (
        samples(out, Source.GPS_VELOCITY),
        samples(out, Source.GPS_POSITION),
    )
    assert velocity.velocity_n.tolist() == [2.0, 1.0, -3.0]
    assert not velocity.covariance_n.any()
    assert (math.degrees(fix.latitude_rad), fix.height_m) == (pytest.approx(52.0116), 44.0)
    (heading, *_) = samples(out, Source.RTK_HEADING)
    assert math.degrees(heading.heading_rad) == pytest.approx(355.0)
    assert heading.stamp_ns == BEGUN_NS + 5_000_000  # no header: when it was recorded
    assert result["not_read"] == {"/chatter": "std_msgs/msg/String"}
    assert result["warning"] is None
    message = " ".join(result["notes"])
    for words in ("above the ellipsoid", "no covariance", "no heading of two"):
        assert words in message
    assert [row["lag_s"] for row in result["topics"]] == pytest.approx([0.005, 0.005, 0.005, 0.0])


def test_pictures_and_gimbal_go_on_byte_by_byte_into_a_namespace(sample, tmp_path):
    names = ("thermal/image_raw/compressed", "thermal/camera_info", "gimbal/joint_states")
    names += ("gimbal/attitude",)
    path, out = sample / "flight.mcap", tmp_path / "out.mcap"
    mapped = MappedTopics(tuple((name, name) for name in names))
    import_flight(path, out, namespace="uav1", mapped=mapped)
    whole = [item for item in BagReader(path).messages() if item.topic.strip("/") in names]
    outcome = [item._replace(topic=item.topic[5:]) for item in BagReader(out).messages()]
    assert sorted(outcome) == sorted(whole)


def test_an_odometry_becomes_a_velocity_east_north_up(mapped, tmp_path):
    """Forward 2 m/s with the nose to the north; the covariance turns along."""
    bag = Bag()
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.diag([0.04, 0.01, 0.09])
    half, linear, zero = math.radians(45), bag.vector(2, 0.5, -1), bag.vector(0, 0, 0)
    orientation = bag.quaternion((math.cos(half), 0, 0, math.sin(half)))
    origin = bag.new("geometry_msgs/msg/Point", x=0.0, y=0.0, z=0.0)
    pose = bag.new("geometry_msgs/msg/Pose", position=origin, orientation=orientation)
    twist = bag.new("geometry_msgs/msg/Twist", linear=linear, angular=zero)
    uncertain = {"covariance": covariance.ravel()}
    odometry = bag.new(
        "nav_msgs/msg/Odometry",
        header=bag.header(BEGUN_NS, "odom"),
        child_frame_id="base_link",
        pose=bag.new("geometry_msgs/msg/PoseWithCovariance", pose=pose, **uncertain),
        twist=bag.new("geometry_msgs/msg/TwistWithCovariance", twist=twist, **uncertain),
    )
    bag.add(BEGUN_NS, "/odom", odometry)
    result = mapped(bag, (("/odom", "rtk/vel"),))
    (velocity,) = samples(tmp_path / "out.mcap", Source.RTK_VELOCITY)
    assert velocity.velocity_n == pytest.approx((2.0, -0.5, 1.0))
    assert velocity.covariance_n.diagonal() == pytest.approx((0.04, 0.01, 0.09))
    assert "wheel odometry" in result["notes"][0]


def test_an_imu_on_its_side_gives_a_warning_and_is_rotated(tmp_path, capsys):
    bag = mavros_bag(force=(0.0, 9.8, 0.0), q=ON_SIDE)
    path, out = bag.write(tmp_path / "side.bag"), tmp_path / "out.mcap"
    words = ["import", str(path), "-o", str(out), "--map-topic", "/mavros/imu/data=imu/data"]
    assert main(words) == 0
    message = capsys.readouterr().err
    assert "imu/data: gravity is on +y at the beginning, not on +z" in message
    assert "give --imu-rpy 90 0 YAW" in message
    assert main([*words, "--imu-rpy", "90", "0", "0"]) == 0
    assert capsys.readouterr().err == ""
    sample = samples(out, Source.IMU)[0]
    assert sample.specific_force_b == pytest.approx((0.0, 0.0, -9.8))
    assert sample.angular_rate_b == pytest.approx((0.0, 0.1, 0.0))
    # Its own attitude was on its side; the body's is level, with the nose to the east.
    q_nb = sample.autopilot_q_nb
    assert abs(q_nb @ [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]) == pytest.approx(1.0)
    # Parameters that turn it later are no cause for doubt.
    params = tmp_path / "params.yaml"
    params.write_text("/**:\n  ros__parameters:\n    aircraft.imu_rpy_deg: [90.0, 0.0, 0.0]\n")
    assert main([*words, "--params", str(params)]) == 0
    assert capsys.readouterr().err == ""


def test_heights_above_the_sea_and_fixes_without_rtk(mapped, tmp_path):
    result = mapped(mavros_bag(), (("/mavros/fix", "rtk/fix"),), undulation_m=43.5)
    first = samples(tmp_path / "out.mcap", Source.RTK_POSITION)[0]
    assert (first.height_m, first.status) == (87.5, FixStatus.SINGLE)
    assert result["notes"] == []
    assert "no message has status 1 (float) or 2 (fixed)" in result["warning"]
    assert "map it to gps/fix" in result["warning"]


def test_stamps_of_another_clock_are_kept_with_a_warning(mapped, tmp_path):
    result = mapped(mavros_bag(lag_ns=7_200_000_000_000), MAVROS[:2])
    assert samples(tmp_path / "out.mcap", Source.IMU)[0].stamp_ns == BEGUN_NS
    assert "(/mavros/imu/data -7200.0 s, /mavros/fix -7200.0 s) and are kept" in result["warning"]


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        (
            [("/x", "imu/data")],
            r"/x is not in the bag; imu/data takes sensor_msgs/msg/Imu, the type of /mavros/imu",
        ),
        (
            [("/mavros/imu/data", "gps/vel")],
            r"/data is of type sensor_msgs/msg/Imu; gps/vel takes .*Odometry, the type of /mav",
        ),
        ([("/chatter", "baro/pressure")], r"FluidPressure, the type of no topic of the bag"),
        (
            [("/mavros/fix", "gps/fix"), ("/mavros/fix", "gps/fix")],
            r"two topics for gps/fix: give one",
        ),
    ],
)
def test_topics_that_do_not_fit_are_named(mapped, tmp_path, pairs, message):
    with pytest.raises(BagError, match=rf"^{tmp_path}/a\.bag: .*{message}"):
        mapped(mavros_bag(0.2), tuple(pairs))
    assert not (tmp_path / "out.mcap").exists()


def test_pictures_that_are_not_imported_are_named_with_their_option(tmp_path, capsys):
    bag = mavros_bag()
    header = bag.header(BEGUN_NS)
    kind = bag.store.types["sensor_msgs/msg/CompressedImage"]
    bag.add(BEGUN_NS, "/cam/compressed", kind(header, "jpeg", np.zeros(1, np.uint8)))
    path = bag.write(tmp_path / "a.bag")
    words = f"import {path} -o {tmp_path}/out.mcap --map-topic /mavros/imu/data=imu/data"
    assert main(words.split()) == 0
    message = "pictures in the bag that --map-topic may name: /cam/compressed"
    assert message in capsys.readouterr().out


def test_a_joint_state_without_the_gimbals_joints_is_refused(mapped):
    bag = mavros_bag(0.5)
    doubles = {name: np.zeros(1) for name in ("position", "velocity", "effort")}
    for k in range(4):
        joints = bag.new(
            "sensor_msgs/msg/JointState",
            header=bag.header(BEGUN_NS),
            name=["front_left_wheel"],
            **doubles,
        )
        bag.add(BEGUN_NS + k, "/joint_states", joints)
    pair = ("/joint_states", "gimbal/joint_states")
    with pytest.raises(
        BagError, match=r"nothing to import: /joint_states: 4 of 4 refused \(.*yaw"
    ):
        mapped(bag, (pair,))
    result = mapped(bag, (*MAVROS[:1], pair))
    assert "/joint_states: 4 of 4 refused" in result["warning"]


def test_a_bag_without_pairs_is_answered_with_options(tmp_path, capsys):
    ros1 = mavros_bag(0.2).write(tmp_path / "a.bag")
    assert main(["import", str(ros1), "-o", str(tmp_path / "out.mcap")]) == 1
    asked = "--map-topic /mavros/imu/data=imu/data --map-topic /mavros/fix=gps/fix --map-topic "
    assert f"{asked}/mavros/gps_vel=gps/vel\n" in capsys.readouterr().err
    ros2 = tmp_path / "b"
    bag = Ros1Bag(ros1)
    data = bag.cdr(next(bag.messages(["/mavros/imu/data"])))
    record(ros2, [[BagMessage("/xsens/imu", "sensor_msgs/msg/Imu", 1, data)]])
    assert main(["import", str(ros2), "-o", str(tmp_path / "out.mcap")]) == 1
    line = f"{ros2}: a ROS 2 bag; name its topics, for example --map-topic /xsens/imu=imu/data\n"
    assert line in capsys.readouterr().err
    record(tmp_path / "c", [[BagMessage("/chatter", "std_msgs/msg/String", 1, b"\0\1\0\0")]])
    assert main(["import", str(tmp_path / "c"), "-o", str(tmp_path / "out.mcap")]) == 1
    line = "nothing to import: no topic has a type that tirgeo takes; it has /chatter (std_msgs/m"
    assert line in capsys.readouterr().err
    record(tmp_path / "d", [[BagMessage("/imu/data", "sensor_msgs/msg/Imu", 1, data)]])
    assert main(["import", str(tmp_path / "d"), "-o", str(tmp_path / "out.mcap")]) == 1
    assert "it needs no import: give it to tirgeo process" in capsys.readouterr().err


_PAIR = "give FROM=TO, TO one of imu/data, rtk/fix"


@pytest.mark.parametrize(
    ("options", "why"),
    [
        *(
            (f"--map-topic {word}", f"--map-topic {word}: {_PAIR}")
            for word in ("/a", "/a=", "=imu/data", "/a=tirgeo/odometry", "/a=/imu")
        ),
        ("--imu-rpy 90 0 0", "--imu-rpy is for --map-topic"),
        ("--map-topic /a=imu/data --set-heading 0", "--set-heading is for logs, not for --map-t"),
        ("--map-topic /a=imu/data --rover-first", "--rover-first is for logs"),
        ("--map-topic /a=imu/data --height sea", "--height is for logs"),
        ("--map-topic /a=imu/data --image-topic /a", "use --map-topic TOPIC=thermal/image_raw, t"),
    ],
)
def test_options_that_a_bag_does_not_take_are_wrong_use(tmp_path, options, why, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(f"import a.bag -o {tmp_path}/out.mcap {options}".split())
    assert why in capsys.readouterr().err


@pytest.fixture(scope="module")
def bags(shared):
    return shared / "foreign_logs"


def recordings(bags):
    return sorted((bags / "rosbag2").iterdir())


def test_every_recording_gets_an_answer(bags, tmp_path, capsys):
    """The simulated ones need no import; the real ones hold nothing that tirgeo takes."""
    for path in recordings(bags):
        assert main(["import", str(path), "-o", str(tmp_path / "out.mcap")]) == 1
        message = capsys.readouterr().err
        words = (
            "needs no import" if path.name.startswith("made_") else "nothing to import: no topic"
        )
        assert message.startswith(f"tirgeo import: {path}: a ROS 2 bag; ")
        assert words in message
        assert message.count("\n") == 1
    split = bags / "rosbag2" / "real_mcap_split_no_metadata"
    assert sum(1 for _ in BagReader(split).messages()) == 3177


def test_every_form_of_a_recording_gives_the_same_bag(bags, tmp_path):
    """Ten forms of the same messages, under other names: the same bytes out."""
    names = {"imu/data": "imu/data", "rtk/fix": "gps/fix", "rtk/vel": "gps/vel"}
    mapped = MappedTopics(tuple((f"/{own}", name) for own, name in names.items()))
    outcome = set()
    for path in recordings(bags):
        if path.name.startswith("made_"):
            result = import_flight(path, tmp_path / "out.mcap", mapped=mapped)
            assert result["error"] is None
            assert result["written"]["/imu/data"]["messages"] == 600
            outcome.add((tmp_path / "out.mcap").read_bytes())
    assert len(outcome) == 1


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
        item._replace(topic="/xsens/imu") for item in BagReader(folder / "imu.mcap").messages()
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
