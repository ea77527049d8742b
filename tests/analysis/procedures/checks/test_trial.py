"""Sound cells are let through, and cells with a broken convention are told (docs/evidence/conventions.md)."""

import numpy as np
import pytest

from analysis.procedures.checks.check_runs import findings_of
from tests.support.conventions import BREAKS, is_right, sound

TOLD = {
    "J2 missing in J3": (0, 1, 2),
    "an axis reversed": (0, 1, 2),
    "two joint columns exchanged": (0, 1, 2),
    "a zero 90° or 180° off": (0, 1, 3),
    "both gauges negated, with a play": (0, 2, 4),
    "one gauge negated": (0, 1, 2),
    "gauges exchanged": (0, 1, 2),
    "another unit": (0, 1, 3),
    "a place lost or sent again": (0, 1),
    "three readings a stand": (0, 1),
}
"""Cells of the trial with a detectable fault, by kind. docs/conventions.md gives the reasons for the others."""


@pytest.mark.parametrize("number", range(9))
def test_a_sound_cell_is_let_through(number):
    assert findings_of(sound(number)) == []


@pytest.mark.parametrize("name", BREAKS)
def test_broken_convention_is_detected(name):
    kind = list(BREAKS).index(name)
    for number in TOLD[name]:
        broken = BREAKS[name](np.random.default_rng([0, kind, number, 2]), number)
        found = findings_of(broken.runs)
        assert any(is_right(finding, broken) for finding in found), (number, broken.meant, found)
