"""Limit of the effort of a search."""

from __future__ import annotations

from dataclasses import dataclass

_MOST_ROUNDS = 60
"""Largest number of rounds of all selections of a search. Chosen: cells with up to three faults took 10 to 30, and a
cell with an unknown cause did not converge. After the limit, the residual widens the uncertainties by the
strength of the band.
"""


@dataclass
class Effort:
    """Number of rounds of a search. It is limited, because an error that no named effect reduces would never end the
    search.
    """

    rounds: int = 0

    @property
    def is_spent(self) -> bool:
        """Whether no further round is allowed."""
        return self.rounds >= _MOST_ROUNDS
