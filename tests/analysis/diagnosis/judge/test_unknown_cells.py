from __future__ import annotations

from collections.abc import Sequence

from analysis.diagnosis.plan.further_tests import sigma_between
from rigs.effects import Effect
from rigs.effects.backlash import Backlash


def test_a_rival_of_size_zero_does_not_stop_the_plan():
    """A play of zero width as a rival was divided by its size."""
    (effect, absent), test = (Backlash(axis=1, width_deg=width) for width in (0.02, 0.0)), _Told()
    assert sigma_between(effect, absent)(test) == 7.0 and test.asked == [effect]


class _Told:
    def __init__(self) -> None:
        self.asked: list[Effect] = []

    @property
    def expected(self) -> _Told:
        return self

    def separation_sigma(self, ones: Sequence[Effect], _: Sequence[Effect]) -> float:
        self.asked += ones
        return 7.0
