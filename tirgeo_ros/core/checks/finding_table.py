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
"""Declare every finding of the checks: its severity, words, parameter and remedy, in one table.

The checks gather statistics. They call ``finding`` with a row's key and the numbers for the braces
in its texts. Where a check has several rows, a suffix after a colon distinguishes their keys.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar, cast

from tirgeo_ros.core.types.finding import Finding, Severity

NOTE, CAUTION, STOP = Severity
T = TypeVar("T")

# Texts that several rows share.
_RPY = "ekf_node aircraft.imu_rpy_deg"
_FORCE, _RATE = "imu/data linear_acceleration", "imu/data angular_velocity"
_LEVER, _SECOND = "aircraft.rtk_antenna_m", "aircraft.second_antenna_m"
_TURN = "turn the axes to forward, left, up"
_SET_RPY = f"{_TURN}, or set aircraft.imu_rpy_deg to {{angles}}"
_NO_YAW = " (gravity does not show the yaw)"
_CORRELATION = "(correlation with the orientation in imu/data {correlation:+.2f})"
_REMAP = "check the driver, the topic's name and its namespace"
_ONE_CLOCK = "stamp both with the same clock"
_STAMPS = "{topic} header.stamp, ekf_node {delay}"
_DELAY = (
    "compared with the IMU's motion, stamps of {topic} are {size_s:.2f} s {way} than the "
    "parameters say (sigma {sigma_s:.2f} s)"
)
_FIND_DELAY = "correct the stamps, or find the delay with tirgeo calibrate aircraft"
_DATUM = "gps/fix is {off} during the whole flight (its sigma is {sigma_m:.1f} m)"
_GROUND = {
    "geoid": "{name}: heights are ellipsoidal, as in rtk/fix; "
    "a height above sea level is off by the geoid's undulation",
    "": "check that the ground's height is that of this place, and that {name} is ellipsoidal",
}
_FROM_LENS = "run tirgeo calibrate lens on pictures of this camera"
_CAMERA_CLOCK = "use the same clock for camera and aircraft"
_PICTURE = "thermal/image_raw"
_BORESIGHT = "gimbal_node boresight_rpy_deg"
_LATENCY = "overlay_node video_latency_s"
_JOINTS = "gimbal/joint_states"
_MENDED = (
    "{words}: {before} deg off the reported attitude (yaw, roll, pitch), "
    "{after} deg when corrected"
)
_WRONG = {"far": STOP, "": CAUTION}  # "far": by more than three ellipses of the map
_OF_PAPER = {"paper": NOTE, "": STOP}  # the paper's composition does not use the joints
_MAP, _DEM = "overlay_node map", "overlay_node dem"


@dataclass(frozen=True)
class AtLeast:
    """Rank a finding by the size of one of its numbers."""

    number: str
    limits: Mapping[float, Severity]  # least size -> severity; ascending, from 0


@dataclass(frozen=True, slots=True)
class Row:
    """Declare one finding. A field that depends on the case maps each to a value, "" to others."""

    severity: Severity | AtLeast | Mapping[str, Severity]
    evidence: str | Mapping[str, str]
    parameter: str | Mapping[str, str]
    mend: str | Mapping[str, str]


def finding(key: str, case: str = "", /, **facts: object) -> Finding:
    """Return a row's finding with ``facts`` in its texts; ``case`` has words between spaces."""
    row = FINDINGS[key]
    severity = row.severity
    if isinstance(severity, AtLeast):
        size = abs(cast("float", facts[severity.number]))
        severity = [rank for limit, rank in severity.limits.items() if size >= limit][-1]
    texts = (
        _of_case(text, case).format_map(facts) for text in (row.evidence, row.parameter, row.mend)
    )
    slug = str(facts.get("topic", "")).replace("/", "_")
    check = key.partition(":")[0].format(topic=slug)
    return Finding(check, _of_case(severity, case), *texts)


def _of_case(value: T | Mapping[str, T], case: str) -> T:
    """Return a plain value, or that of the first key that is "" or among the words of ``case``."""
    if not isinstance(value, Mapping):
        return value
    return next(value[name] for name in value if name in ("", *case.split()))


_note, _caution, _stop = (functools.partial(Row, severity) for severity in Severity)

# The rows are formatted by hand: severity, evidence, parameter, remedy.
# fmt: off
FINDINGS: Mapping[str, Row] = {
    # The IMU.
    "force_unit": _stop(
        "the specific force is {size:.3g} m/s2 on average, not 9.8", _FORCE,
        {
            "g": "it is in g: multiply it by 9.80665",
            "no_gravity": "gravity was removed: send the accelerometers' own readings",
            "": "divide it by {factor:.4g}: the unit is m/s2",
        }),
    "force_axes": _stop(
        "the mean specific force is ({force}) m/s2 forward, left, up, not (0, 0, +9.8)",
        {"reversed": _FORCE, "": f"{_FORCE}, {_RPY}"},
        {
            "reversed": "the sign is wrong: at rest z is +9.8 (axes forward, left, up)",
            "no_yaw": _SET_RPY + _NO_YAW,
            "": _SET_RPY,
        }),
    "force_scale": _caution(
        "the specific force is {size:.2f} m/s2 in {seconds} s without turns", _FORCE,
        "it should be 9.81: calibrate the accelerometers (scale, bias)"),
    "gyro_unit": _stop(
        "the gyroscopes turn {ratio:.1f} times as fast as the orientation in imu/data", _RATE,
        "they are in deg/s: multiply them by 0.0174533"),
    "gyro_axes": _stop(
        {
            "sign": f"the gyroscope {{axis}} has the wrong sign {_CORRELATION}",
            "": f"turns about {{axis}} appear in the gyroscope {{other}} {_CORRELATION}",
        }, {"turned": f"{_RATE}, {_RPY}", "": _RATE},
        {
            "no_yaw": _SET_RPY + _NO_YAW,
            "turned": _SET_RPY,
            "sign": "axes are forward, left, up, positive counter-clockwise seen from their tips",
            "": _TURN,
        }),
    "vibration": _note(
        "vibration is {gyroscopes:.0f} times the gyroscopes' configured noise and "
        "{accelerometers:.0f} times the accelerometers'",
        "ekf_node imu.angle_random_walk, imu.velocity_random_walk",
        "damp the IMU's mount; measure the noise with tirgeo calibrate allan"),
    "imu_clipping": _caution(
        "imu/data reaches the end of its range: {counts} of {samples} samples", "imu/data",
        "damp the IMU's mount or choose a larger range; balance the rotors"),
    #: At 34 deg/s a delay of 10 ms turns the pose by 0.3 deg.
    "imu_late": Row(
        AtLeast("size_s", {0.0: NOTE, 0.01: CAUTION}),
        "compared with headings, velocities and positions of RTK, stamps of imu/data are "
        "{size_ms:.1f} ms {way} than the parameters say (sigma {sigma_ms:.1f} ms)",
        "ekf_node imu.delay_s",
        "set it to {delay_s:.4f}; the filter has corrected this flight's poses for it"),
    "imu_tilt": _stop(
        "the IMU is tilted by {tilt_deg:.1f} deg in its mount, relative to the autopilot's "
        "attitude in imu/data", _RPY,
        "set it to {angles}; or if the IMU is level, calibrate its accelerometers"),
    "imu_tilt:unknown": _note(
        "imu/data has no orientation, so a tilt of the IMU in its mount is not known", _RPY,
        "level it within 1 deg, or send the autopilot's attitude in imu/data"),
    # Antennas, headings, delays.
    "heading_offset": Row(
        {"compass": CAUTION, "": STOP}, "rtk/heading is {off_deg:+.0f} deg from {reference}",
        f"ekf_node {_SECOND}",
        {
            "compass": "measure both antennas; check the compass and its declination",
            "swapped": "the antennas are swapped: exchange rtk_antenna_m and second_antenna_m",
            "across": "the baseline lies across the aircraft: measure both antennas, or remove "
                "the driver's offset of 90 deg",
            "": "measure both antennas; check that its yaw is ENU (90 deg less the azimuth)",
        }),
    "heading_offset:motion": _stop(
        "rtk/heading is {off_deg:+.1f} deg (sigma {sigma_deg:.1f}) from the heading "
        "computed from the motion of IMU and receiver", f"ekf_node {_SECOND}",
        "measure both antennas; check whether the IMU is turned about its vertical"),
    "heading_turns": _stop(
        "while the gyroscopes turned by {turned_deg:.0f} deg, rtk/heading turned by "
        "{slope:+.2f} times as much, and jumped by {jumps_deg:.0f} deg", f"rtk/heading, {_RATE}",
        {
            "sign": "its yaw must be ENU, counter-clockwise from east: 90 deg less the azimuth",
            "": "check for degrees instead of radians, repeated values, or a missing solution",
        }),
    "antenna_place": Row(
        {"set": CAUTION, "": NOTE},
        "this flight shows the RTK antenna at {place}, not at ({configured})",
        f"ekf_node {_LEVER}",
        {"sign": "check the sign of {axes}", "": "measure it from the IMU, with a tape"}),
    "antenna_place:unset": Row(
        {"unread": NOTE, "": CAUTION},
        "rtk/heading is received, but the antennas' positions are still zero{suggestion}",
        f"{_LEVER}, {_SECOND}", "measure both from the IMU with a tape (forward, left, up)"),
    #: At 3 m/s a delay of 0.15 s is 45 cm, and one of 0.4 s is more than three ellipses.
    "rtk_fix_delay": Row(
        AtLeast("size_s", {0.0: NOTE, 0.15: CAUTION, 0.4: STOP}), _DELAY, "ekf_node rtk.delay_s",
        _FIND_DELAY),
    "rtk_vel_delay": Row(
        AtLeast("size_s", {0.0: NOTE, 0.15: CAUTION}), _DELAY, "ekf_node rtk.velocity_delay_s",
        _FIND_DELAY),
    # The receivers' positions and velocities.
    "height_datum": _caution(
        _DATUM, "rtk/fix, gps/fix altitude; dji_node geoid_undulation_m",
        {
            "geoid": "one height is above sea level, but all must be ellipsoidal: switch the "
                "receiver, or set the undulation of the place",
            "": "check unit and datum of both heights: one of them is different",
        }),
    "position_datum": _caution(
        _DATUM, "rtk/fix, gps/fix",
        "check the coordinates of the RTK base, and that both are in WGS84"),
    "gps_contradiction": _stop(
        "gps/fix was {sigmas:.1f} times its sigma (gps.position_sigma_m) off the filter's "
        "position for 10 s or more, and no RTK says which is right",
        "gps/fix, gps/vel, baro/pressure",
        "compare the receiver's heights and velocities with the barometer's; if such errors are "
        "usual for this receiver, set gps.position_sigma_m to them"),
    "position_elsewhere": _stop(
        "rtk/fix and gps/fix are {apart_km:.0f} km apart", "rtk/fix, gps/fix latitude, longitude",
        {
            "swapped": "exchange latitude and longitude of the topic where they are swapped",
            "": "one is at another place: check its driver (degrees, signs) and its base",
        }),
    "{topic}_zero": _stop(
        "{topic} is always 0, but {positions} moves at {speed:.1f} m/s", "{topic}",
        "send this receiver's velocity, or do not publish this topic"),
    "{topic}_axes:exchanged": _stop(
        "{topic} agrees with the changes of {positions} if its north, east are {north}, {east} "
        "(correlation {best:.2f}; as sent {present:+.2f})", "{topic}",
        "send ENU: x east, y north, z up"),
    "{topic}_axes:body": _stop(
        "{topic} has the speeds of {positions} in other directions", "{topic}",
        "send the velocity of this receiver, in ENU, not in axes of the body"),
    "{topic}_up": _stop(
        "{topic} climbs where {positions} sinks", "{topic}", "z is up: reverse its sign"),
    "{topic}_unit": _stop(
        "{topic} says {own:.1f} m/s, but {positions} moves at {speed:.1f}", "{topic}",
        "send m/s: the ratio of these speeds, {factor:.3g}, means {unit}"),
    # Arrival, rates, stamps and covariances.
    "no_imu_data": _stop("imu/data: no message in {waited_s:.0f} s", "imu/data", _REMAP),
    "no_gps_fix": _stop(
        "gps/fix: no message in {waited_s:.0f} s; method raw has no position", "gps/fix", _REMAP),
    "no_rtk_fix": Row(
        {"gps": NOTE, "": STOP},
        {
            "gps": "rtk/fix: no message in {waited_s:.0f} s; the ordinary GPS gives the position",
            "": "rtk/fix: no message in {waited_s:.0f} s; nothing gives a position",
        }, "rtk/fix", _REMAP),
    "no_rtk_heading": _caution(
        "rtk/heading: no message in {waited_s:.0f} s; turns or the autopilot give the heading",
        "rtk/heading", f"{_REMAP}; with one antenna set ekf_node method to ekf"),
    "no_rtk_vel": _note(
        "rtk/vel: no message in {waited_s:.0f} s; attitude and heading are less certain",
        "rtk/vel", _REMAP),
    "imu_rate": _caution(
        "imu/data comes at {rate_hz:.0f} Hz, not 50 to 400", "imu/data", "set the driver's rate"),
    "rtk_rate": _caution(
        "too slow: {rates}, not 2 Hz or more", "{topic}", "set the receiver's rate to 5 Hz"),
    "imu_gaps": Row(
        {"past": NOTE, "": CAUTION}, "imu/data has {gaps}", "imu/data",
        "check the link and the recorder: the filter starts again after each gap"),
    "rtk_gaps": _note(
        "rtk/fix has {gaps}", "rtk/fix",
        "check the receiver's view of the sky, its corrections and its link"),
    "stamp_alone": Row(
        {"past": NOTE, "": CAUTION}, "stamps jump and return with the next sample: {counts}",
        "{topic}",
        "check the driver's clock and the file; the filter leaves such samples out"),
    "stamp_order": _caution(
        "stamps are not later than the previous ones: {counts}", "{topic}",
        "check for a second publisher, and for a clock with coarse steps"),
    "stamp_zero": Row(
        {"delayed": NOTE, "": CAUTION}, "stamps are 0: {counts}; the time of arrival is used",
        "ekf_node {delays}",
        "let the driver stamp with the time of measurement, or set the delay until arrival"),
    "stamp_ahead": _stop(
        "{topic} is stamped {off_s:.2f} s ahead of {others}", _STAMPS,
        f"{_ONE_CLOCK}, or set it to the delay of the stamps"),
    "stamp_late": _stop(
        "{topic} is stamped {off_s:.2f} s behind {others}; samples later than max_delay_s, "
        "{limit_s:g} s, are refused", _STAMPS,
        f"{_ONE_CLOCK}; if the delay is real, increase max_delay_s"),
    "stamp_jump": _caution(
        "stamps of {topic} jumped by {off_s:+.2f} s against {others}", _STAMPS,
        f"{_ONE_CLOCK}, and set no clock in flight"),
    "covariance_zero": Row(
        {"gps": NOTE, "": CAUTION}, "covariances are zero: {counts}; {floors} is used",
        "{topic} covariance",
        "let the driver fill it with the receiver's own accuracy (m2, (m/s)2, rad2)"),
    # A recording or a graph, before its messages are read.
    "namespace": _stop(
        "no input topic under {name}; there are {others} in other namespaces, most of them in "
        "/{space}", "--namespace", "did you mean --namespace {option}?"),
    "no_pictures": Row(
        {"near": STOP, "": NOTE}, "no topic of pictures: neither {names}{hint}", _PICTURE,
        {"near": "give --namespace or a remapping", "": "to draw, record the camera's topic"}),
    "type_of_{topic}": Row(
        {"needed": STOP, "": CAUTION}, "{name} is a {kind}, and should be a {wanted}", "{topic}",
        "convert or remap the driver's topic"),
    "no_{topic}": _stop(
        {"graph": "the graph has {names}{hint}", "": "the bag has {names}{hint}"}, "{topics}",
        {"graph": "publish it{remap}{calibration}", "": "record it{remap}{calibration}"}),
    "damaged_bag": _caution(
        "{damage}", "IN.mcap", "record again, or use the rest; the filter restarts after gaps"),
    "unreadable_{topic}": Row(
        {"some": CAUTION, "": STOP},
        "{refused} of {messages} messages of {topic} cannot be used: {reason}", "{topic}",
        "correct the program that publishes it"),
    "{topic}_unreadable": Row(
        {"unused": CAUTION, "": STOP}, "{why}", "overlay_node {topic}",
        "correct this file, or give another"),
    "no_ground": _stop(
        "{why}", "overlay_node ground_height_m", "give the ground's height, or a dem"),
    "check_failed": _caution(
        "a check failed {number} times: {kind}", "tirgeo itself",
        "report it with this flight; other findings are valid"),
    "publishers_of{topic}": Row(
        {"output": STOP, "": CAUTION}, "{topic} has {number} publishers: {names}", "{name}",
        "end the other graph or driver (dji:=false), or give it another ROS_DOMAIN_ID"),
    "restarts_of_{topic}": Row(
        {"recent": CAUTION, "": NOTE},
        "{topic} ended and was started again; restarts so far: {number}", "{topic}",
        "read its log, which says why it ended"),
    "no_pose": _stop(
        "the filter made no pose: {state}", "ekf_node method {method}",
        "fly with RTK fixes and some motion, or see the other findings"),
    # Parameters and calibration files.
    "parameters_elsewhere": _caution(
        "sections of parameters match no node of this flight ({where}): {sections}", "{option}",
        "give the --namespace of that aircraft, or begin the section with /**/"),
    "no_parameters": _caution(
        "lever arms and boresight are not set: all of them are 0{ground}",
        "{option}", "measure them, and write them into a copy of your aircraft's file in config"),
    "picture_size": _stop(
        "pictures are {size}, but the lens's calibration is for {lens_size}", "{lens}",
        "calibrate the lens with pictures of this size; nothing is drawn until then"),
    #: Off by a fifth of the width, K is for pictures of another size: 5/8, 3/2 or more of these.
    "principal_point": Row(
        AtLeast("share", {0.0: CAUTION, 0.2: STOP}),
        "principal point {cx:.0f}, {cy:.0f} lies {aside_px:.0f} px from the middle of "
        "{lens_size}", "{lens}", _FROM_LENS),
    "field_of_view": _stop(
        "field of view {view_deg:.1f} deg, from a focal length of {focal_px:.0f} px", "{lens}",
        _FROM_LENS),
    # The gimbal.
    "boresight_default": _caution(
        "the boresight was never calibrated: the ellipses do not include its error", _BORESIGHT,
        "run tirgeo calibrate boresight, or set it to zeros if the camera is known to be aligned"),
    "gimbal_north": Row(
        {"down": STOP, "": CAUTION},
        "the camera looks {bias_deg:+.1f} deg aside of the nose (positive: to the right; median "
        "of {count} attitudes, scatter {scatter_deg:.1f}): most drones' gimbals cannot turn so "
        "far",
        "gimbal_node north.bias_deg",
        "set it to {bias_deg:.1f}; or if the gimbal can turn, and was turned aside, leave it"),
    "joints_late": Row(
        _OF_PAPER, "the joints are stamped {size_s:.2f} s {way} than the body's attitude",
        f"{_JOINTS} header.stamp",
        "stamp them when they are measured, with the clock of imu/data"),
    "joint_order": Row(
        _OF_PAPER, _MENDED, "gimbal_node joint_order",
        "set it to {other}, or send the angles of a gimbal {order}"),
    "joint_angles": Row(
        _OF_PAPER, _MENDED, _JOINTS,
        "send radians by these names: yaw about up and from the nose, roll about forward, then "
        "pitch about left"),
    "joints_unlike": Row(
        {"paper": CAUTION, **_WRONG},
        "the joints are ({mean}) deg off the reported attitude (yaw, roll, pitch), with a "
        "standard deviation of ({spread})", f"{_JOINTS}, gimbal_node yaw_zero_deg, north.bias_deg",
        "correct the joints' zeros, or their stamps; the boresight is not the cause"),
    # Pictures, and their motion.
    "picture_stamps_zero": _caution(
        "{count} of {frames} pictures have no stamp", _PICTURE,
        "let the driver stamp them; until then video_latency_s must include the time to arrival"),
    "picture_stamps_ahead": _caution(
        "stamps of pictures are {mean_s:.2f} s ahead of their arrival", _PICTURE,
        f"{_CAMERA_CLOCK}, and stamp at the exposure"),
    "picture_stamps_late": _caution(
        "stamps of pictures are {mean_s:.2f} s behind their arrival", _PICTURE,
        f"{_CAMERA_CLOCK}, and stamp at the exposure"),
    "picture_clock": _stop(
        "pictures are stamped {mean_s:.2f} s ahead of the camera's poses (negative: behind)",
        _PICTURE, f"{_CAMERA_CLOCK}; no map is drawn on such pictures"),
    "picture_stamps_back": _caution(
        "{count} of {frames} stamps of pictures are not later than the one before", _PICTURE,
        "check that only one driver sends pictures, each once and in order"),
    "picture_motion": _stop(
        "the pictures move differently from the camera's poses: by {moved_px:.1f} px from one "
        "to the next, {off_px:.1f} px off what the poses predict", f"{_JOINTS}, {_PICTURE}",
        "check that the pictures are stamped by the aircraft's clock, that the video is live, "
        "and that the gimbal's angles have the right axes and signs"),
    "picture_turned": _stop(
        "the pictures are {turned}: if turned back, they move as the camera's poses say", _PICTURE,
        "turn them in the camera or its driver, before the lens is calibrated"),
    "latency_default": _note(
        "the video's latency has its default, {latency_s:g} s", _LATENCY,
        "measure it with tirgeo calibrate boresight, and set it"),
    "video_latency_untold": _note(
        "the flight does not show the latency of the video: the camera hardly turns", _LATENCY,
        "turn a few times, or measure it with tirgeo calibrate boresight"),
    "video_latency": Row(
        _WRONG,
        "the pictures lag the camera's poses by {true_s:.3f} s (sigma {sigma_s:.3f}), not by "
        "{latency_s:.3f} ({pairs} pairs of pictures)", _LATENCY,
        "set it to {true_s:.3f}, or run tirgeo calibrate boresight"),
    "focal_length": Row(
        _WRONG,
        "the pictures turn as if the focal length were {true_px:.0f} px (sigma {sigma_px:.0f}), "
        "not {focal_px:.0f} ({pairs} pairs of pictures)", "{lens}",
        "run tirgeo calibrate lens, with the pictures' size and zoom"),
    "ground_by_motion": Row(
        _WRONG,
        "the ground moves as if seen from {true_m:.0f} m (sigma {sigma_m:.1f}), not from "
        "{above_m:.0f} m above it ({pairs} pairs of pictures)", "{ground}",
        "{move} the ground by {off_m:.0f} m: heights are ellipsoidal, not above sea level, as "
        "in rtk/fix"),
    "boresight_by_motion": Row(
        _WRONG,
        "the camera looks {off_deg:.1f} deg away from its poses (roll, pitch, yaw {angles}; "
        "sigma {sigma_deg:.1f}) ({pairs} pairs of pictures)", _BORESIGHT,
        "add these angles, or run tirgeo calibrate boresight; check the principal point too"),
    "pictures_disagree": _caution(
        "pictures disagree by {apart_m:.1f} m between headings ({pairs} pairs, {sigmas:.1f} "
        "sigma of their poses): gimbal north, boresight, focal length or ground height",
        f"{_BORESIGHT}, north.bias_deg", "run tirgeo calibrate boresight --ties"),
    # Ground and map.
    "below_ground": _stop("{off_m:.1f} m below the ground", "{where}", _GROUND),
    "height_at_rest": Row(
        {"above": CAUTION, "": STOP},
        "at rest, at the flight's lowest place, {off_m:.1f} m above ground", "{where}", _GROUND),
    "map_unreadable": Row(
        {"older": CAUTION, "": STOP}, "{why}", _MAP,
        "correct the file: it is read again when it changes"),
    "map_elsewhere": Row(
        _WRONG, "map is {way}{question}", _MAP,
        "give a map of this place, in its own coordinate system (crs in the style sheet)"),
    "map_system_unknown": _note(
        "{remark}", _MAP,
        "save it in WGS84 (EPSG:4326), or name its coordinate system under crs in the style "
        "sheet"),
    "map_empty": _stop(
        {"dem": "none of the map lies on the elevation model", "": "the map has no features"},
        {"dem": _DEM, "": _MAP},
        {
            "dem": "check that the elevation model is that of the map's place",
            "": "check that its file has lines, outlines or points, and that the style sheet "
            "names its layers",
        }),
    "dem_elsewhere": Row(
        {"near": CAUTION, "": STOP},
        "the elevation model has no height at the place of take-off ({latitude:.5f}, "
        "{longitude:.5f})", _DEM,
        "give a model of this place; check its latitude and longitude, or its UTM zone"),
}
# fmt: on
