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
"""Faults of lens, ground and latency by the motion of pictures; stamps and rates of pictures."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from checked_flights import CheckedFlight, checked_flight, picture_findings, recomposed
from scenes import graticule

from tirgeo_ros.core.checks.motion_fit import MotionFit
from tirgeo_ros.core.checks.picture_checks import FrameStamps, PictureChecks, motion_findings
from tirgeo_ros.core.checks.picture_motion import PictureTracker
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.ground.backprojection import Terrain
from tirgeo_ros.core.types.finding import Severity


@pytest.fixture(scope="module")
def flight(sample):
    return checked_flight(sample)


def mapped(flight, kind, change):
    """Return the flight with changed samples of a kind."""
    events = tuple(
        item._replace(sample=change(item.sample)) if item.topic == kind else item
        for item in flight.events
    )
    return CheckedFlight(flight.configs, events)


def reshot(flight, change):
    """Return the flight with its pictures (uint8) changed by ``change``."""
    return mapped(flight, "frame", lambda frame: (frame[0], change(frame[1])))


def test_the_sample_flight_is_right(flight):
    assert picture_findings(flight, each_second=True) == []


def reported_latency(findings):
    """Return the latency and its sigma, s, from the finding of a wrong latency."""
    [finding] = (item for item in findings if item.check == "video_latency")
    assert finding.parameter == "overlay_node video_latency_s"
    reported_s, _, _, sigma_s = finding.evidence.split(" by ")[1].split()[:4]
    return float(reported_s), float(sigma_s.rstrip("),"))


@pytest.mark.parametrize("latency_s", [0.0, 0.1, 0.15, 0.25, 0.45, 0.55, -0.35, -0.9])
def test_a_wrong_latency_is_reported_with_the_right_one(flight, latency_s):
    overlay = replace(flight.configs.overlay, video_latency_s=latency_s)
    findings = picture_findings(flight, overlay=overlay)
    assert len(findings) == 1
    reported_s, _ = reported_latency(findings)
    assert abs(reported_s - 0.05) < 0.012  # 4 sigma of the fit, 3 ms each


@pytest.mark.parametrize("late_s", [1.3, 2.0, -0.8])
def test_pictures_that_are_later_still_contradict_the_poses(flight, late_s):
    late = mapped(flight, "frame", lambda what: (what[0] + round(late_s * 1e9), what[1]))
    findings = picture_findings(late)
    assert ("picture_motion", Severity.STOP) in [(item.check, item.severity) for item in findings]


@pytest.mark.parametrize("shift_s", [0.005, -0.005])
def test_the_sigma_of_a_latency_holds_what_all_pictures_share(flight, shift_s):
    """Poses are stamped to half a sample of the IMU, which has the effect of a latency."""
    overlay = replace(flight.configs.overlay, video_latency_s=0.25)
    shift_ns = round(shift_s * 1e9)
    shifted = mapped(flight, "pose", lambda pose: replace(pose, stamp_ns=pose.stamp_ns + shift_ns))
    reported_s, sigma_s = reported_latency(picture_findings(shifted, overlay=overlay))
    assert abs(reported_s - 0.05) < 2 * sigma_s


def test_a_straight_flight_gives_a_latency_with_an_honest_sigma(flight):
    """Noise of the poses once looked like turns: 0.2 s off, with a sigma of 0.007."""
    begin_ns = flight.events[0].arrival_ns + 14 * 10**9
    straight = CheckedFlight(
        flight.configs,
        tuple(
            item
            for item in flight.events
            if item.topic == "camera" or 0 <= item.arrival_ns - begin_ns < 12.5e9
        ),
    )
    overlay = replace(flight.configs.overlay, video_latency_s=0.25)
    reported_s, sigma_s = reported_latency(picture_findings(straight, overlay=overlay))
    assert abs(reported_s - 0.05) < 2 * sigma_s
    assert 0.01 < sigma_s < 0.03


NO_LATENCY = MotionFit(
    values=np.zeros(6),
    sigmas=np.array([0.05, 0.001, 0.001, 0.001, 0.001, 0.001]),
    assumed=(True, *[False] * 5),
    pairs=48,
    before=0.3,
    after=0.3,
    moved=5.0,
    without=(0.3,) * 4,
    above_m=20.0,
    height_sigma_m=0.02,
    angle_sigma_rad=0.005,
    step_s=0.1,
)


@pytest.mark.parametrize(
    ("pairs", "off_s", "checks"),
    [(34, 0.05, []), (34, 0.15, ["video_latency"]), (50, 0.05, ["video_latency"])],
)
def test_a_turning_heading_of_a_new_filter_is_no_latency(pairs, off_s, checks):
    """The soak's good flight: 0.05 s off after 34 pairs, at 7 sigma, 0.013 s after 50."""
    values, sigmas = np.array([off_s, *[0.0] * 5]), np.array([0.007, *[0.001] * 5])
    changes = {"assumed": (False,) * 6, "without": (0.6,) * 4, "sigmas": sigmas}
    fit = replace(NO_LATENCY, pairs=pairs, values=values, **changes)
    assert [item.check for item in motion_findings(fit, 0.05, 800.0, "", "")] == checks


def test_a_flight_that_does_not_show_the_latency_gives_a_note():
    [finding] = motion_findings(NO_LATENCY, 0.05, 800.0, "", "")
    assert finding.severity is Severity.NOTE
    assert "does not show the latency" in finding.evidence
    vague = replace(NO_LATENCY, assumed=(False,) * 6, values=np.array([0.2, *[0.0] * 5]))
    assert motion_findings(vague, 0.05, 800.0, "", "") == [finding]
    reports = replace(NO_LATENCY, assumed=(False,) * 6)
    assert motion_findings(reports, 0.05, 800.0, "", "") == []


@pytest.mark.parametrize(
    ("turned", "words"),
    [
        (lambda pixels: pixels[:, ::-1], "are mirrored:"),
        (lambda pixels: pixels[::-1, ::-1], "are upside down:"),
        (lambda pixels: pixels[::-1], "are upside down and mirrored:"),
    ],
)
def test_pictures_that_are_turned_are_named(flight, turned, words):
    [finding] = picture_findings(reshot(flight, lambda pixels: turned(pixels).copy()))
    assert (finding.check, finding.severity) == ("picture_turned", Severity.STOP)
    assert words in finding.evidence
    assert finding.parameter == "thermal/image_raw"


@pytest.mark.parametrize(("factor", "severity"), [(1.3, 2), (0.8, 2), (1.1, 1)])
def test_a_wrong_focal_length_is_reported_with_the_right_one(flight, factor, severity):
    def longer(camera):
        return replace(camera, fx=camera.fx * factor, fy=camera.fy * factor)

    [finding] = picture_findings(flight, lens=longer)
    assert finding.check == "focal_length"
    assert finding.severity == severity
    assert finding.parameter == "thermal/camera_info"
    reported_px = float(finding.evidence.split(" were ")[1].split()[0])
    # The effect of the lens's distortion with another focal length is not modelled: 1 in 50.
    assert reported_px == pytest.approx(803.6, rel=0.025)


def test_a_lens_of_another_size_stops(flight):
    def lens(camera):
        return replace(camera, width=camera.width * 2, height=camera.height * 2)

    findings = picture_findings(flight, lens=lens)
    assert {item.check for item in findings if item.severity} == {
        "picture_size",
        "principal_point",
    }
    assert max(finding.severity for finding in findings) is Severity.STOP


@pytest.mark.parametrize(
    ("height_m", "check"),
    [(11.5 - 47, "ground_by_motion"), (11.5 + 9, "ground_by_motion"), (11.5 + 47, "below_ground")],
)
@pytest.mark.parametrize("as_model", [True, False])
def test_ground_above_sea_level_is_reported(flight, height_m, check, as_model):
    overlay = replace(flight.configs.overlay, ground_height_m=height_m)
    place = graticule((39.84, 116.69), (0.005, 0.005), 5)
    ground = Terrain(np.full((5, 5), height_m), place) if as_model else None
    [finding] = picture_findings(flight, overlay=overlay, ground=ground)
    assert finding.check == check
    assert finding.severity is Severity.STOP
    name = "dem_undulation_m" if as_model else "ground_height_m"
    assert name in finding.parameter


@pytest.mark.parametrize(
    "fault",
    [
        lambda joints: replace(joints, roll_rad=joints.pitch_rad, pitch_rad=joints.roll_rad),
        lambda joints: replace(joints, yaw_rad=-joints.yaw_rad),
    ],
)
def test_pictures_contradict_joints_that_are_wrong(flight, fault):
    [finding] = picture_findings(recomposed(flight, fault))
    assert (finding.check, finding.severity) == ("picture_motion", Severity.STOP)
    assert "gimbal/joint_states" in finding.parameter


def askew(joints):
    """Change the joints so that the camera hangs 5 deg lower than they say, 3 deg to the right."""
    pitch_rad = joints.pitch_rad + math.radians(5.0)
    return replace(joints, pitch_rad=pitch_rad, yaw_rad=joints.yaw_rad - math.radians(3.0))


@pytest.mark.slow
def test_a_camera_askew_is_reported_with_the_boresight_that_mends_it(flight):
    faulty = recomposed(flight, askew)
    [finding] = picture_findings(faulty)
    assert finding.check == "boresight_by_motion"
    reports = finding.evidence.split("yaw ")[1].split(";")[0].split(", ")
    boresight = replace(flight.configs.gimbal, boresight_rpy_deg=tuple(map(float, reports)))
    assert picture_findings(recomposed(flight, askew, boresight)) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "change", [lambda grey: grey.astype(np.uint16) * 20 + 7000, lambda grey: np.dstack([grey] * 3)]
)
def test_sixteen_bits_and_colours_are_followed_too(flight, change):
    overlay = replace(flight.configs.overlay, video_latency_s=0.25)
    [finding] = picture_findings(reshot(flight, change), overlay=overlay)
    assert finding.check == "video_latency"


def test_a_latency_that_nobody_gave_is_a_note(flight):
    checks = PictureChecks(OverlayConfig(), math.nan, explicit=())
    for kind, what, at in flight.events[:3000]:
        if kind == "frame":
            checks.frame(*what, at)
    [finding] = checks.findings()
    assert finding.check == "latency_default"
    assert finding.severity is Severity.NOTE


STEP_NS = 111_000_000


def cut(right, down, width=640, height=512):
    """Return a part of blurred noise, which can be tracked everywhere."""
    noise = np.random.default_rng(0).normal(0.0, 1.0, (1300, 1600)).astype(np.float32)
    blurred = cv2.GaussianBlur(noise, (0, 0), 6.0)
    scene = np.clip(128 + 60 * blurred / blurred.std(), 0, 255).astype(np.uint8)
    return scene[100 + down : 100 + down + height, 100 + right : 100 + right + width]


def taken(*pictures, step_ns=STEP_NS):
    tracker = PictureTracker()
    result = [tracker.take(10**9 + k * step_ns, item) for k, item in enumerate(pictures)]
    return tracker, [item for item in result if item is not None]


@pytest.mark.parametrize("size", [(640, 512), (336, 256), (1280, 1024), (500, 400)])
@pytest.mark.parametrize("shift", [(0, 6), (40, -12), (3, 0)])
def test_a_shift_is_followed(size, shift):
    shift = tuple(px * size[0] // 640 for px in shift)
    _, [tracks] = taken(cut(0, 0, *size), cut(*shift, *size))
    # A quarter of a pixel of the small picture, which is four times smaller at the most.
    moved = tracks.second - tracks.first
    assert np.abs(np.median(moved, axis=0) + shift).max() < 0.5
    assert len(tracks.first) >= 6


def test_a_crosshair_stays_and_is_left_out():
    first, second = cut(0, 0).copy(), cut(20, 8).copy()
    for item in (first, second):
        item[250:262, 300:340] = 255
        item[236:276, 314:326] = 255
    _, [tracks] = taken(first, second)
    assert (np.linalg.norm(tracks.second - tracks.first, axis=1) > 5.0).all()


def test_what_cannot_be_followed_gives_nothing():
    flat = np.full((512, 640), 80, np.uint8)
    assert taken(flat, flat)[1] == []
    assert taken(cut(0, 0), cut(0, 0, 320, 256))[1] == []
    assert taken(cut(0, 0, 24, 20), cut(2, 0, 24, 20))[1] == []
    assert taken(cut(0, 0), cut(6, 0), step_ns=-STEP_NS)[1] == []
    assert taken(cut(0, 0), cut(6, 0).astype(np.uint16))[1] == []  # a camera that changes depth


PERIOD_NS = 100_000_000
START_NS = 1_700_000_000 * 10**9


@pytest.mark.parametrize(
    ("stamp", "checks"),
    [
        (lambda k: START_NS + k * PERIOD_NS, []),
        # On a busy computer a few frames come late.
        (lambda k: START_NS + (k - 15 * (k < 30)) * PERIOD_NS, []),
        (lambda k: 0 * k, ["picture_stamps_zero"]),
        (lambda k: START_NS + (k + 5) * PERIOD_NS, ["picture_stamps_ahead"]),
        (lambda k: START_NS + (k - 15) * PERIOD_NS, ["picture_stamps_late"]),
        (lambda k: START_NS + (k - 36000) * PERIOD_NS, ["picture_stamps_late", "picture_clock"]),
        (lambda k: START_NS + (k // 2) * 2 * PERIOD_NS, ["picture_stamps_back"]),
    ],
)
def test_bad_stamps_are_reported(stamp, checks):
    stamps = FrameStamps()
    for k in range(100):
        now_ns = START_NS + k * PERIOD_NS + 50_000_000
        stamps.pose_ns = now_ns - 20_000_000
        stamps.frame(stamp(k), now_ns)
    assert [finding.check for finding in stamps.findings()] == checks


def test_pictures_that_come_before_the_clock_are_not_ahead_of_it():
    """A bag is played and the first /clock comes late: 3 of 10 frames would be reported."""
    stamps = FrameStamps()
    for k in range(100):
        stamp_ns = START_NS + k * PERIOD_NS
        stamps.frame(stamp_ns, stamp_ns if k >= 30 else 0)
    assert stamps.findings() == []
