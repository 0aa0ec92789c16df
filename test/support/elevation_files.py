"""Elevation models written for tests, and the surface that they are made of."""

from __future__ import annotations

import numpy as np
import pyproj

UTM = "EPSG:32650"
WEST, NORTH, SIZE = 500_100.0, 4_411_600.0, 150
#: A metre of grid: 3 / 50^2 and 2 / 40^2 of curvature, an eighth of their sum: 0.3 mm. Half a
#: pixel of shift would be 3 / 50 / 2 = 30 mm.
BILINEAR_M = 5e-4


def wave(x, y):
    return 40.0 + 3.0 * np.sin(np.asarray(x) / 50.0) + 2.0 * np.cos(np.asarray(y) / 40.0)


def written(rasterio, path, values, transform, crs=UTM, tags=None, units=None, **profile):
    bands = values if values.ndim == 3 else values[None]
    profile = {"nodata": -9999.0} | profile
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        count=len(bands),
        height=bands.shape[1],
        width=bands.shape[2],
        dtype=bands.dtype,
        crs=crs,
        transform=transform,
        **profile,
    ) as out:
        out.write(bands)
        out.update_tags(**(tags or {}))
        if units:
            out.units = (units,) * len(bands)
    return path


def grid_of_metres(rasterio, west=WEST, north=NORTH, size=SIZE, step=1.0):
    """Middles of pixels of ``step`` m, and the transform of their corners."""
    x = west + step * (np.arange(size) + 0.5)
    y = north - step * (np.arange(size) + 0.5)
    return *np.meshgrid(x, y), rasterio.transform.from_origin(west, north, step, step)


def at(terrain, x, y, crs=UTM):
    lon, lat = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(x, y)
    return terrain.height_m(np.radians(lat), np.radians(lon))


def some_places(rng, margin=2.0):
    x = rng.uniform(WEST + margin, WEST + SIZE - margin, 200)
    return x, rng.uniform(NORTH - SIZE + margin, NORTH - margin, 200)
