"""The poses against the truth, and the pictures with lines against the poses."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dev.soak.records import Picture, Poses, epoch_of
from tirgeo_ros.core.frames.rotations import quat_conjugate, quat_multiply, rotvec_from_quat
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

#: Colour on so few pixels is no line.
_LEAST_INK = 20
#: Between two poses so far apart there is a pose, and so long after the last one a prediction:
#: the defaults of PoseHistory and of overlay_node's max_prediction_s.
_BETWEEN_NS, _AHEAD_NS = 250_000_000, 100_000_000


@dataclass(frozen=True)
class Deviations:
    """The poses against the truth."""

    stamps_ns: list[int]  # of those that have a truth
    sigmas: Array  # (N, 6) errors over their sigma: north, east, down, and rotation about these
    strangers: int  # poses at instants of which nothing was sent


def deviations(
    poses: Poses, cameras: Mapping[int, CameraPose], shift_ns: Mapping[int, int], period_ns: int,
    start_ns: int,
) -> Deviations:  # fmt: skip
    """The errors of poses; ``cameras`` are the true ones by time since the start of a round."""
    found, true = [], []
    for k, stamp_ns in enumerate(poses.stamps_ns):
        shift = shift_ns.get(epoch_of(stamp_ns))
        camera = None
        if shift is not None:
            camera = cameras.get((stamp_ns - shift - start_ns) % period_ns)
        if camera is not None:
            found.append(k)
            true.append(camera)
    position = np.array([camera.position_n for camera in true]).reshape(-1, 3)
    attitude = np.array([camera.q_nc for camera in true]).reshape(-1, 4)
    turned = rotvec_from_quat(quat_multiply(poses.q_nc[found], quat_conjugate(attitude)))
    errors = np.hstack([poses.position_n[found] - position, turned])
    with np.errstate(divide="ignore", invalid="ignore"):
        sigmas = np.abs(errors) / np.sqrt(poses.variance[found])
    stamps = [poses.stamps_ns[k] for k in found]
    return Deviations(stamps, sigmas, len(poses.stamps_ns) - len(found))


def witnessed(
    pictures: Sequence[Picture], poses: Poses, gimbals_s: Sequence[float], latency_ns: int
) -> list[Picture]:
    """The pictures whose poses the witness has, if there were any.

    ``gimbals_s``: when each gimbal_node was started. overlay_node may have found it, and got its
    poses, before the witness has.
    """
    left_out: set[int] = set()
    for began_s in gimbals_s:
        first = int(np.searchsorted(poses.came_s, began_s))
        known = first < len(poses.stamps_ns)
        came_s, stamp_ns = (poses.came_s[first], poses.stamps_ns[first]) if known else (np.inf, 0)
        for number, picture in enumerate(pictures):
            early = epoch_of(picture.stamp_ns) == epoch_of(stamp_ns) and (
                picture.stamp_ns - latency_ns < stamp_ns
            )
            if picture.came_s >= began_s and (picture.came_s <= came_s or early):
                left_out.add(number)
    return [picture for number, picture in enumerate(pictures) if number not in left_out]


def lines_without_pose(
    pictures: Sequence[Picture], stamps_ns: Sequence[int], latency_ns: int
) -> list[Picture]:
    """The pictures with lines at whose exposure there was no pose, nor one to go on from."""
    by_epoch: defaultdict[int, list[int]] = defaultdict(list)
    for stamp_ns in stamps_ns:
        by_epoch[epoch_of(stamp_ns)].append(stamp_ns)
    for stamps in by_epoch.values():
        stamps.sort()
    return [
        picture
        for picture in pictures
        if has_lines(picture)
        and not _posed(by_epoch[epoch_of(picture.stamp_ns)], picture.stamp_ns - latency_ns)
    ]


def has_lines(picture: Picture) -> bool:
    """Whether lines are drawn in a picture."""
    return picture.line_pixels >= _LEAST_INK


def _posed(stamps_ns: Sequence[int], exposure_ns: int) -> bool:
    """Whether a pose can be had at an instant, of poses in order."""
    last = bisect_right(stamps_ns, exposure_ns) - 1
    if last < 0:
        return False
    if exposure_ns - stamps_ns[last] <= _AHEAD_NS:
        return True
    after = bisect_left(stamps_ns, exposure_ns)
    return after < len(stamps_ns) and stamps_ns[after] - stamps_ns[last] <= _BETWEEN_NS
