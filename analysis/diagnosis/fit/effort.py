"""Bound of the effort of a search."""

from __future__ import annotations

from dataclasses import dataclass

_MOST_ROUNDS = 60
"""Largest number of rounds of all selections of a search. Chosen: cells with up to three faults took 10 to 30, and one
with an unknown cause did not end; what remains then widens the uncertainties by the strength of its band."""


@dataclass
class Effort:
    """The rounds that a search has taken, which are bounded: an error that no name reduces would go on."""

    rounds: int = 0

    @property
    def is_spent(self) -> bool:
        """Whether no further round is taken."""
        return self.rounds >= _MOST_ROUNDS
