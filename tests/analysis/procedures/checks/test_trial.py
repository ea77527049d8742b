"""Sound cells are let through, and cells with a broken convention are told (docs/evidence/conventions.md)."""

import pytest

from analysis.procedures.checks.check_runs import findings_of
from tests.support.conventions import cells


@pytest.mark.parametrize("name", cells())
def test_a_sound_cell_is_let_through_and_a_broken_convention_told(name):
    cell = cells()[name]
    found = findings_of(cell.runs)
    assert any(map(cell.is_named, found)) if cell.convention else found == []
