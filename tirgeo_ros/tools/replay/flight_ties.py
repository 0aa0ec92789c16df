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
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.adjustment.adjustment import (
    Adjustment,
    Downs,
    disagreement,
    known_downs,
    shift_sigmas,
)
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
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, is_given
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.ties.tie_config import TieConfig
from tirgeo_ros.core.ties.tie_finder import OTHER_HEADING_RAD, TieFinder, turns_rad
from tirgeo_ros.core.ties.tracks import TiedPair, tracks_of
from tirgeo_ros.core.ties.view import View
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import BagError, CalibrationError, CameraError, TirgeoError
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.tools.presentation.progress import Report, part
from tirgeo_ros.tools.replay.flight import Flight, FlightPoses
from tirgeo_ros.tools.replay.flight_pictures import FlightPictures
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, OpenedFlight
from tirgeo_ros.tools.replay.stepped_flight import SteppedFlight

#: Where the parameters that move a pose stand in both lists: ties', sightings'.
_BOTH = [name for name in SIGHTED if name in PARAMETERS and name != "ground_height"]
_TIED, _SIGHTED = ([names.index(name) for name in _BOTH] for names in (PARAMETERS, SIGHTED))
#: Fewest pairs of pictures of which a result is made. Every fifth of them judges it.
LEAST_PAIRS, _FIFTH = 10, 5
_CALIBRATED_RAD = math.radians(0.1)  # sigma of a mounting that has been calibrated
_POSES_SHARE = 0.4  # of the work
#: Of a check: the pictures to choose from, evenly in time, and the places where four of them are
#: compared, for 0.2 s each. In a large picture features take several times as long.
_MOST_PICTURES, _PLACES, _LARGE_PX = 200, 3, 500_000
_BRIEF = TieConfig(features=800, pairs_per_picture=3)


class FlightTies(NamedTuple):
    """Hold the ties of a flight's pictures, and what their poses depend on."""

    stepped: SteppedFlight
    views: Mapping[int, TiedView]  # by the stamp (ns) of the picture's header
    pairs: Sequence[TiedPair]
    ground: Ground

    @property
    def judges(self) -> list[TiedPair]:
        """Return every fifth pair, which no fit sees."""
        return [pair for k, pair in enumerate(self.pairs) if k % _FIFTH == _FIFTH - 1]

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
        """Return how far the ties (K,) of the pairs whose pictures are in ``views`` are apart."""
        known = [pair for pair in pairs if {pair.first_ns, pair.second_ns} <= views.keys()]
        return disagreement(views, known, self.stepped.plane, self.ground, downs)


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
        if not isinstance(pixels, TirgeoError) and _fits(pixels.shape, view.camera):
            finder.add(view, pixels)
    return FlightTies(stepped, views, finder.pairs(), ground)


class PictureOverlaps:
    """Compare what a few of a flight's pictures show twice, by poses computed for other work.

    Without pictures or a known ground nothing is compared.
    """

    def __init__(
        self, reader: BagReader, namespace: str, overlay: OverlayConfig, ground: Ground | None
    ) -> None:
        self._ground, self._overlay = ground, overlay
        self._stamps_ns: dict[int, int] = {}  # by the pictures' numbers, evenly in time
        with suppress(BagError):
            self._pictures = FlightPictures(reader, namespace)
            if is_given(ground):
                stamps_ns = [*enumerate(self._pictures.stamps_ns)]
                self._stamps_ns = dict(stamps_ns[:: len(stamps_ns) // _MOST_PICTURES + 1])

    @property
    def instants_ns(self) -> list[int]:
        """Return the instants at which poses are needed."""
        latency_s = self._overlay.video_latency_s
        return [exposure_ns(stamp_ns, latency_s) for stamp_ns in self._stamps_ns.values()]

    def disagreement(self, flight: Flight, poses: FlightPoses) -> dict[str, dict[str, float]]:
        """Read a few pictures; return medians over pairs of other headings, and of the same one.

        A picture that cannot be read, or does not fit the lens, is left out.
        """
        if poses.plane is None or self._ground is None or not self._stamps_ns:
            return {}
        given, sigma_m = (poses.plane, self._ground), self._overlay.confidence.ground_sigma_m
        rows: dict[str, list[tuple[float, float]]] = {}
        with suppress(CameraError, BagError):  # other findings name it
            views, pairs = self._tied(flight.camera, poses, *given)
            for pair in pairs:
                both = [views[stamp_ns] for stamp_ns in (pair.first_ns, pair.second_ns)]
                turn_rad = turns_rad(np.stack([view.pose.q_nc for view in both]))[0, 1]
                name = "other_headings" if turn_rad >= OTHER_HEADING_RAD else "same_heading"
                sigmas = shift_sigmas(both, pair, *given, sigma_m)
                if math.isfinite(sigmas):
                    apart_m = median(disagreement(views, [pair], *given))
                    rows.setdefault(name, []).append((apart_m, sigmas))
        medians = {name: np.median(row, axis=0).tolist() for name, row in rows.items()}
        return {
            name: {"pairs": len(rows[name]), "apart_m": apart_m, "sigmas": sigmas}
            for name, (apart_m, sigmas) in medians.items()
        }

    def _tied(
        self, camera: Camera, poses: FlightPoses, plane: TangentPlane, ground: Ground
    ) -> tuple[dict[int, View], list[TiedPair]]:
        chooser = TieFinder(plane, ground)
        for stamp_ns, at_ns in zip(self._stamps_ns.values(), self.instants_ns, strict=True):
            posed = poses.at(at_ns)
            if posed is not None:
                chooser.add(View(stamp_ns, camera, posed[0]), None)
        large = camera.width * camera.height > _LARGE_PX
        views = {view.stamp_ns: view for view in chooser.crossing(1 if large else _PLACES)}
        numbers = [number for number, stamp_ns in self._stamps_ns.items() if stamp_ns in views]
        finder = TieFinder(plane, ground, _BRIEF)
        for number, pixels in self._pictures.read(numbers):
            view = views[self._stamps_ns[number]]
            if not isinstance(pixels, TirgeoError) and _fits(pixels.shape, camera):
                finder.add(view, pixels)
        return views, finder.pairs()


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
    level, own, after = (median(ties.apart_m(views, ties.judges, at)) for views, at in ways)
    before_m = min(level, own)
    words = f"ties that the fit has not seen are {before_m:.2f} m apart, {after:.2f} m after it"
    if not after < before_m:  # nan: there are none
        return None, [f"not adjusted, for it would not help: {words}"]
    flight = ties.stepped.sighted(click_sigma_px=1.0)

    def mounted(pose: CameraPose) -> tuple[CameraPose, Array]:
        bare, sighted = by_mounting(flight, pose)
        return bare, _tied_slopes(sighted)

    return Adjustment(fit, mounted), [f"adjusted by {len(fit.points_n)} points: {words}"]


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


def _fits(shape: Sequence[int], camera: Camera) -> bool:
    return (shape[0], shape[1]) == (camera.height, camera.width)
