"""The diagnosis of a real arm (Fraunhofer IPA, UR10): what it names holds on groups of poses that it has not seen."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data" / "ipa-ur10"
pytestmark = [
    pytest.mark.skipif(not DATA.is_dir(), reason="the measured data of ../shared/data are not here"),
    pytest.mark.nightly,  # 50 s of processor time
    pytest.mark.timeout(1800),
    pytest.mark.cpu_limit(600),
]


@pytest.fixture(scope="module")
def told() -> str:
    done = subprocess.run(
        [
            sys.executable,
            ROOT / "tests" / "trials" / "ur10_diagnosed.py",
            DATA,
            "--series",
            "d",
            "--only",
            "1",
        ],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_names_beat_24_dh_parameters_on_poses_left_out(told):
    found = re.search(r"fold 1,.*nominal ([\d.]+), 24 DH parameters ([\d.]+), diagnosed ([\d.]+) mm", told)
    assert found, told
    nominal, dh, diagnosed = map(float, found.groups())
    assert nominal == pytest.approx(0.821, abs=0.01)
    assert diagnosed < 0.9 * dh < 0.9 * 0.6 * nominal


def test_ur10_has_light_arm_effects_and_no_backlash(told):
    """The level is 1.00 relative to light arms, and above 1 relative to heavier arms with stiffer joints."""
    assert "backlash" not in told
    level = re.search(r"level ([\d.]+)", told)
    assert level and 0.7 < float(level.group(1)) < 1.5
