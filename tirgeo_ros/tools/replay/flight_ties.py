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
"""Find what a flight's pictures show twice, on the poses that filter and gimbal compute."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.adjustment.adjustment import Adjustment, Downs, disagreement, known_downs
from tirgeo_ros.core.adjustment.tie_fit import PRIOR_SIGMA, TieFit, fit_ties
from tirgeo_ros.core.adjustment.tied_views import PARAMETERS, TiedView
from tirgeo_ros.core.calibration.boresight_model import (
    PARAMETERS as SIGHTED,
    PointSighting,
    SightedFlight,
    by_mounting,
    corrected_pose,
)
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ties.tie_finder import TieFinder
from tirgeo_ros.core.ties.tracks import TiedPair, tracks_of
from tirgeo_ros.core.ties.view import View
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError, TirgeoError
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.tools.presentation.progress import Report, part
from tirgeo_ros.tools.replay.flight_pictures import FlightPictures
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, OpenedFlight
from tirgeo_ros.tools.replay.stepped_flight import SteppedFlight

#: Where the parameters that move a pose stand in both lists: ties', sightings'.
_BOTH = [name for name in SIGHTED if name in PARAMETERS and name != "ground_height"]
_TIED, _SIGHTED = ([names.index(name) for name in _BOTH] for names in (PARAMETERS, SIGHTED))
#: Fewest pairs of pictures of which a result is made. Every fifth of them judges it.
LEAST_PAIRS, _FIFTH = 15, 5
_OPPOSITE = -0.5  # cosine between the headings of two pictures
_CALIBRATED_RAD = math.radians(0.1)  # sigma of a mounting that has been calibrated
_POSES_SHARE = 0.4  # of the work


class FlightTies(NamedTuple):
    """Hold the ties of a flight's pictures, and what their poses depend on."""

    stepped: SteppedFlight
    views: Mapping[int, TiedView]  # by the stamp (ns) of the picture's header
    pairs: Sequence[TiedPair]
    ground: Ground

    def judges(self, views: Mapping[int, View]) -> dict[str, list[TiedPair]]:
        """Return every fifth pair, which no fit sees, of the pictures in ``views``.

        Under "all", and those of opposite headings once more, under "opposite", if there are any.
        """
        kept = [pair for k, pair in enumerate(self.pairs) if k % _FIFTH == _FIFTH - 1]
        kept = [pair for pair in kept if {pair.first_ns, pair.second_ns} <= views.keys()]
        opposite = [pair for pair in kept if _is_opposite(pair, views)]
        return {"all": kept} | ({"opposite": opposite} if opposite else {})

    def fit(self, prior_sigma: Array, clicks: Sequence[PointSighting] = ()) -> TieFit:
        """Return the fit to the other pairs and to clicks; ``prior_sigma`` (P,) of PARAMETERS.

        Raise CalibrationError if there are too few, or if they do not agree.
        """
        if len(self.pairs) < LEAST_PAIRS:
            number = sum(len(pair.first_uv) for pair in self.pairs)
            raise CalibrationError(
                f"{number} ties in {len(self.pairs)} pairs of pictures, and {LEAST_PAIRS} pairs "
                "are needed: fly strips that overlap by two thirds, some of them crosswise, over "
                "ground with structure (no water, no snow)"
            )
        tracks = tracks_of([p for k, p in enumerate(self.pairs) if k % _FIFTH != _FIFTH - 1])
        views, plane = [*self.views.values()], self.stepped.plane
        return fit_ties(views, tracks, plane, self.ground, prior_sigma, clicks=clicks)

    def apart_m(
        self, views: Mapping[int, View], pairs: Sequence[TiedPair], downs: Downs | None = None
    ) -> Array:
        """Return how far the ties (K,) of pairs are apart by the poses of ``views``."""
        return disagreement(views, pairs, self.stepped.plane, self.ground, downs)


def flight_ties(
    reader: BagReader,
    namespace: str,
    configs: NodeConfigs,
    progress: Report,
    *,
    smooth: bool = False,
) -> FlightTies:
    """Read a flight twice, for its poses and for its pictures, and tie the pictures.

    Raise BagError, CameraError, ElevationError, and CalibrationError if the flight has no pose,
    or if the height of the ground is not known.
    """
    ground = ground_of(configs.overlay)
    if ground is None:
        raise CalibrationError("height of the ground not known: give --ground-height or --dem")
    pictures = FlightPictures(reader, namespace)
    stamps_ns = pictures.stamps_ns
    first, second = part(progress, 0.0, _POSES_SHARE), part(progress, _POSES_SHARE, 1.0)
    stepped = SteppedFlight(
        reader, namespace, configs, stamps_ns, first, north=False, smooth=smooth
    )
    views = tied_views(stepped, stamps_ns)
    finder = TieFinder(stepped.plane, ground)

    def wants(number: int) -> bool:
        second(number, len(stamps_ns))
        tied = views.get(stamps_ns[number])
        return tied is not None and finder.wants(tied.view)

    for number, pixels in pictures.read(range(len(stamps_ns)), wants):
        view = views[stamps_ns[number]].view
        if not isinstance(pixels, TirgeoError) and fits(pixels.shape, view.camera):
            finder.add(view, pixels)
    return FlightTies(stepped, views, finder.pairs(), ground)


def tied_views(stepped: SteppedFlight, stamps_ns: Sequence[int]) -> dict[int, TiedView]:
    """Return the pictures that have a pose, by the stamps of their headers."""
    flight = stepped.sighted(click_sigma_px=1.0)
    views = ((stamp_ns, _tied_view(flight, stamp_ns)) for stamp_ns in stamps_ns)
    return {stamp_ns: view for stamp_ns, view in views if view is not None}


def flight_adjustment(
    opened: OpenedFlight, progress: Report, *, adjust: bool, smooth: bool
) -> tuple[Adjustment | None, list[str]]:
    """Return the correction of a flight's camera poses by the ties of its pictures, and notes.

    None if not asked to ``adjust``. None too, with a note that says why, if there are too few
    ties, or if the pictures that the fit has not seen agree no better with it. Raise as
    ``flight_ties``.
    """
    if not adjust:
        return None, []
    given = opened.reader, opened.namespace, opened.configs
    ties = flight_ties(*given, progress, smooth=smooth)
    try:
        fit = ties.fit(_prior_sigma(ties.stepped, opened.configs))
    except CalibrationError as error:
        return None, [f"not adjusted: {error}"]
    before = {stamp_ns: ties.views[stamp_ns].view for stamp_ns in fit.views}
    ways = (before, None), (before, known_downs(fit)), (fit.views, known_downs(fit))
    for name, pairs in reversed(ties.judges(before).items()):  # the note is on all, the last
        level, own, after = (median(ties.apart_m(views, pairs, at)) for views, at in ways)
        before_m = min(level, own)
        which = "" if name == "all" else f" of {name} headings"
        words = f"ties{which} that the fit has not seen are {before_m:.2f} m apart, {after:.2f} m "
        words += "after it"
        if not after < before_m:  # nan: there are none
            return None, [f"not adjusted, for it would not help: {words}"]
    flight = ties.stepped.sighted(click_sigma_px=1.0)

    def mounted(pose: CameraPose) -> tuple[CameraPose, Array]:
        bare, sighted = by_mounting(flight, pose)
        return bare, _tied_slopes(sighted)

    return Adjustment(fit, mounted), [f"adjusted by {len(fit.points_n)} points: {words}"]


def _is_opposite(pair: TiedPair, views: Mapping[int, View]) -> bool:
    ups_n = (matrix_from_quat(views[k].pose.q_nc)[:2, 1] for k in (pair.first_ns, pair.second_ns))
    first, second = (up / max(float(np.linalg.norm(up)), 1e-9) for up in ups_n)
    return float(first @ second) < _OPPOSITE


def median(apart_m: Array) -> float:
    """Return the median of the known distances (K,); nan without any."""
    known = apart_m[np.isfinite(apart_m)]
    return float(np.median(known)) if len(known) else math.nan


def _prior_sigma(stepped: SteppedFlight, configs: NodeConfigs) -> Array:
    """Return what is unknown (P,) of the set-up of a flight whose poses are to be adjusted."""
    sigma = np.zeros(len(PARAMETERS))
    calibrated = any(configs.gimbal.boresight_rpy_deg)
    for name in ("roll", "pitch", "yaw"):
        index = PARAMETERS.index(name)
        sigma[index] = _CALIBRATED_RAD if calibrated else PRIOR_SIGMA[index]
    sigma[PARAMETERS.index("gimbal_north")] = stepped.north_sigma_rad
    return sigma


def _tied_view(flight: SightedFlight, stamp_ns: int) -> TiedView | None:
    posed = corrected_pose(flight, stamp_ns, np.zeros(len(SIGHTED)))
    if posed is None:
        return None
    pose, slopes = posed
    north = SIGHTED.index("gimbal_north")  # not stepped: its effect is known where it matters
    slopes[:, north] = by_mounting(flight, pose)[1][:, north]
    return TiedView(View(stamp_ns, flight.camera, pose), _tied_slopes(slopes))


def _tied_slopes(sighted: Array) -> Array:
    """Return slopes (6, P) by the parameters of ties, from those of sightings."""
    slopes = np.zeros((6, len(PARAMETERS)))
    slopes[:, _TIED] = sighted[:, _SIGHTED]
    return slopes


def fits(shape: Sequence[int], camera: Camera) -> bool:
    """Return whether a picture of this shape has the camera's size."""
    return (shape[0], shape[1]) == (camera.height, camera.width)
