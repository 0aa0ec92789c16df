"""What is written can be read, and what is none of ours is named."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from target_samples import ANSWERS, HOSTILE, TARGETS, click, target

from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.io.targets.formats import exported, exported_answers, read_targets
from tirgeo_ros.io.targets.store import TargetStore


def written(folder, content, name="targets"):
    path = folder / name
    path.write_bytes(content)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("written")


def test_a_geopackage_holds_every_click(tmp_path):
    assert read_targets(written(tmp_path, exported(TARGETS, "gpkg"))) == TARGETS


def test_a_geopackage_holds_the_pictures_too(tmp_path):
    jpegs = {TARGETS[1].id: b"\xff\xd8 a picture"}
    path = written(tmp_path, exported(TARGETS, "gpkg", jpegs.get))
    store = TargetStore(path)
    assert [store.picture(one.id) for one in TARGETS] == [None, b"\xff\xd8 a picture"]
    store.close()


@pytest.mark.parametrize("form", ["geojson", "csv"])
def test_others_hold_the_average_with_its_covariance(form, tmp_path):
    found = read_targets(written(tmp_path, exported(TARGETS, form)))
    for one, expected in zip(found, TARGETS, strict=True):
        said = ("id", "number", "name", "kind", "note", "aircraft", "created_ns", "changed_ns")
        assert [getattr(one, key) for key in said] == [getattr(expected, key) for key in said]
        place, wanted = one.place, expected.place
        assert place.stamp_ns == wanted.stamp_ns
        # nine decimals of a degree, a tenth of a millimetre, six digits
        assert place.latitude_deg == pytest.approx(wanted.latitude_deg, abs=0.51e-9)
        assert place.longitude_deg == pytest.approx(wanted.longitude_deg, abs=0.51e-9)
        assert place.height_m == pytest.approx(wanted.height_m, abs=0.51e-4)
        np.testing.assert_allclose(place.covariance_enu, wanted.covariance_enu, rtol=5e-6)


def test_points_of_others_are_not_left_out_without_a_word(tmp_path):
    mine = json.loads(exported(TARGETS, "geojson"))
    other = {"type": "Feature", "properties": {"kind": "fire"}, "geometry": None}
    path = written(tmp_path, json.dumps(mine | {"features": [*mine["features"], other]}).encode())
    with pytest.raises(TargetError, match=re.escape(f"{path}: a file which tirgeo did not write")):
        read_targets(path)


@pytest.mark.parametrize("form", ["geojson", "csv", "gpkg"])
def test_located_pixels_are_targets_with_the_pixels_names(form, tmp_path):
    path = written(tmp_path, exported_answers([*reversed(ANSWERS), ANSWERS[0]], form))
    found = read_targets(path)
    names = [one.name.replace("\x07", "") for one in found]
    assert names == ["sheep <1> & Ü"] * 2
    assert len({one.id for one in found}) == len({one.number for one in found}) == 2
    # and so the page can begin with them
    store = TargetStore(written(tmp_path, exported(found, "gpkg"), "t.gpkg"))
    assert store.all() == found
    assert store.add(click(), now_ns=1).number > found[-1].number
    store.close()


#: Without control characters and halves of characters, which the store takes out of a text.
texts = st.text(
    st.characters(exclude_categories=("Cs", "Cc"), include_characters="\n"), max_size=30
)


@given(texts, texts)
def test_any_text_reads_back(folder, name, note):
    one = target(1, name=name, note=note)
    for form in ("geojson", "csv"):
        (found,) = read_targets(written(folder, exported([one], form)))
        assert (found.name, found.note) == (name, note)


@given(st.text(";|\n=-'\" x", max_size=12))
def test_any_text_like_formulae_reads_back(folder, text):
    (found,) = read_targets(written(folder, exported([target(1, name="a", note=text)], "csv")))
    assert found.note == text


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_texts_read_back(text, tmp_path):
    for form in ("geojson", "csv"):
        (found,) = read_targets(written(tmp_path, exported([target(1, name=text)], form)))
        assert found.name.encode(errors="backslashreplace") == text.encode(
            errors="backslashreplace"
        )


def test_a_file_that_was_cut_short_by_a_kill_is_read(tmp_path):
    """A journal beside the file is of a change that was never confirmed."""
    path = tmp_path / "targets.gpkg"
    store = TargetStore(path)
    store.add(click(), now_ns=1)
    store._db.execute("PRAGMA cache_size = 1")
    store._db.execute("BEGIN EXCLUSIVE")
    store._db.execute("UPDATE clicks SET height_m = 7")
    store._db.execute("INSERT INTO pictures (target, jpeg) VALUES ('x', zeroblob(500000))")
    journal = tmp_path / "targets.gpkg-journal"
    copy = written(tmp_path, path.read_bytes(), "copy.gpkg")
    written(tmp_path, journal.read_bytes(), "copy.gpkg-journal")
    store._db.execute("ROLLBACK")
    assert read_targets(copy) == store.all()
    store.close()


def changed(change):
    document = json.loads(exported(TARGETS, "geojson"))
    change(document["features"])
    return json.dumps(document).encode()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "did not write"),
        (b"\x93\x00\xff", "not a text file"),
        (b"{", "did not write"),
        (b'{"features": [{"properties": {"kind": "point"}}]}', ""),
        (b"id,stamp_ns,u,v\n1,2,3,4\n", "did not write; give a GeoPackage, GeoJSON or CSV"),
        (b"SQLite format 3\0" + bytes(5000), "no GeoPackage|damaged"),
        (changed(lambda f: f[1]["properties"].update(latitude_deg=91)), "row 2 is one"),
        (changed(lambda f: f[1]["properties"].update(covariance_enu="nan")), "row 2 is one"),
        (changed(lambda f: f[0]["properties"].pop("stamp_ns")), "row 1 is one"),
        (changed(lambda f: f[0]["properties"].update(number=3)), "the same number"),
        (changed(lambda f: f.insert(0, f[0])), "the same id"),
    ],
)
def test_a_file_that_is_none_of_ours_is_named(content, said, tmp_path):
    path = written(tmp_path, content)
    if not said:
        assert read_targets(path) == []
        return
    with pytest.raises(TargetError, match=f"{re.escape(str(path))}: .*({said})"):
        read_targets(path)


def test_a_file_that_is_absent_is_named(tmp_path):
    with pytest.raises(TargetError, match=r"absent\.csv: cannot be read"):
        read_targets(tmp_path / "absent.csv")


def test_a_file_in_use_is_named(tmp_path):
    store = TargetStore(tmp_path / "targets.gpkg")
    with pytest.raises(TargetError, match="another program has it open"):
        read_targets(store.path)
    store.close()
