"""Cells of an independent simulator with errors that other effects imitate: no fault is confirmed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from analysis import diagnose, read_table
from analysis.diagnosis.judge.imitations import imitation_of, is_no_gear, may_be_friction
from analysis.diagnosis.judge.odds import within_unexplained
from analysis.diagnosis.judge.result import Diagnosis
from analysis.diagnosis.plan.further_tests import sigma_between
from analysis.robot.kinematics.arm import Array
from rigs.effects import Effect
from rigs.effects.backlash import Backlash
from rigs.effects.clock_rate import ClockRate
from rigs.effects.transmission_error import TransmissionError
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


def test_a_stiffening_gear_is_a_strain_wave_gear_and_no_play(tmp_path: Path) -> None:
    """The stiffening was fitted as backlash of axis 2 with odds above 95 %, but with a size of 0.138 ± 0.096°."""
    (named,) = found_in(draw_cell(42024, CAUSES), tmp_path).effects
    assert name_of(named.effect) == "strain_wave 2" and named.doubt == "usual"


def test_an_unexplained_error_lowers_the_odds_of_usual_names_too() -> None:
    (named,) = diagnosis("named").effects[:1]
    usual = replace(named, doubt="usual", probability=0.97, rivals=(), contribution_um=5.0)
    (beside,) = within_unexplained([usual], unexplained_um=20.0, noise_um=2.0)
    assert beside.doubt == "usual" and beside.probability < 0.6
    assert within_unexplained([usual], unexplained_um=0.0, noise_um=2.0) == [usual]


def test_no_name_is_certain_beside_a_similar_unexplained_error() -> None:
    """However certain the shape: an unknown cause of that size may have produced it as well."""
    (named,) = diagnosis("named").effects[:1]
    certain = replace(named, probability=1.0, rivals=(), contribution_um=20.0, directions=1)
    (beside,) = within_unexplained([certain], unexplained_um=20.0, noise_um=20.0)
    assert beside.doubt == "unexplained" and beside.probability <= 0.5


def test_chords_of_a_controller_are_no_certain_vibration(tmp_path: Path) -> None:
    """Chords of 4° at one speed: the wave of 5.1 Hz has the same phase in every run, as a vibration may have."""
    names = {named.effect.KIND_NAME: named for named in found_in(draw_cell(43007, CAUSES), tmp_path).effects}
    assert names["vibration"].doubt == "one_speed" and names["vibration"].probability <= 0.5


def test_a_form_of_the_ball_that_only_cancels_a_usual_twist_is_no_fault(tmp_path: Path) -> None:
    """A gear error of axis 6, two waves a turn, under yaw: form of the ball and errors of lengths imitate it together.

    The ball by itself increases the error from 15 to 20 µm, and was a certain fault to mount again.
    """
    found = found_in(draw_single(44006).cell, tmp_path)
    (ball,) = [named for named in found.effects if name_of(named.effect) == "ball_form"]
    assert ball.doubt == "no_better" and ball.probability <= 0.5 and ball.contribution_um > found.accuracy.now_um
    assert found.acts[0].kind == "measure"


def test_a_rival_of_size_zero_does_not_stop_the_plan() -> None:
    """A play of zero width as a rival was divided by its size."""
    (effect, absent), test = (Backlash(axis=1, width_deg=width) for width in (0.02, 0.0)), _Told()
    assert sigma_between(effect, absent)(test) == 7.0 and test.asked == [effect]  # type: ignore[arg-type]


class _Told:
    """A test that separates every present effect by 7 sigma, and keeps which effects were asked."""

    def __init__(self) -> None:
        self.asked: list[Effect] = []

    @property
    def expected(self) -> _Told:
        return self

    def separation_sigma(self, ones: Sequence[Effect], _: Sequence[Effect]) -> float:
        self.asked += ones
        return 7.0


TURN = np.linspace(0.0, 6.3, 50)


@pytest.mark.parametrize(
    ("turn", "elsewhere", "may_be"),
    [(TURN, 0.0, True), (np.cos(TURN), 0.0, False), (TURN, 1.0, False)],
    ids=["one way", "reverses", "other readings show it"],
)
def test_friction_of_the_ball_joint_confirms_no_play(turn: Array, elsewhere: float, may_be: bool) -> None:
    """Stick-slip of 30 µm in the ball joint was a certain play of axis 6, which only the yaw circles show."""
    q = np.zeros((50, 6))
    q[:, 5] = turn
    drives = SimpleNamespace(q=q)
    blocks = [SimpleNamespace(drives=drives, sampling=True), SimpleNamespace(drives=drives, sampling=None)]
    linear = SimpleNamespace(blocks=blocks, rows=[slice(0, 4), slice(4, 8)])
    contribution = np.array([1.0] * 4 + [elsewhere] * 4)
    result = SimpleNamespace(effects=[Backlash(axis=6, width_deg=0.08)], contributions=[contribution], linear=linear)
    assert may_be_friction(result, 0) is may_be  # type: ignore[arg-type]


@pytest.mark.parametrize(("order", "u", "is_none"), [(5.27, 0.08, True), (5.1, 0.08, False), (30.27, 0.08, False)])
def test_a_piece_of_a_wave_that_is_not_whole_is_no_gear(order: float, u: float, is_none: bool) -> None:
    """A tilting axis 1 was a certain gear error of axis 5, which turned over 81 degrees; many waves are recognised."""
    q = np.zeros((50, 6))
    q[:, 4] = np.linspace(0.0, np.radians(81), 50)
    linear = SimpleNamespace(blocks=[SimpleNamespace(turns=np.ptp(q, axis=0) / (2 * np.pi))])
    effect = TransmissionError(axis=5, order=order, amplitude_deg=0.1)
    fit = SimpleNamespace(sd=lambda _: {"order": u})
    result = SimpleNamespace(effects=[effect], linear=linear, fit=fit)
    assert is_no_gear(result, 0) is is_none  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("effect", "directions", "doubt"),
    [
        (ClockRate(ppm=2400.0), 1, "at_limit"),
        (ClockRate(ppm=2000.0), 1, None),
        (ClockRate(ppm=2400.0), 2, None),
        (Backlash(axis=1, width_deg=2.0), 2, None),
    ],
    ids=["at the limit", "within the limit", "two directions", "a fault of the arm"],
)
def test_an_error_of_an_instrument_at_the_limit_of_the_fit_is_doubted(
    effect: Effect, directions: int, doubt: str | None
) -> None:
    """For a coupling from axis 6 to axis 4, the rate of the clock was a certain fault, 120 times its usual size."""
    linear = SimpleNamespace(blocks=[], rows=[])
    result = SimpleNamespace(effects=[effect], contributions=[np.ones(3)], linear=linear)
    assert imitation_of(result, 0, directions) == doubt  # type: ignore[arg-type]
