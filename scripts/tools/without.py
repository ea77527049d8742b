"""Remove a room from a copy of the project and test what remains: nothing leans on a room but its own tests and pages.

scripts/dev without                 lists the rooms
scripts/dev without pair            removes one and runs the checks and tests of the rest; --quick only the checks
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOMS = {
    "certify": ("docs/certify.md", "tests/trials/certify.py", "tests/trials/few_readings.py"),
    "pair": ("docs/two-arms.md", "tests/support/two_arm_cases.py"),
    "paper": ("docs/paper.md",),
    "window": ("docs/window.md", "tests/support/windows.py"),
}
"""What belongs to a room beside its folders `analysis/apps/ROOM` and `tests/analysis/apps/ROOM`."""
OF_ALL_COMMANDS = ("tests/test_docs.py", "tests/test_website.py", "tests/trials", "tests/golden")
"""Tests of pages that link to every page, and of answers of every command."""


def copy_without(room: str, copy: Path) -> None:
    """Copy the tracked files except those of the room."""
    gone = (f"analysis/apps/{room}/", f"tests/analysis/apps/{room}/", *ROOMS[room])
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout.decode()
    for name in filter(None, listed.split("\0")):
        if not name.startswith(gone):
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, copy / name, follow_symlinks=False)


def checks(quick: bool) -> list[list[str]]:
    """Commands that have to end well in the copy."""
    named = [sys.executable, "-c", "from analysis.cli.commands import app; app(['--help'])"]
    tests = [sys.executable, "-m", "pytest", "-q", "-n", "2", *(f"--ignore={name}" for name in OF_ALL_COMMANDS)]
    return [named, [sys.executable, "-m", "mypy"], *([] if quick else [tests])]


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help=", ".join(sorted(ROOMS)))
    parser.add_argument("--quick", action="store_true", help="types and commands only, without the tests")
    given = parser.parse_args()
    if unknown := set(given.rooms) - set(ROOMS):
        parser.error(f"{', '.join(sorted(unknown))}: not a room; the rooms are {', '.join(sorted(ROOMS))}")
    if not given.rooms:
        print("\n".join(sorted(ROOMS)))
    failures = [failure for room in given.rooms if (failure := failure_without(room, quick=given.quick))]
    for failure in failures:
        print(failure, file=sys.stderr)
    return 1 if failures else 0


def failure_without(room: str, *, quick: bool) -> str:
    """Message with the first check that fails in a copy without the room; empty if all pass."""
    with tempfile.TemporaryDirectory() as folder:
        copy_without(room, Path(folder))
        for command in checks(quick):
            # The copy comes before the installed project on the path of Python.
            done = subprocess.run(command, cwd=folder, env={"PYTHONPATH": folder, "PATH": "/usr/bin:/bin"}, check=False)
            if done.returncode:
                return f"without {room}: failed: {' '.join(command[1:4])}"
    print(f"without {room}: all checks pass", flush=True)
    return ""


if __name__ == "__main__":
    sys.exit(main())
