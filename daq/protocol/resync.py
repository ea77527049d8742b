"""Recognising late answers that carry no number: after a time-out, request something of another length.

An instrument answers in order. So once a probe has its answer, whatever was asked before is answered or lost, and the
next request's answer is its own, however late the instrument is. Until then an answer of a reading's length is late.
Probes in a row ask for different lengths, which come round again after `LENGTHS` of them.

Some instrument may answer nothing but its usual request. Until one probe has been answered, only `TRIES` are made,
and one more for each reading that was answered in time. A request made after that is `doubtful`, since its answer may
belong to an earlier one.
"""

from __future__ import annotations

LENGTHS = 8
TRIES = 3


class Resync:
    """Chooses the length of an instrument's next answer, so that a late answer can be recognised by its length."""

    def __init__(self) -> None:
        self.usual: set[int] = set()
        """The lengths of its readings."""
        self.owed = False
        """Whether a request is unanswered."""
        self.probing = False
        """Whether the request on the line is a probe."""
        self.doubtful = False
        """Whether the request on the line is a reading's while an answer of that length is owed."""
        self._proven = False
        self._probes = 0
        self._tries = TRIES

    @property
    def counts(self) -> list[int]:
        """The lengths of probes, which no reading has."""
        return [count for count in range(1, LENGTHS + len(self.usual) + 1) if count not in self.usual][:LENGTHS]

    def add(self, count: int) -> None:
        """Note the length of one of its readings."""
        self.usual.add(count)

    def ask(self, count: int) -> int:
        """Return the length to request now: that of the reading, or a probe's while an answer is outstanding."""
        self.probing = self.owed and (self._proven or self._tries > 0)
        self.doubtful = self.owed and not self.probing
        self.owed = True
        if not self.probing:
            return count
        self._tries -= 1
        self._probes += 1
        return self.counts[(self._probes - 1) % LENGTHS]

    def answered(self) -> None:
        """Note that the expected answer has come."""
        self.owed = False
        self._proven |= self.probing
        self._tries = max(self._tries, 1)
