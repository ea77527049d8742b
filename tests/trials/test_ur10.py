"""Real tracker data (Fraunhofer IPA, UR10) through import, pose evaluation and calibration; not part of the project."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data" / "ipa-ur10"
BIN = Path(sys.executable).parent
pytestmark = [
    pytest.mark.skipif(not DATA.is_dir(), reason="the measured data of ../shared/data are not here"),
    pytest.mark.nightly,  # two minutes of processor time
    pytest.mark.timeout(1800),
    pytest.mark.cpu_limit(600),
]


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    out = tmp_path_factory.mktemp("ur10")
    done = subprocess.run(
        [sys.executable, ROOT / "tests" / "trials" / "ur10.py", DATA, out],
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return out


def test_the_commands_take_the_table(tables):
    def rig(*words: str) -> str:
        done = subprocess.run(
            [BIN / "rig", *words], cwd=tables, capture_output=True, text=True, check=False, env=dict(os.environ)
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    rig("import", "ur10-d.csv", "--rig", "ur10-cell", "--test", "pose", "-o", "d")
    (run,) = json.loads(rig("analyse", "d", "--json"))["runs"]
    assert run["figures"]["rms_mm"]["value"] == pytest.approx(0.772, abs=0.01)
    found = json.loads(rig("calibrate", "d", "--fit", "joint_offset,link_geometry", "--json", "-o", "ur10-d.yaml"))
    left = found["gap"]["held_out"]
    assert left["before"] == pytest.approx(821, abs=5) and left["calibrated"] < 250 and left["set_up"] == "kept"
    assert "good" in rig("check", "ur10-d.yaml")
