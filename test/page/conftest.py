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
"""Pages that are served while a file of tests runs, and the team's TAK server."""

from __future__ import annotations

import pytest
from page_clients import TOKENS, Served
from tak_server import TakServer


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """A page on this computer alone: no token."""
    with Served(tmp_path_factory.mktemp("page")) as item:
        yield item


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    """A page that other computers reach: with tokens."""
    with Served(tmp_path_factory.mktemp("page"), **TOKENS) as item:
        yield item


@pytest.fixture
def fresh(tmp_path):
    """A page with tokens, of whose shares and tries nobody has used any."""
    with Served(tmp_path, **TOKENS) as item:
        yield item


@pytest.fixture
def server(tmp_path):
    """A TAK server, as the team has it, without TLS."""
    taky = TakServer(tmp_path)
    taky.start()
    yield taky
    taky.kill()
