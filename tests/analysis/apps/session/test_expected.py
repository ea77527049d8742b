"""Expected result of a correction in a session: with u where the runs of the model state it, otherwise none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.apps.session.correction_step import expected_left
from analysis.apps.session.session_state import SessionCorrection
from analysis.apps.session.session_words import correction_lines
from analysis.correction.deviation import Deviation, Side, Work
from analysis.correction.pose_uncertainty import pose_uncertainty
from analysis.runs.tables import PoseTable
from rigs.load import load
from tests.support.handmade_calibration import calibrated_model
from tests.worlds.arms.seven_axes import run_of


@pytest.mark.parametrize(("most_deg", "is_known"), [(29.0, True), (40.0, False)])
def test_u_stands_where_the_runs_of_the_model_were_and_nowhere_else(most_deg: float, is_known: bool) -> None:
    rig = load("paper-fanuc")[0].with_calibration(None, calibrated_model())
    q = np.radians(np.random.default_rng(1).uniform(-20, 20, (40, 6)))
    q[-1, 3] = math.radians(most_deg)
    run = run_of(rig, PoseTable(q, np.zeros((40, 3)), None))
    expected = expected_left(rig, pose_uncertainty(rig, ()), [run], 12.34)
    assert expected.um == 12.3
    assert (expected.u_um is not None and 0 < expected.u_um < math.inf) == is_known
    before = Deviation(um=50, largest_um=90, u_um=1, runs=2)
    correction = SessionCorrection(way="programs", sentence="Load them.", before_um=50, expected_um=12.3)
    line = list(correction_lines(correction, [Side("elsewhere", before, before, expected)]))[1]
    assert ("uncertainty unknown" in line) != is_known


@pytest.mark.parametrize(("unknown", "said"), [(0.0, ""), (0.82, "82 % of the work"), (1.0, "The work area was not")])
def test_the_error_over_the_work_says_where_no_run_shows_it(unknown: float, said: str) -> None:
    side = Deviation(um=50, largest_um=90, u_um=1, runs=2)
    work = Work(before_um=312, after_um=133, u_um=46, unknown=unknown)
    correction = SessionCorrection(way="programs", sentence="Load them.", before_um=50, expected_um=2, work=work)
    line = list(correction_lines(correction, [Side("same", side, side, None)]))[-1]
    assert "312 µm rms before, 133 expected after" in line
    assert said in line and ("the error there is unknown" in line) == bool(said)
