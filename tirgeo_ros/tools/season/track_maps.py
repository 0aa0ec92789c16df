"""Draw the tracks of a season's flights as small maps, one for each site, as SVG."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape

import numpy as np

from tirgeo_ros.core.frames.wgs84 import ecef_from_geodetic
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.season.flight_facts import positions_ned
from tirgeo_ros.tools.season.page_cells import anchor, degrees

#: Flights that begin this near to one of a site belong to it.
_SITE_M = 500.0
_MOST_SITES = 24
_WIDTH, _HEIGHT, _EDGE = 320.0, 220.0, 16.0  # of a map, in its own units
_LEAST_M = 20.0  # across: a flight that hovers is a point, not a scribble

Track = list[list[float]]  # (n, 2): latitude, longitude, degrees


def track_maps(tracks: Mapping[str, Track]) -> str:
    """Return a map of each site, the one with most flights first; "" without a track."""
    sites = sorted(_sites(tracks), key=len, reverse=True)
    figures = "".join(_figure(site) for site in sites[:_MOST_SITES])
    rest = len(sites) - _MOST_SITES
    more = f'<p class="lead">and {rest} sites more</p>' if rest > 0 else ""
    return f'<div class="maps">{figures}</div>{more}' if figures else ""


def _sites(tracks: Mapping[str, Track]) -> list[dict[str, Track]]:
    """Return the tracks by site: each begins near to another one of its site."""
    begins = np.radians([track[0] for track in tracks.values()]).reshape(-1, 2)
    places_e = ecef_from_geodetic(begins[:, 0], begins[:, 1], np.zeros(len(begins)))
    numbers = np.arange(len(begins))  # of each track's site: that of its last track
    for last, place_e in enumerate(places_e):
        near = np.linalg.norm(places_e[:last] - place_e, axis=1) < _SITE_M
        numbers[np.isin(numbers, numbers[:last][near])] = last
    sites: dict[int, dict[str, Track]] = {}
    for number, (name, track) in zip(numbers.tolist(), tracks.items(), strict=True):
        sites.setdefault(number, {})[name] = track
    return list(sites.values())


def _figure(site: Mapping[str, Track]) -> str:
    """Return the map of a site, north up, with a scale bar, and its place in words."""
    every = [point for track in site.values() for point in track]
    north_m, east_m, _ = positions_ned(every).T
    size_m = np.maximum([np.ptp(east_m), np.ptp(north_m)], _LEAST_M)
    scale = float(np.min((np.array([_WIDTH, _HEIGHT]) - 2 * _EDGE - [0.0, 14.0]) / size_m))
    x = _WIDTH / 2 + scale * (east_m - (east_m.max() + east_m.min()) / 2)
    y = (_HEIGHT - 14.0) / 2 - scale * (north_m - (north_m.max() + north_m.min()) / 2)
    ends = np.cumsum([len(track) for track in site.values()])[:-1]
    lines = zip(site, np.split(np.column_stack([x, y]), ends), strict=True)
    drawn = "".join(_line(name, points) for name, points in lines)
    count = f"{len(site)} flight{'s' if len(site) > 1 else ''}"
    place = " ".join(degrees(*every[0]))
    return (
        f'<figure><svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" '
        f'aria-label="tracks of {count} at {place}">{drawn}{_scale_bar(scale)}</svg>'
        f"<figcaption>{place}: {count}</figcaption></figure>"
    )


def _line(name: str, points: Array) -> str:
    told = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    x, y = points[0]
    return (
        f'<a href="#{anchor(name)}"><title>{escape(name)}</title>'
        f'<polyline points="{told}"/><circle cx="{x:.1f}" cy="{y:.1f}" r="2.5"/></a>'
    )


def _scale_bar(scale: float) -> str:
    """Return a bar of 1, 2 or 5 times a power of ten metres, at most a third of the width."""
    most_m = _WIDTH / 3 / scale
    power = 10.0 ** math.floor(math.log10(most_m))
    length_m = power * max(step for step in (1, 2, 5) if step * power <= most_m)
    words = f"{length_m / 1000:g} km" if length_m >= 1000 else f"{length_m:g} m"
    y, end = _HEIGHT - 6, _EDGE + length_m * scale
    return (
        f'<path class="scale" d="M{_EDGE:g} {y - 4:g}V{y:g}H{end:.1f}V{y - 4:g}"/>'
        f'<text x="{end + 6:.1f}" y="{y:g}">{words}</text>'
    )
