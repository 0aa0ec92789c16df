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
"""tirgeo import of serial captures: what the aircraft says of the sample flight, back to a bag."""

from __future__ import annotations

import json
import math
import os

import numpy as np
import pytest
from ros1_bags import messages

from tirgeo_ros.core.config import BagPlayerConfig
from tirgeo_ros.core.frames.rotations import heading_of
from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.link.framing import FrameReader, encode_frame
from tirgeo_ros.dji.protocol.rtk_gps_imu_broadcast import decode_broadcast, encode_broadcast
from tirgeo_ros.dji.simulator.aircraft import Aircraft, frames_of
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages import DJI_TOPICS, SENSED_SAMPLES
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.convert.import_capture import CaptureOptions
from tirgeo_ros.tools.convert.import_flight import import_flight

CDR = Cdr()
CUT_S = 6.0
KEY = "00112233445566778899aabbccddeeff" * 2
#: A second begins with an epoch of RTK's 5 Hz; the receiver's own latency is a parameter and
#: jitters by some milliseconds, and the next broadcast at 100 Hz says it.
DATE_NS = 20_000_000


def stamps(path, topic):
    return np.array([convert.stamp_ns(m) for m in messages(path, topic)])


@pytest.fixture(scope="module")
def flight(sample):
    """The sample's first seconds: arrival and sample."""
    reader = BagReader(sample / "flight.mcap")
    until_ns = reader.span_ns[0] + CUT_S * 1e9
    return [
        (m.log_time_ns, SENSED_SAMPLES[m.topic[1:]](CDR.deserialize(m.data, m.typename)))
        for m in reader.messages([f"/{topic}" for topic in DJI_TOPICS])
        if m.log_time_ns < until_ns
    ]


@pytest.fixture(scope="module")
def player(sample):
    return ParameterFile(sample / "params.yaml").config("bag_player", BagPlayerConfig)


@pytest.fixture(scope="module")
def capture(flight, player, tmp_path_factory):
    """A capture whose file is as old as the flight, so that its time zone can be found."""
    path = tmp_path_factory.mktemp("capture") / "capture.bin"
    aircraft = Aircraft(player.simulated_aircraft, places=player.aircraft)
    path.write_bytes(b"".join(frame.data for frame in frames_of(aircraft, flight)))
    os.utime(path, ns=(flight[-1][0], flight[-1][0]))
    return path


@pytest.fixture(scope="module")
def imported(capture, sample):
    target = capture.with_suffix(".mcap")
    return target, import_flight(capture, target, params=sample / "params.yaml")


@pytest.fixture
def import_changed(capture, sample, tmp_path):
    """Import other bytes, in a file as old as the capture; return the IMU's stamps, and all."""

    def imported_as(data, **options):
        path = tmp_path / "changed.bin"
        path.write_bytes(data)
        os.utime(path, ns=(capture.stat().st_mtime_ns,) * 2)
        target = tmp_path / "out.mcap"
        summary = import_flight(path, target, params=sample / "params.yaml", **options)
        return stamps(target, "/imu/data"), summary

    return imported_as


def broadcasts(data):
    return [decode_broadcast(frame.value) for frame in FrameReader().feed(data)]


def framed(parts):
    return b"".join(encode_frame(b"\x02\x00" + encode_broadcast(each)) for each in parts)


def test_every_topic_with_its_type(imported):
    path, summary = imported
    result = BagReader(path).topics()
    assert result == {f"/{name}": convert.TOPIC_TYPES[name] for name in DJI_TOPICS}
    assert summary["frames"]["skipped_bytes"] == 0
    assert "GMT+8" in summary["time"]


def test_the_time_is_that_of_the_receivers(imported, flight):
    """Stamps differ from the recorded ones by a constant, known to a part of a second."""
    path, _ = imported
    true = np.array([s.stamp_ns for _, s in flight if type(s).__name__ == "ImuSample"])
    result = stamps(path, "/imu/data")
    off_ns = result - true[-len(result) :]  # the first are held back till the unit is known
    assert len(true) - len(result) <= 1
    assert np.ptp(off_ns) <= 1_000_000  # the aircraft counts milliseconds
    assert abs(np.median(off_ns)) <= DATE_NS


def test_the_result_can_be_processed(imported, sample, tmp_path, capsys):
    """Heading against the truth: within the aircraft's whole degrees."""
    out = tmp_path / "out.mcap"
    params = ["--params", str(sample / "params.yaml"), "--no-images", "--json"]
    assert main(["process", str(imported[0]), "-o", str(out), *params]) == 0
    assert json.loads(capsys.readouterr().out)["state"] == "running"
    last = convert.body_pose(messages(out, "/tirgeo/odometry")[-1])
    truth = map(convert.body_pose, messages(sample / "truth.mcap", "/tirgeo/odometry"))
    true = min(truth, key=lambda pose: abs(pose.stamp_ns - last.stamp_ns))
    apart_rad = heading_of(last.q_nb) - heading_of(true.q_nb)
    assert abs(math.degrees(math.remainder(apart_rad, math.tau))) < 1.0


def test_the_zone_of_an_old_copy_is_the_documented_one(capture, imported, sample, tmp_path):
    copy = tmp_path / "copy.bin"
    copy.write_bytes(capture.read_bytes())
    summary = import_flight(copy, tmp_path / "out.mcap", params=sample / "params.yaml")
    assert "give --start-time if that is wrong by hours" in summary["warning"]
    outcome, expected = (stamps(p, "/imu/data") for p in (tmp_path / "out.mcap", imported[0]))
    assert outcome.tolist() == expected.tolist()


def test_without_a_date_times_count_from_power_up(capture, import_changed):
    dateless = (parts._replace(gps=None, rtk=None) for parts in broadcasts(capture.read_bytes()))
    result, summary = import_changed(framed(dateless))
    assert "the capture has no date" in summary["warning"]
    assert result[0] == 60_000_000_000  # what its clock shows


def test_garbage_and_cuts_lose_only_the_frames_they_hit(capture, imported, import_changed):
    """Bytes between frames, a flipped bit, and a last frame that is cut."""
    data = capture.read_bytes()
    frames = FrameReader().feed(data)
    middle, hit = frames[len(frames) // 2], frames[len(frames) // 3]
    noisy = bytearray(data[: frames[-1].offset + 40])
    noisy[hit.offset + 20] ^= 1
    noisy[middle.offset : middle.offset] = b"\xaa\x55garbage"
    result, summary = import_changed(noisy)
    assert summary["frames"]["frames"] == len(frames) - 2
    lost = hit.length + 40 + len(b"\xaa\x55garbage")
    assert f"{lost} bytes are in no frame" in summary["warning"]
    whole = stamps(imported[0], "/imu/data")
    assert set(result) <= set(whole)
    assert len(result) >= len(whole) - 2


def test_encrypted_frames_need_the_key(capture, imported, import_changed, tmp_path):
    pytest.importorskip("cryptography")
    plain, key = FrameReader().feed(capture.read_bytes()), bytes.fromhex(KEY)
    data = b"".join(encode_frame(f.data, sequence=f.sequence, key=key) for f in plain)
    import_changed(data, capture=CaptureOptions(key=KEY))
    assert (tmp_path / "out.mcap").read_bytes() == imported[0].read_bytes()
    with pytest.raises(DjiError, match="frames are encrypted: give --key"):
        import_changed(data)


def test_a_capture_without_any_time_is_refused(capture, import_changed, tmp_path):
    timeless = (parts._replace(time=None) for parts in broadcasts(capture.read_bytes()))
    with pytest.raises(DjiError, match=r"changed\.bin: it lacks the aircraft's time"):
        import_changed(framed(timeless))
    assert list(tmp_path.iterdir()) == [tmp_path / "changed.bin"]


@pytest.mark.parametrize("given", [None, 1_718_091_879_000_000_000])
def test_a_counter_of_long_ticks_is_recognised(capture, imported, import_changed, given):
    """Firmware of before 3.3 counts 2.5 ms; 100 Hz are four of them."""
    ticking = (
        parts._replace(time=parts.time._replace(time_ms=parts.time.time_ms * 2 // 5))
        for parts in broadcasts(capture.read_bytes())
    )
    result, _ = import_changed(framed(ticking), capture=CaptureOptions(start_ns=given))
    apart = result - stamps(imported[0], "/imu/data")
    assert np.ptp(apart) <= 2_500_000  # a tick
    assert given is not None or abs(np.median(apart)) <= 2_500_000


def test_an_aircraft_that_was_off_meanwhile_gives_a_warning(capture, imported, import_changed):
    """The receivers' seconds after the restart do not move the stamps before it."""
    text = broadcasts(capture.read_bytes())
    half = len(text) // 2
    begun_ms = text[half].time.time_ms
    second = (text[half].rtk or text[half].gps or text[half + 1].rtk).time
    later = [
        parts._replace(
            time=parts.time._replace(time_ms=parts.time.time_ms - begun_ms + 300),
            gps=parts.gps and parts.gps._replace(time=second + 100),
            rtk=parts.rtk and parts.rtk._replace(time=second + 100 + (number > 100)),
        )
        for number, parts in enumerate(text[half:])
    ]
    result, summary = import_changed(framed([*text[:half], *later]))
    assert "the aircraft's clock started again 1 times" in summary["warning"]
    assert abs(result[0] - stamps(imported[0], "/imu/data")[0]) <= DATE_NS
