from collections.abc import Callable

import pytest

from rigs.effects import VOCABULARY
from tests.support.effect_contract import STEPS, calibrated, corrected, declared, diagnosed, in_a_rig_file

OF_A_RAIL, ON_PAPER = ("rail_line",), (in_a_rig_file, declared, corrected)
"""What circles do not show, since the arm stands, and the steps without circles; tests/analysis/diagnosis/test_rail.py
has the others."""
IN_EACH_COMMIT: dict[Callable[[str], None], tuple[str, ...]] = {
    calibrated: ("backlash", "transmission_error", "link_geometry", "vibration"),
    diagnosed: ("link_geometry",),
}
"""The effects that go through the long steps in each commit: a play, which is not proportional to its size, a wave, a
constant of the arm, and what is looked for in the time of each run. A play with a wave, and a vibration, are diagnosed
by tests/analysis/diagnosis/judge/test_verdicts.py. The others do in `scripts/dev nightly`."""


@pytest.mark.parametrize(
    ("step", "name"),
    [
        pytest.param(step, name, marks=pytest.mark.nightly if name not in IN_EACH_COMMIT.get(step, (name,)) else ())
        for step in STEPS
        for name in VOCABULARY
        if step in ON_PAPER or name not in OF_A_RAIL
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_every_effect_keeps_the_contract(step, name):
    step(name)


def test_cases_of_each_commit_exist():
    assert {name for names in IN_EACH_COMMIT.values() for name in names} <= set(VOCABULARY)
