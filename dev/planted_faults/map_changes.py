"""What planted faults make of maps and elevation models."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dev.planted_faults.planting import FlightFiles, Planter


def _each_place(change: Callable[[list[Any]], list[Any]]) -> Callable[[Any], Any]:
    def walk(value: Any) -> Any:
        if value and isinstance(value[0], int | float):
            return change(value)
        return [walk(inner) for inner in value]

    return walk


def changed_map(change: Callable[[list[Any]], list[Any]], crs: str = "") -> Callable[[str], str]:
    """Return a change of all places of a map's text, and of its CRS."""

    def changed(text: str) -> str:
        tree, walk = json.loads(text), _each_place(change)
        for feature in tree["features"]:
            geometry = feature["geometry"]
            geometry["coordinates"] = walk(geometry["coordinates"])
        if crs:
            tree["crs"] = {"type": "name", "properties": {"name": crs}}
        return json.dumps(tree)

    return changed


def swapped(place: list[Any]) -> list[Any]:
    """Return a place with longitude and latitude swapped."""
    return [place[1], place[0], *place[2:]]


def next_zone(text: str) -> str:
    """Put a map into UTM zone 50, and say that it is zone 51."""
    import pyproj  # noqa: PLC0415 heavy

    to_utm = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32650", always_xy=True)
    return changed_map(
        lambda place: [*to_utm.transform(*place[:2]), *place[2:]], "urn:ogc:def:crs:EPSG::32651"
    )(text)


def level_dem(height_m: float) -> Planter:
    """Return a planter that gives a level DEM of a height, without its undulation."""

    def plant(good: FlightFiles, folder: Path) -> FlightFiles:
        import rasterio  # noqa: PLC0415 an extra

        path = folder / "dem.tif"
        west, north, step = 116.69, 39.86, 1e-4
        profile = {
            "crs": "EPSG:4326",
            "transform": rasterio.Affine(step, 0, west, 0, -step, north),
        }
        size = {"count": 1, "height": 200, "width": 200, "dtype": "float32"}
        with rasterio.open(path, "w", driver="GTiff", **size, **profile) as out:
            out.write(np.full((1, 200, 200), height_m, np.float32))
        return dataclasses.replace(good, options={"dem": path})

    return plant
