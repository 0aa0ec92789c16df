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
"""Read the messages of one SQLite file of rosbag2 (``.db3``) in order of time."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.measurements import LAST_NS
from tirgeo_ros.io.bags.bag_file import TOO_LATE, BagFile, Connection, Row, TopicForm

MAGIC = b"SQLite format 3\0"

_TABLES = """
SELECT name FROM sqlite_master
WHERE type = 'table' AND name IN ('topics', 'messages', 'message_definitions')
"""
#: First and last time, of numbers alone: SQLite sorts NULL before them and text after them.
_SPAN = """
SELECT (SELECT min(timestamp) FROM messages WHERE timestamp >= 0),
    (SELECT max(timestamp) FROM messages WHERE timestamp < ?)
"""
_DEFINITIONS = """
SELECT topic_type, encoding, encoded_message_definition AS text FROM message_definitions
"""
#: The topics that have messages; the search ends as soon as every topic was met.
_USED_TOPICS = """
SELECT DISTINCT topic_id FROM messages WHERE topic_id IN (SELECT id FROM topics)
LIMIT (SELECT count(*) FROM topics)
"""
#: Numbers of messages: in the table, in the index of their times, and without a topic.
_COUNTS = """
SELECT (SELECT count(*) FROM messages NOT INDEXED),
    (SELECT count(*) FROM messages WHERE timestamp >= 0),
    (SELECT count(*) FROM messages WHERE topic_id NOT IN (SELECT id FROM topics))
"""
#: Only the messages' keys are sorted (by the index of the times, where there is one), so that the
#: data do not fill the memory; LIMIT and LEFT keep SQLite from joining first.
_IN_ORDER = """
SELECT m.topic_id, m.timestamp, m.data
FROM (SELECT id FROM messages WHERE timestamp >= ? ORDER BY timestamp, id LIMIT -1) AS sorted
LEFT JOIN messages AS m ON m.id = sorted.id
WHERE m.topic_id IN ({}) OR m.id IS NULL
"""


class SqliteFile(BagFile):
    """Read a database, and never write to it.

    It needs no definitions of types: those of the contract are known here. Raises BagError if it
    is not of rosbag2, cut off or damaged.
    """

    def __init__(self, path: Path, name: Path) -> None:
        super().__init__(path, name)
        try:
            with self._opened() as base:
                tables = {name for (name,) in base.execute(_TABLES)}
                if not {"topics", "messages"} <= tables:
                    raise BagError(f"{name}: a SQLite database, but not of rosbag2")
                first_ns, last_ns = base.execute(_SPAN, (LAST_NS,)).fetchone()
                empty = None in (first_ns, last_ns)
                self.span_ns = None if empty else (int(first_ns), int(last_ns))
                self.connections = self._connections(base, tables)
                total, indexed, strays = base.execute(_COUNTS).fetchone()
                if total != indexed:
                    self.losses[2] = (
                        f"only {indexed} of {total} messages are in the index of times"
                    )
                if strays:
                    self.losses[3] = f"{strays} messages belong to no known topic"
        except (sqlite3.Error, ValueError) as error:
            raise BagError(
                f"{name}: the database is cut off or damaged ({error}); recover it with "
                "sqlite3 and its command .recover"
            ) from None

    def _connections(self, base: sqlite3.Connection, tables: set[str]) -> dict[int, Connection]:
        """Return the topics that have messages."""
        used = {key for (key,) in base.execute(_USED_TOPICS)}
        base.row_factory = sqlite3.Row
        rows = [dict(row) for row in base.execute("SELECT * FROM topics") if row["id"] in used]
        types = self._definitions(base) if "message_definitions" in tables else {}
        base.row_factory = None
        return {
            row["id"]: Connection(str(row["name"]), _form(row, types.get(str(row["type"]))))
            for row in rows
        }

    def _definitions(self, base: sqlite3.Connection) -> dict[str, sqlite3.Row]:
        """Return the definitions of types; older recorders wrote none."""
        try:
            return {str(row["topic_type"]): row for row in base.execute(_DEFINITIONS)}
        except sqlite3.Error as error:
            self.losses[4] = f"the definitions of its types cannot be read ({error})"
            return {}

    def rows(self, keys: Collection[int], start_ns: int) -> Iterator[Row]:
        """Yield the messages of topics in order of log time, up to where the file is damaged."""
        query, late = _IN_ORDER.format(",".join("?" * len(keys))), 0
        try:
            with self._opened() as base:
                for key, log_ns, data in base.execute(query, (start_ns, *keys)):
                    if not isinstance(log_ns, int) or not isinstance(data, bytes):
                        self.losses[1] = "a message has no time or no data"
                    elif log_ns >= LAST_NS:
                        late += 1
                        self.losses[2] = f"{late} {TOO_LATE}"
                    else:
                        yield log_ns, 1, 0, key, data
        except sqlite3.Error as error:
            self.losses[0] = f"the database is damaged from here on ({error})"

    @contextmanager
    def _opened(self) -> Iterator[sqlite3.Connection]:
        """Yield a connection that writes nothing, not even beside the file."""
        # SQLite may repair a copy. Unless the original is immutable, it writes files beside it.
        how = "mode=ro&immutable=1" if self.path == self.name else "mode=rw"
        address = f"{self.path.resolve().as_uri()}?{how}"
        with closing(sqlite3.connect(address, uri=True, check_same_thread=False)) as connection:
            connection.execute("PRAGMA trusted_schema = OFF")
            yield connection


def _form(topic: dict[str, Any], definition: sqlite3.Row | None) -> TopicForm:
    """Return the form of a row of ``topics``, whose columns depend on the recorder's version."""
    columns = {
        "offered_qos_profiles": topic.get("offered_qos_profiles"),
        "topic_type_hash": topic.get("type_description_hash"),
    }
    metadata = {name: str(value) for name, value in columns.items() if value}
    text = encoding = ""
    if definition is not None:
        text, encoding = str(definition["text"]), str(definition["encoding"])
    form = str(topic["serialization_format"])
    return TopicForm(str(topic["type"]), text.encode(), encoding, form, metadata)
