"""Limit of the effort of a search."""

from __future__ import annotations

from dataclasses import dataclass

_MOST_ROUNDS = 60
"""Largest number of rounds of all selections of a search. Chosen: cells with up to three faults took 10 to 30, and a
cell with an unknown cause did not converge. After the limit, the residual widens the uncertainties by the
strength of the band.
"""
_USUAL_ROUNDS, _MOST_VAIN = 10, 4
"""Number of rounds from which vain rounds count, and largest number of successive ones. Chosen: sound cells and poses
of a UR10 end after 1 to 9 rounds, of which up to five are vain. A healthy cell with an unknown cause named 24 effects
in 60 rounds, most of which left the unexplained energy as it was.
"""
_LITTLE = 50.0
"""Log evidence below which a gain is little: that from which an unknown cause competes with names."""
_UNEXPLAINED, _REDUCED = 0.02, 0.02
"""Energy beyond the noise, as a share of that of the noise, from which a part is unexplained, and the share of it that
a round must remove. Chosen: both change a standard uncertainty by 1 %."""


@dataclass
class Effort:
    """Number of rounds of a search. It is limited, because an error that no effect reduces would never end the search.

    vain: number of the latest rounds that gained little and hardly reduced the unexplained energy. They fit effects of
    usual size to an error of a different form.
    """

    rounds: int = 0
    vain: int = 0

    def note(self, gain: float, before: float, after: float) -> None:
        """Note a round: the log evidence gained, and the energies beyond the noise before and after the round, as
        shares of that of the noise.
        """
        self.rounds += 1
        is_vain = before > _UNEXPLAINED and gain < _LITTLE and after > (1 - _REDUCED) * before
        self.vain = self.vain + 1 if is_vain else 0

    @property
    def is_spent(self) -> bool:
        """Whether no further round is allowed."""
        is_vain = self.rounds >= _USUAL_ROUNDS and self.vain >= _MOST_VAIN
        return is_vain or self.rounds >= _MOST_ROUNDS
