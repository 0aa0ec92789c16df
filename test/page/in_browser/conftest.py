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
"""Chromium, tablets on it, and a served page."""

from __future__ import annotations

import pytest
from browser import DESK, TABLET, Screen, chromium
from served_page import ServedPage


@pytest.fixture(scope="module")
def browser():
    """One a file: beside a running one no asyncio loop of another test could run."""
    with chromium() as running:
        yield running


@pytest.fixture
def serve(tmp_path):
    """Serve pages; all end with the test."""
    served = []

    def begin(*aircraft, **config):
        served.append(ServedPage(tmp_path, aircraft or ("",), **config))
        return served[-1]

    yield begin
    for item in served:
        item.stop()


@pytest.fixture
def tablet(browser):
    """Open tablets, each a browser of its own; at the end none may have complained."""
    screens = []

    def take(url, size=TABLET, *, expected="", **options):
        screens.append(Screen(browser, size, **options))
        screens[-1].expected = expected
        return screens[-1].enter(url)

    yield take
    complaints = [line for screen in screens for line in screen.complaints]
    hosts = {host for screen in screens for host in screen.hosts}
    for screen in screens:
        screen.close()
    assert complaints == []
    assert len(hosts) <= 1


@pytest.fixture(scope="module")
def screen(browser, tmp_path_factory):
    """A page whose modules are called; its own video is not looked at."""
    served = ServedPage(tmp_path_factory.mktemp("page"))
    opened = Screen(browser, DESK).enter(served.url)
    opened.await_picture()
    yield opened
    opened.close()
    served.stop()
