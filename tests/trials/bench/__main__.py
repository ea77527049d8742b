"""Benchmarks: rig beside what a user would take instead, CPU time and ratios within one run, each with its goal.

Without a name every row runs, which takes a quarter of an hour, and the table of docs/benchmarks.md is written anew.
"""

from __future__ import annotations

import datetime
import importlib.metadata
import os
import platform
import re
import sys
import textwrap
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from tests.support.benchmarks import Line, page_with, table
from tests.support.trial import Trial, main
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


def draw(given: Namespace) -> Iterator[str]:
    print(machine())
    yield from given.names


def measured(name: str) -> tuple[str, list[Line]]:
    return name, list(ROWS[name]())


def line(result: tuple[str, list[Line]]) -> str:
    return "\n".join(" | ".join(one.cells()) for one in result[1])


def report(done: Sequence[tuple[str, list[Line]]]) -> str:
    """Write the table to the page if every row was measured."""
    if len(done) < len(ROWS):
        return ""
    lines = [one for _, own in done for one in own]
    text = f"{textwrap.fill(machine(), 120)}\n\n{table(lines)}"
    PAGE.write_text(page_with(PAGE.read_text(encoding="utf-8"), text), encoding="utf-8")
    return f"written to {PAGE}"


TRIAL = Trial(
    draw, measured, report, line=line, failed=lambda done: not all(one.reached for _, own in done for one in own),
    options={"NAMES": (tuple(ROWS), f"some of {', '.join(ROWS)} (all)", ROWS)},
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main(TRIAL))
