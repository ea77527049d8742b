"""Recognising late answers that carry no number: after a time-out, request something of another length.

An instrument answers in order. So once a probe has its answer, whatever was asked before is answered or lost, and the
next request's answer is its own, however late the instrument is. Until then an answer of a reading's length is late.
Probes in a row ask for different lengths, which come round again after `LENGTHS` of them.

Some instrument may answer nothing but its usual request. Until one probe has been answered, only `TRIES` are made,
and one more for each reading that was answered in time. A request made after that is `doubtful`, since its answer may
belong to an earlier one.
"""

from __future__ import annotations

from itertools import cycle

LENGTHS = 8
TRIES = 3


class Resync:
    """Chooses the length of the next answer, so that a late answer can be recognised by its length."""

    def __init__(self, count: int) -> None:
        self.counts = [other for other in range(1, LENGTHS + 2) if other != count][:LENGTHS]
        self.asked = self._count = count
        self._cycle = cycle(self.counts)
        self._owed = self._proven = False
        self.doubtful = False
        """Whether the request on the line is a reading's while an answer of that length is owed."""
        self._tries = TRIES

    @property
    def probing(self) -> bool:
        """Whether the request on the line is a probe."""
        return self.asked != self._count

    def ask(self) -> int:
        """Return the length to request now: a reading's, or a probe's while an answer is outstanding."""
        probing = self._owed and (self._proven or self._tries > 0)
        self._tries -= probing
        self.doubtful = self._owed and not probing
        self.asked = next(self._cycle) if probing else self._count
        self._owed = True
        return self.asked

    def answered(self) -> None:
        """Note that the expected answer has come."""
        self._owed = False
        self._proven |= self.probing
        self._tries = max(self._tries, 1)
