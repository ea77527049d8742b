"""Every effect of the vocabulary, from the rig file to the correction; tests/test_how_to_analysis.py adds one."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from rigs.effects import VOCABULARY
from tests.support.effect_contract import STEPS, calibrated, diagnosed

LONG = (calibrated, diagnosed)
IN_EACH_COMMIT = ("backlash", "transmission_error", "link_geometry", "vibration")
"""The effects that go through the long steps in each commit: a play, which is not proportional to its size, a wave, a
constant of the arm, and what is looked for in the time of each run. The others do in `scripts/dev nightly`."""


@pytest.mark.parametrize(
    ("step", "name"),
    [
        pytest.param(step, name, marks=pytest.mark.nightly if step in LONG and name not in IN_EACH_COMMIT else ())
        for step in STEPS
        for name in VOCABULARY
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_every_effect_keeps_the_contract(step: Callable[[str], None], name: str) -> None:
    step(name)


def test_what_is_shown_in_each_commit_is_there() -> None:
    assert set(IN_EACH_COMMIT) <= set(VOCABULARY)
