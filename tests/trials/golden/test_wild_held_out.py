"""Outliers in real held-out readings (P. Jacobi's UR5) are reported, and the figure is the same as without them."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.support.command_line import ran
from tests.trials.golden.golden import import_ur5

DATA = Path(__file__).parents[4] / "shared" / "data"
pytestmark = [
    pytest.mark.skipif(not (DATA / "jacobi").is_dir(), reason="the measured data of ../shared/data are not here"),
    pytest.mark.nightly,  # a minute of processor time
    pytest.mark.cpu_limit(600),
]


def _held_out(directory: Path, off_mm: dict[int, tuple[float, float, float]]) -> tuple[float, list[str]]:
    """What a calibration leaves in µm at the random poses, of which some are made wild, and the doubts."""
    directory.mkdir()
    off = np.zeros((20, 3))
    for row, mm in off_mm.items():
        off[row] = mm
    assert import_ur5(directory, DATA, off)
    runs = directory / "runs"
    done = ran("diagnose", runs / "used", "--hold-out", runs / "left", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["accuracy"]["place"] == "held_out"
    return found["accuracy"]["calibrated_um"], found["doubts"]


def test_two_wild_readings_of_twenty_do_not_judge(tmp_path):
    """Far ones, and such as only the calibrated model shows: names alone leave more on this arm."""
    clean_um, doubts = _held_out(tmp_path / "clean", {})
    assert clean_um < 130 and not [doubt for doubt in doubts if "outlier" in doubt or "left out" in doubt]
    for name, off_mm in {
        "far": {4: (0.0, 2.0, 0.0), 13: (5.0, 0.0, 0.0)},
        "near": {4: (0.0, 0.8, 0.0), 13: (0.0, 0.0, 0.8)},
    }.items():
        wild_um, doubts = _held_out(tmp_path / name, off_mm)
        assert "1 of 20 poses ignored" in doubts[0] and "1 of 19 poses " in doubts[1]
        assert wild_um == pytest.approx(clean_um, abs=15)
