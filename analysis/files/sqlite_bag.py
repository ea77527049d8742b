"""The messages of a bag in SQLite, rosbag2's first format, in the order of their times.

A database can hold views and triggers that compute without end. So only plain tables are read, and only for so many
steps. It has no checksums: a changed bit in a message makes another message.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass

from analysis.files.mcap_messages import Found

MAGIC = b"SQLite format 3\0"
_VERSIONS, _NO_LOG = 18, b"\1\1"
"""Where a header says whether a log beside the file is used (WAL, of rosbag2's resilient preset), and that none is: a
database in memory has none (sqlite.org, Database File Format, 1.3.3)."""
_MOST_STEPS = 500_000_000
"""Steps of SQLite's virtual machine: half a minute, and several times what five million messages take."""
_STEPS = 1_000_000
_PLAIN = "SELECT count(*) FROM sqlite_master WHERE name IN ('messages', 'topics') AND type = 'table' AND rootpage > 0"
_MESSAGES = """SELECT topics.name, topics.type, topics.serialization_format, messages.timestamp, messages.data
FROM messages JOIN topics ON messages.topic_id = topics.id ORDER BY messages.timestamp"""


@dataclass(frozen=True)
class SqliteBag:
    """A database in memory."""

    data: bytes
    where: str
    has_checksums = False
    is_whole = True

    def messages(self) -> Iterator[Found]:
        """Yield the messages in the order in which they were received.

        Raises sqlite3.Error for a damaged database, and for one that is no bag.
        """
        steps = iter(range(_MOST_STEPS // _STEPS))
        with closing(sqlite3.connect(":memory:")) as database:
            database.deserialize(self.data[:_VERSIONS] + _NO_LOG + self.data[_VERSIONS + len(_NO_LOG) :])
            database.execute("PRAGMA trusted_schema = OFF")
            database.set_progress_handler(lambda: next(steps, None) is None, _STEPS)
            if database.execute(_PLAIN).fetchone() != (2,):
                raise sqlite3.DatabaseError("it has no tables messages and topics, as a bag of ROS 2 has")
            for topic, kind, form, log_ns, data in database.execute(_MESSAGES):
                if isinstance(data, bytes) and isinstance(log_ns, int):
                    yield Found(str(topic), str(kind) if form == "cdr" else f"{kind} as {form}", log_ns, log_ns, data)
