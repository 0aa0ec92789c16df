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
"""A file of targets, and a store that has it open."""

from __future__ import annotations

import contextlib
import sqlite3

import pytest

from tirgeo_ros.io.targets.store import TargetStore


@pytest.fixture
def path(tmp_path):
    return tmp_path / "targets.gpkg"


@pytest.fixture
def store(path):
    with contextlib.closing(TargetStore(path)) as opened:
        yield opened


@pytest.fixture
def changed(path):
    """Change the file as another program does."""

    def change(*statements):
        with contextlib.closing(sqlite3.connect(path)) as db, db:
            for statement in statements:
                db.execute(statement)

    return change
