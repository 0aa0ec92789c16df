"""tirgeo import of a ROS 1 bag: namespaces, pictures, and what cannot be imported."""

from __future__ import annotations

import json

import numpy as np
import pytest
from ros1_bags import BEGUN_NS, Bag, Flight, by_time, messages, parameters_file, wrapper_bag

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.convert.import_flight import import_flight
from tirgeo_ros.tools.convert.import_ros1 import Pictures


@pytest.fixture
def folder(tmp_path):
    parameters_file(tmp_path / "params.yaml")
    return tmp_path


def test_renamed_prefix_and_namespace(folder):
    source = wrapper_bag(Flight(duration_s=1.0), prefix="/uav1/dji_osdk_ros")
    bag = source.write(folder / "uav1.bag")
    params = folder / "params.yaml"
    import_flight(bag, folder / "plain.mcap", params=params)
    assert "/imu/data" in BagReader(folder / "plain.mcap").topics()
    import_flight(bag, folder / "uav1.mcap", params=params, namespace="/uav1/")
    topics = BagReader(folder / "uav1.mcap").topics()
    assert topics
    assert all(topic.startswith("/uav1/") for topic in topics)
    with pytest.raises(BagError, match=r"no topic of DJI's wrapper .* in namespace uav2; it has"):
        import_flight(bag, folder / "uav2.mcap", namespace="uav2")
    assert not (folder / "uav2.mcap").exists()


def test_what_is_wrong_is_told_and_the_rest_imported(folder, capsys):
    flight = Flight(duration_s=1.0)
    bag = wrapper_bag(flight)
    kept = [m for m in bag.messages if m[2] not in {"/dji_sdk/rtk_yaw", "/dji_sdk/gimbal_angle"}]
    bag.messages = kept
    for k in range(7):
        at_ns = BEGUN_NS + k
        bag.add(at_ns, "/dji_sdk/rtk_yaw", bag.new("std_msgs/msg/Float32", data=90.0))
        bag.add(at_ns, "/dji_sdk/rtk_position", bag.fix(at_ns, 0.0, 0.0, 0.0))
        bag.add(at_ns, "/dji_sdk/battery_state", bag.new("std_msgs/msg/UInt8", data=1))
    path = bag.write(folder / "wrong.bag")
    assert main(["import", str(path), "-o", str(folder / "wrong.mcap"), "--json"]) == 0
    out, err = capsys.readouterr()
    result = json.loads(out)
    rows = {row["topic"]: row for row in result["topics"]}
    yaw, position = rows["/dji_sdk/rtk_yaw"], rows["/dji_sdk/rtk_position"]
    assert (yaw["type"], yaw["expected"]) == ("std_msgs/msg/Float32", "std_msgs/msg/Int16")
    assert (yaw["messages"], yaw["refused"]) == (7, 7)
    assert (position["messages"], position["refused"]) == (12, 7)
    assert result["not_read"] == {"/dji_sdk/battery_state": "std_msgs/msg/UInt8"}
    assert set(result["written"]) == {
        *("/imu/data", "/gps/fix", "/gps/vel", "/rtk/fix", "/rtk/vel"),
    }
    assert err.count("\n") == 1
    for told in (
        "no usable messages of rtk_yaw, of gimbal_angle",
        "/dji_sdk/rtk_yaw: 7 of type std_msgs/msg/Float32, not std_msgs/msg/Int16",
        "/dji_sdk/rtk_position: 7 of 12 refused (no position yet: 0, 0 deg)",
        "geoid_undulation_m is not set",
    ):
        assert told in err


def test_pictures_go_on_as_they_are(folder):
    bag = wrapper_bag(Flight(duration_s=1.0))
    pixels = np.arange(12, dtype=np.uint8)
    for k in range(3):
        at_ns = BEGUN_NS + k * 100_000_000
        head = {"header": bag.header(at_ns, "camera")}
        image = bag.new(
            "sensor_msgs/msg/Image",
            height=3,
            width=4,
            encoding="mono8",
            is_bigendian=0,
            step=4,
            data=pixels + k,
            **head,
        )
        bag.add(at_ns + 5, "/flir/image", image)
        jpeg = bag.new("sensor_msgs/msg/CompressedImage", format="jpeg", data=pixels, **head)
        bag.add(at_ns + 6, "/flir/image/compressed", jpeg)
        bag.add(at_ns + 7, "/flir/camera_info", camera_info(bag, head))
    path = bag.write(folder / "pictures.bag")
    target = folder / "pictures.mcap"
    result = import_flight(path, target, pictures=Pictures("/flir/image", "flir/camera_info"))
    found = by_time(target, "/thermal/image_raw")
    assert [round(t_s, 9) for t_s, _ in found] == [0.0, 0.1, 0.2]
    assert [m.data.tolist() for _, m in found] == [(pixels + k).tolist() for k in range(3)]
    logged = [m.log_time_ns for m in BagReader(target).messages(["/thermal/image_raw"])]
    assert logged == [BEGUN_NS + k * 100_000_000 + 5 for k in range(3)]
    info = messages(target, "/thermal/camera_info")[0]
    camera = convert.camera(info)
    assert (camera.width, camera.fx, camera.cy) == (640, 760.0, 256.0)
    assert result["not_read"] == {"/flir/image/compressed": "sensor_msgs/msg/CompressedImage"}
    import_flight(path, target, pictures=Pictures("/flir/image/compressed"))
    assert messages(target, "/thermal/image_raw/compressed")[0].format == "jpeg"


def camera_info(bag, head):
    roi = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
    return bag.new(
        "sensor_msgs/msg/CameraInfo",
        height=512,
        width=640,
        distortion_model="plumb_bob",
        D=np.zeros(5),
        K=np.array([760.0, 0, 320, 0, 760, 256, 0, 0, 1]),
        R=np.eye(3).ravel(),
        P=np.zeros(12),
        binning_x=0,
        binning_y=0,
        roi=bag.new("sensor_msgs/msg/RegionOfInterest", **roi),
        **head,
    )


@pytest.mark.parametrize(
    ("pictures", "message"),
    [
        (Pictures("/none"), r"/none is not there; of type sensor_msgs/msg/Image or .* are: none"),
        (Pictures("/dji_sdk/imu"), r"/dji_sdk/imu is sensor_msgs/msg/Imu; of type"),
        (Pictures(camera_info="/x"), r"/x is not there; of type sensor_msgs/msg/CameraInfo are"),
    ],
)
def test_pictures_that_are_not_there(folder, pictures, message):
    path = folder / "no_pictures.bag"
    if not path.exists():
        wrapper_bag(Flight(duration_s=0.2)).write(path)
    with pytest.raises(BagError, match=message):
        import_flight(path, folder / "no.mcap", pictures=pictures)


def test_a_bag_that_was_cut_off_is_read_up_to_the_cut(folder, capsys):
    path = wrapper_bag(Flight(duration_s=1.0)).write(folder / "cut.bag", chunk_bytes=20_000)
    path.write_bytes(path.read_bytes()[:50_000])
    params = ["--params", str(folder / "params.yaml")]
    assert main(["import", str(path), "-o", str(folder / "cut.mcap"), *params]) == 1
    assert "cut.bag: no usable index: it was not closed, or cut off; " in capsys.readouterr().err
    assert len(messages(folder / "cut.mcap", "/imu/data")) > 20
    path.write_bytes(path.read_bytes()[:5_000])
    assert main(["import", str(path), "-o", str(folder / "none.mcap"), *params]) == 1
    assert "cut.bag: cannot be read: " in capsys.readouterr().err
    assert not (folder / "none.mcap").exists()


def head_of_sqlite(path):
    path.write_bytes(b"SQLite format 3\0" + bytes(100))


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda p: p.write_bytes(b""), "the file is empty"),
        (lambda p: p.write_text("stamp,latitude\n1,2\n"), "text in columns: say what they mean"),
        (lambda p: p.write_text("Dear diary\n"), "text of no known log: docs/import.md lists"),
        (lambda p: p.write_bytes(b"#ROSBAG V1.2\nxyz"), "a ROS 1 bag of an older version"),
        (lambda p: p.write_bytes(b"#ROSBAG V2.0\n"), "cannot be read: Header could not be read"),
        (
            lambda p: p.write_bytes(b"\x89MCAP0\r\n" + bytes(99)),
            "no message can be read; 99 bytes",
        ),
        (head_of_sqlite, "the database is cut off or damaged"),
        (lambda p: p.write_bytes(b"\x1f\x8b\x08" + bytes(99)), "packed with gzip"),
        (lambda p: p.mkdir(), "a directory; give a ROS 1 bag"),
        (lambda _: None, "cannot be read: No such file"),
        (lambda p: Bag().write(p), "the bag has no message"),
    ],
)
def test_what_cannot_be_imported(tmp_path, write, message, capsys):
    """By its content, whatever its name says; one line, and nothing is left behind."""
    path = tmp_path / "flight.bag"
    write(path)
    assert main(["import", str(path), "-o", str(tmp_path / "out.mcap")]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"tirgeo import: {path}: {message}")
    assert err.count("\n") == 1
    assert [p for p in tmp_path.iterdir() if p != path] == []


def test_the_bag_is_not_overwritten(folder):
    path = wrapper_bag(Flight(duration_s=0.2)).write(folder / "options.bag")
    with pytest.raises(BagError, match="would overwrite the input"):
        import_flight(path, path)
    assert path.exists()
