"""Whether the columns of a stream can have been recorded: stamps of one computer's clock in order, values in bounds.

`rigd` stamps what it reads by a clock that never goes back. What breaks this rule was changed since, whatever the
checksums say, and no time can be made of it. A value that cannot be a reading is left out instead, and counted.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from analysis.kinematics.arm import Array
from analysis.traces.lower_hull import Mask
from rigs.errors import FileError

LONGEST_MM = 1e5
"""No gauge measures further than 100 m, the bound of lengths in a rig file (`rigs.schema.part.Length`)."""
LARGEST_DEG = 36e3
"""No joint of a robot makes more than 100 turns."""
_LATEST_NS = 2**61
"""A monotonic clock begins with its computer: 73 years."""
_LONGEST_MESSAGE = 65_536
"""Bytes; the longest message of any protocol is a UDP datagram."""


def require_sound(path: Path, instrument: str, columns: Mapping[str, np.ndarray[Any, Any]]) -> None:
    """Raises FileError for columns (n,), stamps in ns and sizes in bytes, that `rigd` cannot have written."""
    requested, first, last = (columns[name] for name in ("requested_ns", "first_byte_ns", "last_byte_ns"))
    rules = {
        "an impossible stamp": (first < 0) | (last > _LATEST_NS),
        "a first byte later than the last": first > last,
        "a request later than its answer": requested > last,
        "a stamp earlier than that of the row before": np.append(False, last[1:] < last[:-1]),
        "an impossible message size": (columns["size"] < 0) | (columns["size"] > _LONGEST_MESSAGE),
    }
    for words, broken in rules.items():
        if broken.any():
            row = int(broken.argmax()) + 1
            raise FileError(str(path), f"row {row} of {instrument} has {words}", "restore the run from a copy")


def is_reading(values: Array, largest: float) -> Mask:
    """Which rows of values (n, k) hold nothing but numbers up to the largest that can be."""
    sound = np.ones(len(values), dtype=bool)
    for column in values.T:  # column by column, in no more memory than the answer takes
        sound &= column <= largest
        sound &= column >= -largest
    return sound
