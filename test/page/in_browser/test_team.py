"""From ``tirgeo demo --page`` to the TAK server: the operator's task, by finger, over taky."""

from __future__ import annotations

import pytest
from flown_page import FlownPage
from tak_server import Member

pytestmark = [pytest.mark.graph, pytest.mark.slow]

MOST_TAPS = 6
TRIES = 40


@pytest.fixture
def demo(server, tmp_path):
    words = ["--page", "127.0.0.1:0", "--cot", server.address, "-o", tmp_path / "demo"]
    page = FlownPage(tmp_path, "demo", *words, "--rate", "0.5")
    yield page
    page.close()


def press_while_there_is_a_map(screen):
    """Touch the video until a target is there: a busy machine may have no pose yet."""
    for _ in range(TRIES):
        screen.taps = 0
        screen.await_picture(screen.stamp_ns())
        screen.tap_on(".kind[data-kind=person]")
        screen.tap(*screen.on_screen(320.0, 300.0))
        screen.wait("() => document.querySelector('.answer').dataset.tone !== 'wait'")
        if screen.page.evaluate("() => document.querySelector('.answer').dataset.tone") == "good":
            return
        screen.page.wait_for_timeout(1000)
    raise AssertionError(f"no target in {TRIES} presses")


def test_a_person_in_the_video_is_on_the_teams_map_in_six_taps(demo, server, tablet):
    """Kind, press, share: three."""
    member = Member.of(server)
    screen = tablet(demo.url)
    press_while_there_is_a_map(screen)
    screen.tap_on("#share")
    event = member.got(lambda one: one.get("type") == "b-m-p-s-m")
    assert screen.taps <= MOST_TAPS
    screen.tap_on(".row")
    shown = screen.one(".value[data-form=decimal]").inner_text()
    point = event.find("point")
    place = [float(point.get(name)) for name in ("lat", "lon")]
    assert [float(part) for part in shown.split(",")] == pytest.approx(place, abs=2e-6)
    assert "person" in event.find("detail/remarks").text.lower()
    member.close()
