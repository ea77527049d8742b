"""Real tracker data (Fraunhofer IPA, UR10) through import, pose evaluation and calibration; not part of the project."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from tests.support.made_once import made_once

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data" / "ipa-ur10"
BIN = Path(sys.executable).parent
pytestmark = [
    pytest.mark.skipif(not DATA.is_dir(), reason="the measured data of ../shared/data are not here"),
    pytest.mark.nightly,  # two minutes of processor time
    pytest.mark.timeout(1800),
    pytest.mark.cpu_limit(600),
]


@made_once
def _judged(data_sha256: str) -> tuple[str, bytes]:
    """What the program prints of these data, and the table of series D that it writes."""
    with TemporaryDirectory() as out:
        done = subprocess.run(
            [sys.executable, ROOT / "dev" / "ur10.py", DATA, out], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout, (Path(out) / "ur10-d.csv").read_bytes()


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    out = tmp_path_factory.mktemp("ur10")
    files = sorted(DATA.glob("*.csv"))
    printed, table = _judged(hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest())
    (out / "ur10-d.csv").write_bytes(table)
    return printed, out


def _rms(text: str, series: str, what: str) -> tuple[float, float]:
    part = text.split(f"series {series}:")[1].split("series ", maxsplit=1)[0]
    (line,) = [line for line in part.splitlines() if line.strip().startswith(what)]
    nominal, fitted = re.findall(r"([\d.]+) mm", line)
    return float(nominal), float(fitted)


def test_24_dh_parameters_reach_what_an_ordinary_calibration_does(told: tuple[str, Path]) -> None:
    nominal, fitted = _rms(told[0], "B", "pose, 30 % left out at random")
    assert nominal == pytest.approx(1.087, abs=0.03) and fitted == pytest.approx(0.421, abs=0.02)
    nominal, fitted = _rms(told[0], "D", "pose, 30 % left out at random")
    assert nominal == pytest.approx(0.778, abs=0.01) and fitted == pytest.approx(0.399, abs=0.02)


@pytest.mark.parametrize("test", ["radial", "yaw", "roll"])
def test_a_ball_placed_before_the_poses_gives_readings_that_calibrate(told: tuple[str, Path], test: str) -> None:
    nominal, fitted = _rms(told[0], "B", f"{test} with a ball placed")
    assert fitted < 0.6 * nominal


def test_the_commands_take_the_table(told: tuple[str, Path]) -> None:
    out = told[1]

    def rig(*words: str) -> str:
        done = subprocess.run(
            [BIN / "rig", *words], cwd=out, capture_output=True, text=True, check=False, env=dict(os.environ)
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    rig("import", "ur10-d.csv", "--rig", "ur10", "--test", "pose", "-o", "d")
    (run,) = json.loads(rig("analyse", "d", "--json"))["runs"]
    assert run["figures"]["rms_mm"]["value"] == pytest.approx(0.772, abs=0.01)
    found = json.loads(rig("calibrate", "d", "--fit", "joint_offset,link_geometry", "--json", "-o", "ur10-d.yaml"))
    left = found["gap"]["held_out"]
    assert left["before"] == pytest.approx(821, abs=5) and left["calibrated"] < 250 and left["set_up"] == "kept"
    assert "good" in rig("check", "ur10-d.yaml")
