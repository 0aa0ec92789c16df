"""Open a GeoPackage of targets for this process alone, and explain what is wrong with a file."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.io.targets.geopackage import is_of_targets, load_targets, make_tables, renew

_WAIT_S = 2.0  # for a program that is just ending
#: A part of SQLite's message -> what to do.
_REMEDIES = {
    "locked": "another program has it open (a second viewer_node, QGIS): close that, or give the "
    "targets another file",
    "full": "no room on the disk: make some and do it again; what was there before is kept",
    "readonly": "it is read-only: choose a place that can be written",
    "unable to open": "its folder cannot be written: choose another place",
    "disk I/O": "the disk fails: what was there before is kept; choose another disk",
    "not a database": "it is no GeoPackage; give the targets another name",
}
DAMAGED = (
    "it is damaged and was left as it is: move it away to begin a new one; the command "
    "'sqlite3 FILE .recover' gets back what it still holds"
)


@contextlib.contextmanager
def explained(path: Path) -> Iterator[None]:
    """Raise TargetError, naming the file and what to do, for what SQLite raises."""
    try:
        yield
    except sqlite3.Error as error:
        remedies = (text for part, text in _REMEDIES.items() if part in str(error))
        raise TargetError(f"{path}: {next(remedies, DAMAGED)} ({error})") from None


def opened(path: Path) -> tuple[sqlite3.Connection, list[Target]]:
    """Open a file for this process alone, or make it; return it with its targets.

    Raises TargetError for a folder that does not exist, a file that cannot be written, is
    damaged, of another program or open in one.
    """
    if not path.parent.is_dir():
        raise TargetError(f"{path}: there is no such folder; make it, or give another place")
    if path.exists() and not path.is_file():
        raise TargetError(f"{path}: not a file; give the targets another name")
    with explained(path), contextlib.ExitStack() as stack:
        db = sqlite3.connect(path, _WAIT_S, isolation_level=None, check_same_thread=False)
        stack.callback(db.close)
        # The lock is kept until the file is closed. Each commit is complete in the one file, so
        # that a copy of it after a crash lacks nothing; a WAL would be a second file.
        for setting in ("locking_mode = EXCLUSIVE", "trusted_schema = OFF", "synchronous = EXTRA"):
            db.execute(f"PRAGMA {setting}")
        if not _is_empty(db):
            check_tables(db, path)
        db.execute("PRAGMA journal_mode = DELETE")
        with transaction(db):
            if _is_empty(db):
                make_tables(db)
            renew(db)
            db.execute("UPDATE gpkg_contents SET srs_id = srs_id")  # can the file be written?
        try:
            targets = load_targets(db)
        except (TargetError, TypeError, ValueError, AttributeError) as error:
            raise TargetError(f"{path}: {DAMAGED} ({error})") from None
        db.text_factory = partial(str, encoding="utf-8", errors="replace")  # else one byte of the
        stack.pop_all()  # journal would keep all of it from being read
        return db, targets


@contextlib.contextmanager
def transaction(db: sqlite3.Connection) -> Iterator[None]:
    """Commit what is done within, or undo all of it if something is raised."""
    db.execute("BEGIN EXCLUSIVE")
    try:
        yield
        db.execute("COMMIT")
    except BaseException:
        if db.in_transaction:
            db.execute("ROLLBACK")
        raise


def _is_empty(db: sqlite3.Connection) -> bool:
    return not db.execute("SELECT name FROM sqlite_master LIMIT 1").fetchall()


def check_tables(db: sqlite3.Connection, path: Path) -> None:
    """Refuse a file that is damaged, or that another program made; neither is written to."""
    if not is_of_targets(db):
        raise TargetError(
            f"{path}: a database that tirgeo did not make; give the targets another name"
        )
    found = db.execute("PRAGMA quick_check(1)").fetchone()
    if found != ("ok",):
        raise TargetError(f"{path}: {DAMAGED} ({found[0]})")
