"""Benchmarks: rig beside what a user would take instead, CPU time and ratios within one run, each with its goal.

Without a name every row runs, which takes a quarter of an hour, and the table of docs/benchmarks.md is written anew.
"""

from __future__ import annotations

import argparse
import datetime
import importlib.metadata
import os
import platform
import re
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.support.benchmarks import Line, page_with, table
from tests.trials.bench.commands import analyse_lines, circle_lines, diagnose_lines, many_lines, small_lines
from tests.trials.bench.kinematics import calibrated_lines, forward_lines, inverse_lines, path_lines

PAGE = Path(__file__).parents[3] / "docs" / "benchmarks.md"
ROWS: dict[str, Callable[[], Iterator[Line]]] = {
    "forward": forward_lines,
    "inverse": inverse_lines,
    "calibrated": calibrated_lines,
    "path": path_lines,
    "circle": circle_lines,
    "analyse": analyse_lines,
    "many": many_lines,
    "small": small_lines,
    "diagnose": diagnose_lines,
}
PACKAGES = ("numpy", "scipy", "pandas", "py-opw-kinematics", "eaik", "roboticstoolbox-python", "pin")


def machine() -> str:
    """The processor, its cores, the versions and the date."""
    model = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text(encoding="utf-8"))
    versions = ", ".join(f"{name} {_version(name)}" for name in PACKAGES)
    return (
        f"{model[1] if model else platform.machine()}, {os.cpu_count()} cores; Python {platform.python_version()}, "
        f"{versions}; {datetime.date.today().isoformat()}"
    )


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not there"


def main() -> int:
    """Prints the table, line by line as it comes; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(prog="scripts/bench", description=__doc__)
    parser.add_argument("names", metavar="NAME", nargs="*", help=f"some of {', '.join(ROWS)} (all)")
    names = parser.parse_args().names
    if unknown := [name for name in names if name not in ROWS]:
        parser.error(f"there is no row {unknown[0]!r}; the rows are {', '.join(ROWS)}")
    lines = []
    print(machine())
    for name in names or ROWS:
        for line in ROWS[name]():
            lines.append(line)
            print(" | ".join(line.cells()), flush=True)
    if not names:
        measured = f"{textwrap.fill(machine(), 120)}\n\n{table(lines)}"
        PAGE.write_text(page_with(PAGE.read_text(encoding="utf-8"), measured), encoding="utf-8")
        print(f"written to {PAGE}")
    return 0 if all(line.reached for line in lines) else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit("stopped, the page is as it was")
