"""Cut and flipped files of every format: a map, or one line that names the file."""

import json
import random
import tracemalloc
import zipfile

import numpy as np
import pytest
from map_files import HOLE, RING, gpb, wkb, write_geopackage, write_shapefile

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps.layers import read_layers as load_layers

ROUNDS = 150
ROUNDS_OF = {".prj": 20}  # an unknown name of a system is looked for far and wide by PROJ
#: A reader may hold its file some times over, never what a damaged count tells of.
MOST_BYTES = 32 << 20


def geojson(path):
    polygon = {"type": "MultiPolygon", "coordinates": [[RING, HOLE]]}
    feature = {"type": "Feature", "properties": {"name": "Grün"}, "geometry": polygon}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature] * 3}))


def geopackage(path):
    polygon = gpb(wkb("MultiPolygon", [[RING, HOLE]]), 1)
    write_geopackage(path, {"a": (4326, [(polygon, "Grün", 1)] * 3), "b": (32633, [])})


def kml(path):
    text = " ".join(f"{x},{y}" for x, y in RING)
    line = f"<LineString><coordinates>{text}</coordinates></LineString>"
    mark = f"<Placemark><name>Grün</name>{line}</Placemark>"
    path.write_text(f'<?xml version="1.0"?><kml><Folder>{mark * 3}</Folder></kml>', "utf-8")


def kmz(path):
    kml(path)
    text = path.read_bytes()
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", text)


def loose_shapefile(path):
    write_shapefile(path, [RING, HOLE, RING], ["Grün"])


MAKERS = {
    "a.geojson": geojson,
    "a.gpkg": geopackage,
    "a.kml": kml,
    "a.kmz": kmz,
    "a.shp": loose_shapefile,
}


def damaged(content, rng):
    """The bytes cut somewhere, or with some of them changed, or with a run of them so."""
    content = bytearray(content)
    way = rng.randrange(4)
    if way == 0:
        return content[: rng.randrange(len(content))]
    at = rng.randrange(len(content))
    if way == 1:
        content[at : at + 4] = rng.choice([b"\xff" * 4, b"\0" * 4, b"\x7f\xff\xff\xff"])
    for _ in range(rng.choice([1, 1, 3, 20]) if way > 1 else 0):
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    return content


def check(path):
    """Load; whatever comes is a map of finite places, or a message of one line."""
    try:
        layers = load_layers(str(path))
    except MapError as error:
        text = str(error)
    else:
        text = ""
    if text:
        assert text.startswith(str(path))
        assert "\n" not in text
        return False
    points = np.concatenate([f.points for layer in layers for f in layer.features])
    assert np.isfinite(points[:, :2]).all()
    assert not np.isinf(points[:, 2]).any()
    return True


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "suffix"),
    [*((name, "") for name in MAKERS), ("a.shp", ".dbf"), ("a.shp", ".prj"), ("a.shp", ".cpg")],
)
def test_damaged_files(tmp_path, name, suffix):
    path = tmp_path / name
    MAKERS[name](path)
    spoilt = path.with_suffix(suffix) if suffix else path
    if not spoilt.exists():
        spoilt.write_text("UTF-8")
    content = spoilt.read_bytes()
    assert check(path)
    rng = random.Random(5)
    results = []
    rounds = ROUNDS_OF.get(suffix, ROUNDS)
    tracemalloc.start()
    try:
        for _ in range(rounds):
            spoilt.write_bytes(damaged(content, rng))
            results.append(check(path))
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < MOST_BYTES
    assert results.count(False) > (rounds // 20 if suffix != ".cpg" else -1)
