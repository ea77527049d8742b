"""Every effect of the vocabulary, from the rig file to the correction; tests/test_how_to_analysis.py adds one."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from rigs.effects import VOCABULARY
from tests.support.effect_contract import STEPS, calibrated, corrected, declared, diagnosed, in_a_rig_file

LONG = (calibrated, diagnosed)
OF_A_RAIL, ON_PAPER = ("rail_line",), (in_a_rig_file, declared, corrected)
"""What circles do not show, since the arm stands, and the steps without circles; tests/analysis/inference/test_rail.py
has the others."""
IN_EACH_COMMIT = ("backlash", "transmission_error", "link_geometry", "vibration")
"""The effects that go through the long steps in each commit: a play, which is not proportional to its size, a wave, a
constant of the arm, and what is looked for in the time of each run. The others do in `scripts/dev nightly`."""


@pytest.mark.parametrize(
    ("step", "name"),
    [
        pytest.param(step, name, marks=pytest.mark.nightly if step in LONG and name not in IN_EACH_COMMIT else ())
        for step in STEPS
        for name in VOCABULARY
        if step in ON_PAPER or name not in OF_A_RAIL
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_every_effect_keeps_the_contract(step: Callable[[str], None], name: str) -> None:
    step(name)


def test_what_is_shown_in_each_commit_is_there() -> None:
    assert set(IN_EACH_COMMIT) <= set(VOCABULARY)
