from __future__ import annotations

import numpy as np
import pytest
import yaml

from analysis.apps.correct.correct_rig import correct_rig
from analysis.apps.correct.correction_report import write
from analysis.apps.programs.compensated import ahead_of_plays, targets_of
from analysis.apps.programs.planned import plans_of
from analysis.correction.support import known_plays
from rigs.calibration import TIMES, CovarianceParameter, Term, packed_factor
from rigs.effects import Backlash, Effect, JointOffset, size_field
from rigs.load import load
from rigs.rig import Rig
from tests.support.handmade_calibration import NAMED, calibrated_model

U_DEG = 0.001
USUAL = Backlash(axis=5, width_deg=0.004)
"""Certain, 4 u, and no wider than the gears of a sound arm are."""
UNSURE = Backlash(axis=2, width_deg=0.0015)
SMALL = Backlash(axis=4, width_deg=0.01)
"""One of the many small terms, of which a calibration knows how many times of it the arm shows, and no width."""


def calibrated(*plays: Effect) -> Rig:
    """A rig file that names `NAMED`, and beside it a calibration of other plays with widths and of a small one."""
    terms = (
        Term(effect=NAMED, times=1.0, named=True),
        *(Term(effect=play, times=1.0) for play in plays),
        Term(effect=SMALL, times=1.0),
    )
    fields = [*(size_field(term.effect) for term in terms[:-1]), TIMES]
    parameters = tuple(CovarianceParameter(term=k, field=name) for k, name in enumerate(fields))
    model = calibrated_model(terms=terms, parameters=parameters, factor=packed_factor(U_DEG * np.eye(len(parameters))))
    rig, _ = load("paper-fanuc")
    return rig.model_copy(update={"effects": (NAMED,)}).with_calibration(None, model)


def test_certain_usual_play_is_taken_from_the_calibration():
    assert known_plays(calibrated(USUAL, UNSURE)) == (NAMED, USUAL)  # the named play once, though both files have it


def test_its_joint_is_commanded_further_by_half_its_width():
    rig = calibrated(USUAL)
    plan = plans_of(rig, "yaw", 1.0)[0]
    assert len(ahead_of_plays(rig, plan)) == len(targets_of(plan))
    ahead_deg = np.degrees(ahead_of_plays(rig, plan))
    assert np.abs(ahead_deg[:, 4]).max() == pytest.approx(USUAL.width_deg / 2, rel=1e-6)
    assert not ahead_deg[:, [1, 3]].any()  # the joints of which no play is known stay
    assert not ahead_of_plays(calibrated(), plan)[:, 4].any()


def test_effects_of_the_calibration_are_corrected(tmp_path):
    """The diagnosis says to re-master this axis: the file has its zero, and a play that stays with its u."""
    found = correct_rig(calibrated(JointOffset(axis=3, offset_deg=0.05), USUAL), None)
    (file,) = write(found, tmp_path / "out")
    head, text = (part for part in file.read_text(encoding="utf-8").split("rig: ", 1))
    written = yaml.safe_load(f"rig: {text}")
    assert written["joint_zeros"] == [{"axis": 3, "add_deg": 0.05, "u_deg": pytest.approx(U_DEG, rel=1e-4)}]
    (play,) = [effect for effect in written["effects"] if effect["name"] == "backlash 5"]
    assert play["corrected_as"] is None and play["u"] == pytest.approx(U_DEG, rel=1e-4)
    assert "# joint_zeros: " in head and "dh.csv" not in head
