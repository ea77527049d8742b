from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from analysis import diagnose, read_table
from analysis.diagnosis.judge.result import Diagnosis
from analysis.diagnosis.plan.further_tests import sigma_between
from rigs.effects import Effect
from rigs.effects.backlash import Backlash
from rigs.schema.effect import name_of
from tests.worlds.unknown.causes import CAUSES
from tests.worlds.unknown.cells import Cell, draw_cell
from tests.worlds.unknown.files import write_cell
from tests.worlds.unknown.single import draw_single


def found_in(cell: Cell, directory: Path) -> Diagnosis:
    tables = write_cell(cell, directory)
    runs = [read_table(path, directory / "cell.yaml", test, way or None) for path, test, way in tables]
    return diagnose(runs)


def test_a_stiffening_gear_is_a_strain_wave_gear_and_no_play(tmp_path):
    """The stiffening was fitted as backlash of axis 2 with odds above 95 %, but with a size of 0.138 ± 0.096°."""
    (named,) = found_in(draw_cell(42024, CAUSES), tmp_path).effects
    assert name_of(named.effect) == "strain_wave 2" and named.doubt == "usual"


def test_a_form_of_the_ball_that_only_cancels_a_usual_twist_is_no_fault(tmp_path):
    """A gear error of axis 6, two waves a turn, under yaw: form of the ball and errors of lengths imitate it together.

    The ball by itself increases the error from 15 to 20 µm, and was a certain fault to mount again.
    """
    found = found_in(draw_single(44006).cell, tmp_path)
    (ball,) = [named for named in found.effects if name_of(named.effect) == "ball_form"]
    assert not ball.is_confirmed and ball.contribution_um > found.accuracy.now_um
    assert found.acts[0].kind == "measure"


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
