"""What a night has time for: the tests marked `nightly`, more cases of what a test of each commit shows."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, epilog="Other arguments go to pytest.")
    parser.add_argument("--numprocesses", "-n", default="auto", help="how many processes (auto: one for each core)")
    own, others = parser.parse_known_args()
    pytest = [sys.executable, "-m", "pytest", "-m", "nightly", "--dist", "worksteal"]
    # Without it each process would compile and rewrite every module again.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    command = [*pytest, "--numprocesses", own.numprocesses, *others]
    return subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
