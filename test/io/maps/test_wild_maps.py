"""Maps as people have them: read, and lying where they were written, or refused by name."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from map_files import RING
from wild_maps import ELSEWHERE, READ, REFUSED

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps.layers import read_layers

CLOSE_DEG = 1e-8  # a millimetre
WHERE = {case: (name, write, RING, notes) for case, (name, write, notes) in READ.items()}


def written(folder, name, write):
    path = folder / name
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of GDAL on what a format cannot keep
        write(path)
    return path


def drawn(path):
    """Longitudes and latitudes (N, 2) deg of all features."""
    features = [f for layer in read_layers(str(path)) for f in layer.features]
    return np.degrees(np.concatenate([f.points for f in features])[:, 1::-1])


def check_same(got, wanted):
    """Each place is one of the other's, and the other way round; 180 is -180."""
    got, wanted = np.asarray(got), np.asarray(wanted)
    apart = np.abs(got[:, None] - wanted[None])
    apart[..., 0] = np.minimum(apart[..., 0], np.abs(360 - apart[..., 0]))
    apart = apart.max(axis=2)
    assert apart.min(axis=1).max() < CLOSE_DEG
    assert apart.min(axis=0).max() < CLOSE_DEG


@pytest.mark.parametrize("case", [*WHERE, *ELSEWHERE])
def test_a_map_is_read_where_it_lies(tmp_path, case):
    name, write, places, notes = {**WHERE, **ELSEWHERE}[case]
    path = written(tmp_path, name, write)
    before = sorted(tmp_path.iterdir())
    check_same(drawn(path), places)
    told = [note for layer in read_layers(str(path)) for note in layer.left_out]
    assert len(told) == len(notes), told
    for note, pattern in zip(told, notes, strict=True):
        assert note.startswith(f"{path}: ")
        assert re.search(pattern, note), note
    assert sorted(tmp_path.iterdir()) == before  # nothing is left beside the map


def test_letters_by_the_name_of_their_encoding(tmp_path):
    name, write, _ = READ["shapefile, letters by .cpg"]
    path = written(tmp_path, name, write)
    assert read_layers(str(path))[0].features[0].label == "消防栓"


@pytest.mark.parametrize("case", REFUSED)
def test_a_map_is_refused_by_name_with_what_to_do(tmp_path, case):
    name, write, message = REFUSED[case]
    path = written(tmp_path, name, write)
    with pytest.raises(MapError, match=message) as caught:
        read_layers(str(path))
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
