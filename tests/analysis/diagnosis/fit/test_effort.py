"""A search ends when its rounds gain little and leave the unexplained energy as it is."""

from __future__ import annotations

import pytest

from analysis.diagnosis.fit.effort import Effort

VAIN = {"gain": 10.0, "before": 0.08, "after": 0.079}


def _rounds_until_spent(**changed: float) -> int:
    effort = Effort()
    while not effort.is_spent:
        effort.note(**{**VAIN, **changed})
    return effort.rounds


def test_a_search_ends_after_vain_rounds_beyond_those_of_a_sound_cell() -> None:
    assert _rounds_until_spent() == 10


@pytest.mark.parametrize("changed", [{"gain": 60.0}, {"after": 0.07}, {"before": 0.01, "after": 0.01}])
def test_a_round_that_gains_or_explains_or_has_nothing_to_explain_is_not_vain(changed: dict[str, float]) -> None:
    assert _rounds_until_spent(**changed) == 60


def test_only_successive_vain_rounds_count() -> None:
    effort = Effort()
    for gain in (*[10.0] * 8, 60.0, 10.0, 10.0, 10.0):
        effort.note(gain, 0.08, 0.08)
    assert not effort.is_spent and effort.vain == 3 and effort.rounds == 12
    effort.note(10.0, 0.08, 0.08)
    assert effort.is_spent
