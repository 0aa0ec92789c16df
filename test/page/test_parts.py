"""Small parts of the page: limits, codes, tiles, the video's pictures."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from page_backend import HEIGHT, WIDTH, Pictures
from page_clients import tile_file

from tirgeo_ros.core.types.errors import PageError
from tirgeo_ros.page import connections
from tirgeo_ros.page.access import OPERATOR
from tirgeo_ros.page.connections import Door
from tirgeo_ros.page.limits import Allowance, Shares, WrongTokens
from tirgeo_ros.page.pace import LEVELS
from tirgeo_ros.page.routes import invitation
from tirgeo_ros.page.tiles import Tiles
from tirgeo_ros.page.video_feed import VideoFeed

URL = "https://192.168.1.20:8080/?token=abcdefghijklmnopqrstuvwx"


def test_an_allowance_fills_up_again_and_no_further():
    one = Allowance(2.0, 3.0)
    assert [one.take(100.0) for _ in range(4)] == [True, True, True, False]
    assert [one.take(101.0) for _ in range(3)] == [True, True, False]
    assert [one.take(200.0) for _ in range(4)] == [True, True, True, False]


def test_owners_have_each_their_own_and_are_forgotten():
    many = Shares(1.0, 1.0)
    assert many.take(OPERATOR, "a", 0.0)
    assert not many.take(OPERATOR, "a", 0.0)
    for k in range(5000):
        assert many.take(OPERATOR, str(k), 0.0)
    assert len(many._known) == 1000


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


def test_in_a_full_house_the_oldest_of_whoever_holds_most_goes(monkeypatch):
    class Task:
        ended = False

        def cancel(self):
            self.ended = True

    monkeypatch.setattr(connections, "MOST", {None: (6, 4), "operator": (2, 2)})
    door, crowd, few = Door(None, None, None), [], []
    for k in range(5):
        crowd.append(Task())
        door._seat(crowd[k], None, "crowd")
    for k in range(3):
        few.append(Task())
        door._seat(few[k], None, "few")
    assert [one.ended for one in crowd + few] == [True, True] + [False] * 6
    for _ in range(2):  # who enters takes no stranger's place any more
        door._seat(few[0], "operator", "few")
    door._seat(Task(), None, "other")
    assert [one.ended for one in crowd + few] == [True, True] + [False] * 6
    assert (door.refused, door.connections) == (2, 7)


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


def test_what_holds_no_pictures_is_named(tmp_path):
    vectors = tile_file(tmp_path / "v.mbtiles", "pbf")
    absent = tmp_path / "no.mbtiles"
    for path, words in ((vectors, "v.mbtiles: holds pbf"), (absent, "no.mbtiles: .*MBTiles")):
        with pytest.raises(PageError, match=words):
            Tiles(path)
    assert not absent.exists()


def test_pictures_are_made_smaller_once_for_all_who_want_them():
    async def look():
        with ThreadPoolExecutor(1) as workers:
            feed = VideoFeed(workers)
            feed.show(1, 1, jpeg)
            found = [feed.bytes_at(feed.newest, level) for level in range(len(LEVELS))]
            again = [feed.bytes_at(feed.newest, level) for level in range(len(LEVELS))]
            return await asyncio.gather(*found), await asyncio.gather(*again)

    jpeg = Pictures().jpeg(0)
    found, again = asyncio.run(look())
    assert found[0] is jpeg
    assert all(one is other for one, other in zip(found, again, strict=True))
    sizes = [len(one) for one in found]
    assert sizes == sorted(sizes, reverse=True)
    for made, level in zip(found, LEVELS, strict=True):
        size = cv2.imdecode(np.frombuffer(made, np.uint8), 1).shape[:2]
        assert size == (HEIGHT // level.divisor, WIDTH // level.divisor)


def test_damaged_pictures_are_counted_and_the_last_stays():
    with ThreadPoolExecutor(1) as workers:
        feed = VideoFeed(workers)
        jpeg = Pictures().jpeg(0)
        feed.show(1, 1, jpeg)
        for damaged in (b"", b"no picture", jpeg[:100], b"\x89PNG" + jpeg):
            feed.show(2, 2, damaged)
        assert feed.damaged == 4
        assert feed.newest.stamp_ns == 1


@pytest.mark.parametrize(
    ("u", "v", "size"), [(320, 256, (160, 160)), (0, 0, (160, 160)), (639, 511, (81, 81))]
)
def test_a_cut_out_is_around_the_pixel(u, v, size):
    with ThreadPoolExecutor(1) as workers:
        feed = VideoFeed(workers)
        feed.show(7, 7, Pictures().jpeg(0))
        found = feed.cut_out(7, u, v)()
        assert cv2.imdecode(np.frombuffer(found, np.uint8), 1).shape[:2] == size
        assert feed.cut_out(8, u, v)() is None
        assert feed.cut_out(7, 5000, -5000)() is None
