"""The videos play in a browser, where there is one: headless Chromium."""

from __future__ import annotations

import functools
import http.server
import json
import queue
import shutil
import subprocess
import threading

import numpy as np
import pytest

from tirgeo_ros.io.video.video_file import VideoFile

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
#: A browser starts in seconds; this ends the test where it never says a thing.
HANGS_S = 120
PAGE = """<!doctype html><video id="v" muted src="VIDEO"></video><script>
const v = document.getElementById("v"), g = document.createElement("canvas").getContext("2d");
const say = (what) => {
  if (v.videoWidth) g.drawImage(v, 0, 0);
  fetch("said", {method: "POST", body: JSON.stringify({
    what, width: v.videoWidth, height: v.videoHeight, duration_s: v.duration,
    at_s: v.currentTime, rgb: [...g.getImageData(30, 20, 1, 1).data].slice(0, 3),
  })});
};
v.onerror = () => say(v.error.message);
v.onended = () => say("ended");
v.play();
</script>"""


class Handler(http.server.SimpleHTTPRequestHandler):
    """Serves a folder, and keeps what the page says."""

    said: queue.Queue[dict[str, object]]

    def do_POST(self) -> None:
        self.said.put(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self.send_response(204)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.fixture
def browser():
    found = next((one for one in map(shutil.which, BROWSERS) if one), None)
    return found or pytest.skip(f"none of {', '.join(BROWSERS)} is installed")


@pytest.fixture
def said(tmp_path):
    """What the page in the folder says, and its address."""
    handler = type("Kept", (Handler,), {"said": queue.Queue()})
    serve = functools.partial(handler, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), serve) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield handler.said, f"http://127.0.0.1:{server.server_port}/page.html"
        server.shutdown()


@pytest.mark.parametrize("name", ["out.mp4", "out.webm"])
def test_it_plays_to_its_end(tmp_path, browser, said, name):
    with VideoFile(tmp_path / name) as video:
        for k in range(20):
            video.add(k * 100_000_000, np.full((48, 64, 3), (40, 120, 200), np.uint8))
    (tmp_path / "page.html").write_text(PAGE.replace("VIDEO", name))
    answers, address = said
    words = ["--headless", "--no-sandbox", "--autoplay-policy=no-user-gesture-required"]
    words += [f"--user-data-dir={tmp_path / 'profile'}", "--disable-gpu", "--no-first-run"]
    with subprocess.Popen([browser, *words, address], stderr=subprocess.DEVNULL) as process:
        try:
            answer = answers.get(timeout=HANGS_S)
        finally:
            process.terminate()
    assert answer["what"] == "ended"
    assert (answer["width"], answer["height"]) == (64, 48)
    # MP4 has no end of the last frame: it counts for nothing, or for as long as the one before.
    assert answer["at_s"] == answer["duration_s"] == pytest.approx(1.95, abs=0.06)
    # Red, green, blue through 8-bit limited-range YUV.
    np.testing.assert_allclose(answer["rgb"], [200, 120, 40], atol=6)
