"""The count at both ends, for some seconds here; `scripts/dev pace` does it for a minute."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.bench import BIN

pytestmark = pytest.mark.alone  # every sample counts at full pace

SCRIPT = Path(__file__).parents[2] / "dev" / "pace.py"


def test_no_sample_is_missing_at_full_pace() -> None:
    env = {**os.environ, "PATH": f"{BIN}:{os.environ['PATH']}"}
    done = subprocess.run([sys.executable, SCRIPT, "5"], capture_output=True, text=True, check=False, env=env)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "no sample missing"
