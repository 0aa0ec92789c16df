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
