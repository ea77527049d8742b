"""Which plays a corrected program makes up for: those that are certain, whether a file names them or not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.correction.plays import known_plays
from analysis.reporting.extended_rig import write_extended
from rigs.calibration import CalibratedModel, Parameter, Term, packed_factor
from rigs.effects import Backlash
from rigs.load import load
from tests.support.handmade_calibration import calibrated_model

PLAY = Backlash(axis=1, width_deg=0.02)


@pytest.mark.parametrize(("u_deg", "certain"), [(0.005, True), (0.015, False), (0.05, False)])
def test_a_play_of_usual_size_is_corrected_where_it_is_twice_its_uncertainty(
    u_deg: float, *, certain: bool, tmp_path: Path
) -> None:
    """Both are degrees: a play of two healthy sizes with five of u is as good as none."""
    changed = {
        "terms": [Term(effect=PLAY, times=1.0)],
        "parameters": [Parameter(term=0, field="width_deg")],
        "factor": packed_factor(np.array([[u_deg]])),
    }
    model = CalibratedModel.model_validate(calibrated_model().model_dump() | changed)
    write_extended(load("paper-fanuc")[1], (), tmp_path / "cell.yaml", model)
    assert known_plays(load(tmp_path / "cell.yaml")[0]) == ((PLAY,) if certain else ())
