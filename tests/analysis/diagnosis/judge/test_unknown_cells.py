"""Cells of an independent simulator with errors that other effects imitate: no fault is confirmed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from analysis import diagnose, read_table
from analysis.diagnosis.judge.result import CERTAIN_ODDS, Diagnosis
from analysis.diagnosis.judge.verdict import within_unexplained
from rigs.schema.effect import name_of
from tests.support.handmade_diagnosis import diagnosis
from tests.support.nightly import cases
from tests.worlds.unknown.causes import CAUSES
from tests.worlds.unknown.cells import Cell, draw_cell
from tests.worlds.unknown.files import write_cell
from tests.worlds.unknown.single import draw_single


def found_in(cell: Cell, directory: Path) -> Diagnosis:
    tables = write_cell(cell, directory)
    runs = [read_table(path, directory / "cell.yaml", test, way or None) for path, test, way in tables]  # type: ignore[arg-type]
    return diagnose(runs)


_CELLS = ((43016, "gauge_baseline"), (43050, "gauge_scale g1"))


@pytest.mark.parametrize(("seed", "name"), cases(_CELLS, _CELLS[1:]))  # the other takes seven times as long
def test_a_few_micrometres_in_a_single_set_up_confirm_no_fault(tmp_path: Path, seed: int, name: str) -> None:
    """A gear error of axis 6 with one wave a turn, 1 to 4 µm under yaw, was a certain fault of the gauges."""
    names = {name_of(named.effect): named for named in found_in(draw_single(seed).cell, tmp_path).effects}
    assert names[name].doubt == "small"


def test_a_play_within_two_of_its_uncertainties_is_no_fault(tmp_path: Path) -> None:
    """A spring that stiffens looks like a play of axis 2 held by gravity, 0.138 ± 0.096°, certain by its shape."""
    found = found_in(draw_cell(42024, CAUSES), tmp_path)
    names = {name_of(named.effect): named for named in found.effects}
    assert names["backlash 2"].posterior >= CERTAIN_ODDS and not names["backlash 2"].stands


def test_an_unexplained_error_lowers_the_odds_of_usual_names_too() -> None:
    (named,) = diagnosis("named").effects[:1]
    usual = replace(named, doubt="usual", posterior=0.97, rivals=(), worth_um=5.0)
    (beside,) = within_unexplained([usual], unexplained_um=20.0, noise_um=2.0)
    assert beside.doubt == "usual" and beside.posterior < 0.6
    assert within_unexplained([usual], unexplained_um=0.0, noise_um=2.0) == [usual]
