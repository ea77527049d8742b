"""A bag of ROS 2 in either of the formats of `ros2 bag record`, and its messages in the order of the file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from analysis.files import mcap_messages, sqlite_bag
from analysis.files.mcap_messages import Found, words_of
from rigs.errors import FileError
from rigs.files import out_of_memory
from rigs.text import as_argument

Bag = mcap_messages.Bag | sqlite_bag.SqliteBag
_LAST_NS = 2**62
"""The year 2116: no bag is of a later one, and all reckoning with times is in 64 bits."""
_SUFFIXES = (".mcap", ".db3")


def is_bag(data: bytes) -> bool:
    """Return whether the bytes of a file are those of a bag."""
    return data.startswith((mcap_messages.MAGIC, sqlite_bag.MAGIC))


def bag_of(data: bytes, where: str) -> Bag:
    """The bag in the bytes of a file."""
    return (sqlite_bag.SqliteBag if data.startswith(sqlite_bag.MAGIC) else mcap_messages.Bag)(data, where)


def file_of(path: Path) -> Path:
    """Return the file of a bag in the directory that `ros2 bag record` made; any other path as it is.

    Raises FileError for a directory with no such file, or several, and for a file whose end is in a log beside it.
    """
    files = sorted(one for one in path.iterdir() if one.suffix in _SUFFIXES) if path.is_dir() else [path]
    if len(files) == 1:
        log = files[0].with_name(f"{files[0].name}-wal")
        if log.exists() and log.stat().st_size:
            remedy = f"write it into the bag: sqlite3 {as_argument(str(files[0]))} 'PRAGMA wal_checkpoint(TRUNCATE)'"
            raise FileError(str(files[0]), f"was not closed: its last messages are in {log.name}", remedy)
        return files[0]
    what = f"is a directory with {len(files) or 'no'} files of a bag ({' or '.join(_SUFFIXES)})"
    remedy = "make one bag of them: ros2 bag convert" if files else "give the file, or the directory of ros2 bag record"
    raise FileError(str(path), what, remedy)


def messages_of(bag: Bag) -> Iterator[Found]:
    """Yield the messages of a bag. Raises FileError where it is cut off or damaged."""
    if not bag.is_whole:
        remedy = "copy the bag again, or mend one whose recorder was killed: mcap recover BAG -o WHOLE"
        raise FileError(bag.where, "is cut off: a bag ends as it begins", remedy)
    try:
        for message in bag.messages():
            if not max(message.log_ns, message.sent_ns) < _LAST_NS:
                raise ValueError("a message has an impossible time")
            yield message
    except FileError:
        raise
    except MemoryError:
        raise out_of_memory(Path(bag.where)) from None
    except Exception as error:  # noqa: BLE001 - of a damaged file, whatever its decompressors raise
        raise FileError(bag.where, f"is damaged: {words_of(error)}", "copy the bag again") from None
