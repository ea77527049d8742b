"""The count at both ends at a quick pace, for a second here; `scripts/pace` does more of it, and measures."""

import os
import subprocess
import sys
from pathlib import Path

from tests.support.bench import BIN

SCRIPT = Path(__file__).parents[3] / "tests" / "trials" / "pace" / "__main__.py"


def test_no_sample_is_missing_at_a_quick_pace():
    env = {**os.environ, "PATH": f"{BIN}:{os.environ['PATH']}"}
    command = [sys.executable, SCRIPT, "1", "--turns", "1", "--rate", "4000"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=env)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "no sample missing"
