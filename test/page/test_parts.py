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
"""Parts of the page's server: connections, pace, files, tiles, exports, invitations."""

from __future__ import annotations

import hashlib
import re
import sqlite3
import time

import cv2
import numpy as np
import pytest
from page_clients import tile_file
from project import PROJECT

from tirgeo_ros.core.targets.target import KINDS
from tirgeo_ros.core.types.errors import PageError
from tirgeo_ros.page import connections, routes
from tirgeo_ros.page.access import Shares, WrongTokens
from tirgeo_ros.page.connections import OPERATOR, Allowance, Listener
from tirgeo_ros.page.routes import Tiles, invitation

URL = "https://192.168.1.20:8080/?token=abcdefghijklmnopqrstuvwx"


def test_an_allowance_fills_up_again_and_no_further():
    item = Allowance(2.0, 3.0)
    assert [item.take(100.0) for _ in range(4)] == [True, True, True, False]
    assert [item.take(101.0) for _ in range(3)] == [True, True, False]
    assert [item.take(200.0) for _ in range(4)] == [True, True, True, False]


def test_each_owner_has_an_allowance_and_old_owners_are_forgotten():
    many = Shares(1.0, 1.0)
    assert many.take(OPERATOR, "a", 0.0)
    assert not many.take(OPERATOR, "a", 0.0)
    for k in range(5000):
        assert many.take(OPERATOR, str(k), 0.0)
    assert len(many._allowances) == 1000


def test_each_wrong_token_costs_twice_the_time():
    wrong, now_s, waits = WrongTokens(), 0.0, []
    for _ in range(9):
        wrong.add("a", now_s)
        waits.append(wrong.wait_s("a", now_s))
        now_s += waits[-1]
    assert waits == [0.5, 1, 2, 4, 8, 16, 32, 60, 60]
    assert wrong.wait_s("b", now_s) == 0
    wrong.forget("a")
    assert wrong.wait_s("a", now_s - 60) == 0


class Held:
    """A connection that is held."""

    ended = False

    def abort(self):
        self.ended = True


def test_the_oldest_connection_without_a_request_is_ended_first(monkeypatch):
    monkeypatch.setattr(connections, "MOST", {None: (9, 3)})
    listener, crowd = Listener(), [Held() for _ in range(5)]
    for item in crowd[:3]:
        listener.opened(item, "crowd")
    listener.requested(crowd[0], None, "crowd")  # an honest user's, of the same address
    for item in crowd[3:]:
        listener.opened(item, "crowd")
    assert [item.ended for item in crowd] == [False, True, True, False, False]
    for item in (crowd[3], crowd[4]):
        listener.requested(item, None, "crowd")
    listener.opened(Held(), "crowd")  # the newest has had no time to ask
    assert [item.ended for item in crowd] == [True, True, True, False, False]


def test_at_the_limit_the_oldest_connection_of_the_largest_owner_is_ended(monkeypatch):
    monkeypatch.setattr(connections, "MOST", {None: (6, 4), "operator": (2, 2)})
    listener, crowd, few = Listener(), [], []
    for k in range(5):
        crowd.append(Held())
        listener._assign(crowd[k], None, "crowd")
    for k in range(3):
        few.append(Held())
        listener._assign(few[k], None, "few")
    assert [item.ended for item in crowd + few] == [True, True] + [False] * 6
    for _ in range(2):  # who enters takes no stranger's place any more
        listener._assign(few[0], "operator", "few")
    listener._assign(Held(), None, "other")
    assert [item.ended for item in crowd + few] == [True, True] + [False] * 6
    assert (listener.refused, len(listener.owners)) == (2, 7)


def test_the_terminals_code_can_be_scanned():
    code, text = invitation(URL).rsplit("\n", 1)
    assert text == URL
    halves = {"\u2588": (1, 1), "\u2580": (1, 0), "\u2584": (0, 1), " ": (0, 0)}
    rows = [[halves[c] for c in line] for line in code.split("\n")]
    light = np.array(rows).transpose(0, 2, 1).reshape(2 * len(rows), -1)
    image = np.kron(light, np.full((8, 8), 255)).astype(np.uint8)
    image = cv2.copyMakeBorder(image, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255)
    assert cv2.QRCodeDetector().detectAndDecode(image)[0] == URL


def test_tiles_are_counted_from_the_north(tmp_path):
    tiles = Tiles(tile_file(tmp_path / "a.mbtiles"))
    assert tiles.tile(2, 1, 0) == b"north"
    assert tiles.tile(2, 1, 3) is None
    assert tiles.tile(2, 1, 4) is None
    assert tiles.tile(60, 1, 4) is None
    assert (tiles.content_type, tiles.about["min"], tiles.about["max"]) == ("image/png", 2, 5)
    tiles.close()


def test_a_file_without_picture_tiles_is_named(tmp_path):
    vectors = tile_file(tmp_path / "v.mbtiles", "pbf")
    absent = tmp_path / "no.mbtiles"
    for path, words in ((vectors, "v.mbtiles: holds pbf"), (absent, "no.mbtiles: .*MBTiles")):
        with pytest.raises(PageError, match=words):
            Tiles(path)
    assert not absent.exists()


ENDLESS = "with recursive n(i) as (select 1 union all select i + 1 from n) select"


def with_views(path, **views):
    """An MBTiles file with views in place of tables."""
    with sqlite3.connect(tile_file(path)) as db:
        for name, query in views.items():
            db.execute(f"drop table {name}")
            db.execute(f"create view {name} as {query}")
    db.close()
    return path


@pytest.mark.parametrize(
    "views",
    [
        {"tiles": f"{ENDLESS} i + 30 as zoom_level, i as tile_data from n"},
        {"metadata": f"{ENDLESS} 'x' || i as name, i as value from n"},
    ],
)
def test_endless_tables_are_refused_in_time(tmp_path, monkeypatch, views):
    monkeypatch.setattr(routes, "_OPEN_S", 0.2)
    path = with_views(tmp_path / "a.mbtiles", **views)
    with pytest.raises(PageError, match=r"a\.mbtiles: its tables take too long to read: give an"):
        Tiles(path)


def test_an_endless_tile_ends_the_tiles_and_is_logged_once(tmp_path, caplog):
    data = f"case zoom_level when 9 then ({ENDLESS} count(*) from n) else x'ff' end as tile_data"
    grid = "(select 2 as zoom_level, 3 as tile_row union all select 9, 511)"
    view = f"select zoom_level, 1 as tile_column, tile_row, {data} from {grid}"
    tiles = Tiles(with_views(tmp_path / "a.mbtiles", tiles=view))
    assert tiles.tile(2, 1, 0) == b"\xff"
    begun_s = time.monotonic()
    assert [tiles.tile(9, 1, 0) for _ in range(20)] == [None] * 20
    assert time.monotonic() - begun_s < 5  # 20 that each take their time: 10 s
    assert len(caplog.records) == 1
    assert caplog.messages[0].startswith("the map lacks tiles: tiles: ")
    assert "a.mbtiles: its tables take too long to read: give" in caplog.text


@pytest.mark.parametrize(
    "content",
    [2_000_000_000, "a text", bytes((1 << 22) + 1), None, -1, 1.5],
    ids=["two_billion", "text", "4_MB", "null", "negative", "real"],
)
def test_data_that_are_no_picture_are_no_tile(tmp_path, content):
    path = tile_file(tmp_path / "a.mbtiles")
    with sqlite3.connect(path) as db:
        db.execute("update tiles set tile_data = ?", (content,))
    db.close()
    assert Tiles(path).tile(2, 1, 0) is None


def test_a_damaged_file_lacks_tiles_and_is_logged_once(tmp_path, caplog):
    path = tile_file(tmp_path / "a.mbtiles")
    with sqlite3.connect(path) as db:
        db.execute("insert into tiles values (9, 1, 511, zeroblob(100000))")
        db.execute("insert into tiles values (9, 2, 511, zeroblob(100000))")
    db.close()
    data = path.read_bytes()
    path.write_bytes(data[:20_000] + b"\xff" * (len(data) - 20_000))
    tiles = Tiles(path)
    assert [tiles.tile(9, 1, 0), tiles.tile(9, 2, 0)] == [None, None]
    assert tiles.tile(2, 1, 0) == b"north"
    assert len(caplog.records) == 1


STATIC = PROJECT / "tirgeo_ros/page/static"
INDEX = (STATIC / "index.html").read_text()
OWN = sorted([*STATIC.glob("js/**/*.js"), *STATIC.glob("style/*.css")])
#: Of Leaflet 1.9.4 as npm and PyPI have it.
LEAFLET = "db49d009c841f5ca34a888c96511ae936fd9f5533e90d8b2c4d57596f4e5641a"


def name(path):
    return str(path.relative_to(STATIC))


@pytest.mark.parametrize("module", STATIC.glob("js/**/*.js"), ids=name)
def test_imports_lead_to_files(module):
    imports = re.findall(r'(?:from|^import) "([^"]+)";', module.read_text(), re.MULTILINE)
    assert [item for item in imports if not (module.parent / item).is_file()] == []


def test_every_module_is_reached():
    reached, waiting = set(), {STATIC / "js/main.js", *STATIC.glob("js/words/*.js")}
    while waiting:
        module = waiting.pop().resolve()
        reached.add(module)
        imports = re.findall(r'(?:from|^import) "([^"]+)";', module.read_text(), re.MULTILINE)
        waiting |= {(module.parent / item).resolve() for item in imports} - reached
    assert {path.resolve() for path in STATIC.glob("js/**/*.js")} <= reached


def test_the_page_names_files_that_exist():
    named = re.findall(r'(?:href|src)="/static/([^"]+)"', INDEX)
    assert named
    assert [item for item in named if not (STATIC / item).is_file()] == []
    assert {f"style/{path.name}" for path in STATIC.glob("style/*.css")} <= set(named)


def test_the_page_has_no_inline_script_or_style():
    assert re.findall(r"<style|\sstyle=|\son[a-z]+=|<script(?![^>]*\ssrc=)", INDEX) == []


@pytest.mark.parametrize("path", OWN, ids=name)
def test_data_never_become_markup_and_nothing_comes_from_elsewhere(path):
    text = path.read_text().replace("http://www.w3.org/2000/svg", "")
    refused = (
        r"\.(?:innerHTML|outerHTML)\b|insertAdjacentHTML|document\.write|\beval\(|https?://\w"
    )
    assert re.findall(refused, text) == []
    assert len(text.splitlines()) <= 300 or path.parent.name == "words"


def test_every_kind_and_button_has_its_symbol():
    symbols = set(re.findall(r'<symbol id="icon-(\w+)"', INDEX))
    text = "".join(path.read_text() for path in STATIC.glob("js/**/*.js"))
    used = set(re.findall(r'\b(?:icon|button)\(\s*"(\w+)"', text))
    assert used | set(KINDS) <= symbols


def test_leaflet_is_unchanged_and_has_its_licence():
    folder = STATIC / "vendor/leaflet"
    assert hashlib.sha256((folder / "leaflet.js").read_bytes()).hexdigest() == LEAFLET
    assert "BSD 2-Clause" in (folder / "LICENSE").read_text()
