"""Read the messages of one SQLite file of rosbag2 (``.db3``) in order of time."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.measurements import LAST_NS
from tirgeo_ros.io.bags.storage import TOO_LATE, BagMessage, TopicForm, plain

MAGIC = b"SQLite format 3\0"

_TABLES = """
SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name IN ('topics', 'messages')
"""
#: Of numbers, before which NULL and behind which text is sorted.
_SPAN = """
SELECT (SELECT min(timestamp) FROM messages WHERE timestamp >= 0),
    (SELECT max(timestamp) FROM messages WHERE timestamp < ?)
"""
_NAMES = "SELECT name FROM sqlite_master WHERE type = 'table'"
_DEFINITIONS = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
#: Ends as soon as every topic was met.
_SPOKEN = """
SELECT DISTINCT topic_id FROM messages WHERE topic_id IN (SELECT id FROM topics)
LIMIT (SELECT count(*) FROM topics)
"""
#: Messages in the table and by their times, which have an index; and those of no topic.
_COUNTS = """
SELECT (SELECT count(*) FROM messages NOT INDEXED),
    (SELECT count(*) FROM messages WHERE timestamp >= 0),
    (SELECT count(*) FROM messages WHERE topic_id NOT IN (SELECT id FROM topics))
"""
#: The messages' keys are sorted alone (by the index of the times, where there is one), so that
#: the data never wait in memory; LIMIT and LEFT keep SQLite from joining first.
_IN_ORDER = """
SELECT m.topic_id, m.timestamp, m.data
FROM (SELECT id FROM messages WHERE timestamp >= ? ORDER BY timestamp, id LIMIT -1) AS sorted
LEFT JOIN messages AS m ON m.id = sorted.id
WHERE m.topic_id IN ({}) OR m.id IS NULL
"""


class SqliteFile:
    """Read a database, which is never written to.

    It needs no definitions of the types: the contract's are known. Raises BagError if it is no
    rosbag2, cut off or damaged.
    """

    def __init__(self, path: Path, name: Path) -> None:
        self.name, self.read = name, 0
        self.losses: dict[int, str] = {}
        self._path = path
        try:
            with self._connection() as connection:
                self._topics, self.span_ns = self._contents(connection)
        except (sqlite3.Error, ValueError) as error:
            raise BagError(
                f"{name}: the database is cut off or damaged ({error}); recover it with "
                "sqlite3 and its command .recover"
            ) from None

    def _contents(
        self, connection: sqlite3.Connection
    ) -> tuple[dict[int, tuple[str, str, str]], tuple[int, int] | None]:
        """Return the topics that have messages (name, type, format), and the span of times."""
        if connection.execute(_TABLES).fetchone() != (2,):
            raise BagError(f"{self.name}: a SQLite database, but not of rosbag2")
        first_ns, last_ns = connection.execute(_SPAN, (LAST_NS,)).fetchone()
        spoken = {key for (key,) in connection.execute(_SPOKEN)}
        rows = connection.execute("SELECT id, name, type, serialization_format FROM topics")
        topics = {key: (str(a), str(b), str(c)) for key, a, b, c in rows if key in spoken}
        there, timed, strays = connection.execute(_COUNTS).fetchone()
        if there != timed:
            self.losses[2] = f"of {there} messages {timed} are in the order of time"
        if strays:
            self.losses[3] = f"{strays} messages belong to no known topic"
        return topics, None if None in (first_ns, last_ns) else (int(first_ns), int(last_ns))

    def topics(self) -> dict[str, str]:
        """Return every topic of which the file has messages, with the name of its type."""
        return {topic: typename for topic, typename, _ in self._topics.values()}

    def forms(self) -> dict[str, TopicForm]:
        """Return how each of these topics was recorded; older recorders knew no definitions."""
        try:
            with self._connection() as connection:
                connection.row_factory = sqlite3.Row
                tables = [str(name) for (name,) in connection.execute(_NAMES)]
                known = _DEFINITIONS if "message_definitions" in tables else "SELECT 1 WHERE 0"
                types = {str(row["topic_type"]): row for row in connection.execute(known)}
                rows = [dict(row) for row in connection.execute("SELECT * FROM topics")]
        except sqlite3.Error as error:
            raise BagError(f"{self.name}: its topics cannot be read ({error})") from None
        return {
            str(row["name"]): _form(row, types.get(str(row["type"])))
            for row in rows
            if row["id"] in self._topics
        }

    def messages(
        self, topics: Collection[str] | None, start_ns: int, *, any_form: bool = False
    ) -> Iterator[BagMessage]:
        """Return the messages of these topics (None: all) in order of log time, from one on.

        Raises BagError if one of these topics is not in CDR, unless they may have ``any_form``.
        """
        types = {}
        for key, (topic, typename, form) in self._topics.items():
            if topics is None or topic in topics:
                if form != "cdr" and not any_form:
                    raise BagError(
                        f"{self.name}: topic {topic} is encoded as {form or 'nothing'}; record it "
                        "with ROS 2 (cdr)"
                    )
                types[key] = (topic, typename)
        return self._ordered(types, start_ns)

    def _ordered(self, types: dict[int, tuple[str, str]], start_ns: int) -> Iterator[BagMessage]:
        self.read = late = 0
        for key, log_ns, data in self._rows(start_ns, list(types)):
            if isinstance(log_ns, int) and log_ns >= LAST_NS:
                late += 1
                self.losses[2] = f"{late} {TOO_LATE}"
                continue
            try:
                message = _message(*types.get(key, ("", "")), log_ns, data)
            except ValueError as error:
                self.losses[1] = f"a message {error}"
                continue
            self.read += 1
            yield message

    def _rows(self, start_ns: int, keys: Sequence[int]) -> Iterator[tuple[int, object, object]]:
        """Yield topic, time and data of messages, up to where the file is damaged."""
        query = _IN_ORDER.format(",".join("?" * len(keys)))
        try:
            with self._connection() as connection:
                yield from connection.execute(query, (start_ns, *keys))
        except sqlite3.Error as error:
            self.losses[0] = f"the database is damaged from here on ({error})"

    @contextmanager
    def _connection(self) -> Iterator[sqlite3.Connection]:
        """Yield a connection that writes nothing, not even beside the file."""
        # SQLite may mend a copy; without immutable it would write beside what it only reads.
        how = "mode=ro&immutable=1" if self._path == self.name else "mode=rw"
        address = f"{self._path.resolve().as_uri()}?{how}"
        with closing(sqlite3.connect(address, uri=True, check_same_thread=False)) as connection:
            connection.execute("PRAGMA trusted_schema = OFF")
            yield connection


def _form(topic: dict[str, Any], definition: sqlite3.Row | None) -> TopicForm:
    """Return the form of a row of ``topics``; which columns there are depends on the recorder."""
    told = {
        "offered_qos_profiles": topic.get("offered_qos_profiles"),
        "topic_type_hash": topic.get("type_description_hash"),
    }
    metadata = {name: str(value) for name, value in told.items() if value}
    encoding, text = "", ""
    if definition is not None:
        _, encoding, text = map(str, definition)
    form = str(topic["serialization_format"])
    return TopicForm(str(topic["type"]), text.encode(), encoding, form, metadata)


def _message(topic: str, typename: str, log_ns: object, data: object) -> BagMessage:
    """Return a row's message. Raises ValueError: what is wrong with it."""
    if not isinstance(log_ns, int) or not isinstance(data, bytes):
        raise ValueError("has no time or no data")  # noqa: TRY004  as for one that is damaged
    return BagMessage(topic, typename, log_ns, plain(data))
