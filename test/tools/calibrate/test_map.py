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
"""``tirgeo calibrate map``: features in pixels become a map."""

from __future__ import annotations

import json
import math

import numpy as np
import pyproj
import pytest

from tirgeo_ros.core.types.errors import CalibrationError, MapError
from tirgeo_ros.io.maps import load_layers
from tirgeo_ros.tools.calibrate.map import calibrate_map
from tirgeo_ros.tools.cli import main as command

SIZE_PX = np.array([8000.0, 6000.0])
GSD_M = 0.0215
UTM = pyproj.Transformer.from_crs("EPSG:32650", "EPSG:4326", always_xy=True)


def plane_of(pixels):
    """A bent orthophoto in UTM 50 N: a cubic that no lower order follows."""
    u, v = (np.asarray(pixels) / SIZE_PX - 0.5).T * 2
    x = 457_000 + GSD_M * (pixels[:, 0] + 15 * u**3 + 8 * u * v * v)
    y = 4_407_000 - GSD_M * (pixels[:, 1] + 12 * v**3 - 9 * u * u)
    return np.stack([x, y], 1)


def degrees_of(pixels):
    return np.stack(UTM.transform(*plane_of(pixels).T), 1)


MARKS = np.random.default_rng(1).uniform(0.02, 0.98, (20, 2)) * SIZE_PX
MARKS[:4] = np.array([[0.01, 0.01], [0.99, 0.01], [0.99, 0.99], [0.01, 0.99]]) * SIZE_PX
BED = [[1000.0, 1000.0], [3000.0, 1200.0], [2500.0, 4000.0], [1000.0, 1000.0]]
PATH = [[4000.5, 500.0], [5000.0, 5500.25]]
NOISE_PX = np.random.default_rng(2).normal(0, 2.0, MARKS.shape)


def features(up=False):
    def put(position):
        return [position[0], -position[1] if up else position[1]]

    def feature(name, kind, coordinates):
        geometry = {"type": kind, "coordinates": coordinates}
        return {"type": "Feature", "properties": {"name": name}, "geometry": geometry}

    hole = [[2000.0, 1500.0], [2200.0, 1500.0], [2200.0, 1700.0], [2000.0, 1500.0]]
    return {
        "type": "FeatureCollection",
        "crs": {"type": "name", "properties": {"name": "EPSG:3857"}},
        "features": [
            feature("bed", "Polygon", [[put(p) for p in BED], [put(p) for p in hole]]),
            feature("path", "LineString", [put(p) for p in PATH]),
            feature("tree", "Point", put([6000.0, 3000.0])),
            feature("none", "GeometryCollection", []) | {"geometry": None},
        ],
    }


def files(folder, noise_px=0.0, marks=MARKS, document=None):
    rows = [f"g{k},{c:.4f},{r:.4f}" for k, (c, r) in enumerate(marks + noise_px)]
    (folder / "marks.csv").write_text("\n".join(["id,column,row", *rows]) + "\n")
    places = [f"g{k},{lat:.12f},{lon:.12f},21.5" for k, (lon, lat) in enumerate(degrees_of(marks))]
    (folder / "survey.csv").write_text("\n".join(["id,lat,lon,h", *places]) + "\n")
    (folder / "px.geojson").write_text(json.dumps(document or features()))
    return {
        "vectors": folder / "px.geojson",
        "points": folder / "marks.csv",
        "survey": folder / "survey.csv",
        "output": folder / "map.geojson",
    }


def metres_apart(found, pixels):
    lon, lat = np.radians(np.array(found)).T
    true_lon, true_lat = np.radians(degrees_of(np.array(pixels))).T
    return np.hypot((lon - true_lon) * np.cos(lat), lat - true_lat) * 6.37e6


def test_features_land_where_they_are(tmp_path):
    result = calibrate_map(**files(tmp_path))
    written = json.loads((tmp_path / "map.geojson").read_text())
    assert "crs" not in written
    bed, path, tree, none = written["features"]
    assert [item["properties"]["name"] for item in written["features"]][:2] == ["bed", "path"]
    assert [len(ring) for ring in bed["geometry"]["coordinates"]] == [4, 4]
    # Nine decimals of a degree are 0.1 mm; marks are written to 1e-4 px.
    assert metres_apart(bed["geometry"]["coordinates"][0], BED).max() < 5e-4
    assert metres_apart(path["geometry"]["coordinates"], PATH).max() < 5e-4
    assert metres_apart([tree["geometry"]["coordinates"]], [[6000.0, 3000.0]]).max() < 5e-4
    assert none["geometry"] is None
    assert result["crs"] == "WGS 84 / UTM zone 50N (EPSG:32650)"
    assert result["pixel_m"] == pytest.approx(GSD_M, rel=0.02)
    assert result["mean_residual_px"] < 0.01
    assert result["warning"] is None
    labels = [item.label for item in load_layers(str(tmp_path / "map.geojson"))[0].features]
    assert set(labels) == {"bed", "path", "tree"}


def test_residuals_tell_of_the_marks_noise(tmp_path):
    given = files(tmp_path, NOISE_PX)
    result = calibrate_map(**given)
    # 20 points and 10 terms: the root of a half of 2 px times root 2, to 4 sigma of 20 degrees.
    assert result["rms_residual_px"] == pytest.approx(2.0, rel=4 / math.sqrt(40))
    assert result["sigma_m"] == pytest.approx(2 * GSD_M, rel=4 / math.sqrt(40))
    assert result["rms_left_out_m"] > result["rms_residual_m"]
    lengths = [row["length_px"] for row in result["residuals"]]
    assert len(lengths) == 20
    assert np.mean(lengths) == pytest.approx(result["mean_residual_px"])


def test_qgis_points_and_upward_rows_give_the_same_map(tmp_path):
    given = files(tmp_path)
    calibrate_map(**given)
    plain = (tmp_path / "map.geojson").read_text()
    lines = ["#CRS: EPSG:32650", "mapX,mapY,sourceX,sourceY,enable,dX,dY,residual"]
    lines += [
        f"{x!r},{y!r},{c:.4f},{-r:.4f},1,0,0,0"
        for (x, y), (c, r) in zip(plane_of(MARKS).tolist(), MARKS.tolist(), strict=True)
    ]
    (tmp_path / "o.points").write_text("\n".join(lines) + "\n")
    (tmp_path / "px.geojson").write_text(json.dumps(features(up=True)))
    given |= {"points": tmp_path / "o.points", "survey": None, "output": tmp_path / "b.geojson"}
    calibrate_map(**given)
    a, b = (json.loads(text)["features"] for text in (plain, given["output"].read_text()))
    for item, other in zip(a[:2], b[:2], strict=True):
        first, second = (np.ravel(x["geometry"]["coordinates"][0]) for x in (item, other))
        np.testing.assert_allclose(first, second, rtol=0, atol=3e-9)


def test_warnings_name_mistakes_and_what_lies_outside(tmp_path):
    noise = NOISE_PX.copy()
    noise[9] += [150.0, 0.0]
    warning = calibrate_map(**files(tmp_path, noise))["warning"]
    assert "points that do not fit the others: g9 (" in warning
    inner = MARKS * 0.4 + 0.05 * SIZE_PX
    warning = calibrate_map(**files(tmp_path, NOISE_PX, inner))["warning"]
    assert "3 of 4 features reach outside the hull" in warning
    assert "m (one sigma) by the points' own errors alone" in warning
    warning = calibrate_map(**files(tmp_path, marks=MARKS[:10]))["warning"]
    assert "10 points leave no redundancy at order 3" in warning


def test_refusals(tmp_path):
    given = files(tmp_path)
    with pytest.raises(MapError, match="WGS 84 is not a projected system in metres; give one"):
        calibrate_map(**given, crs="EPSG:4326")
    few = files(tmp_path, marks=MARKS[:9])
    with pytest.raises(CalibrationError, match=r"marks\.csv: order 3 needs 10 control points"):
        calibrate_map(**few)
    document = features()
    document["features"][1]["geometry"]["coordinates"][0] = ["x", 1]
    with pytest.raises(MapError, match=r"px\.geojson: feature 2 has coordinates that are not col"):
        calibrate_map(**files(tmp_path, document=document))
    (tmp_path / "px.geojson").write_text('{"type": "Feature"}')
    with pytest.raises(MapError, match=r"px\.geojson: not a GeoJSON FeatureCollection"):
        calibrate_map(**given)
    assert not (tmp_path / "map.geojson").exists()


def test_the_command(tmp_path, capsys):
    given = files(tmp_path, NOISE_PX)
    words = ["calibrate", "map", str(given["vectors"]), "--points", str(given["points"])]
    words += ["--survey", str(given["survey"]), "-o", str(given["output"]), "--order", "2"]
    assert command.main(words) == 0
    out = capsys.readouterr().out
    assert "order 2 in WGS 84 / UTM zone 50N" in out
    assert "mean residual" in out
    assert command.main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["points"] == 20
