"""Print the processor time of tests, files and fixtures in the latest test runs, longest first."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

from tests.support.durations import KEPT, Durations, durations


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--most", type=int, default=40, help="lines of each list (40)")
    parser.add_argument("--nightly", action="store_true", help="the tests of a night alone")
    parser.add_argument("--under", default="", metavar="PATH", help="tests of this folder or file alone")
    parser.add_argument("--kept", type=Path, default=KEPT, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    found = chosen(durations(asked.kept), asked.under, asked.nightly)
    if not found.tests:
        print("no test has run here yet: scripts/test, then this again", file=sys.stderr)
        return 1
    whole = sum(found.tests.values())
    print(f"{len(found.tests)} tests: {whole / 60:.1f} minutes of processor time")
    section("by test", found.tests.items(), asked.most, whole)
    section("by file", found.by_file().items(), asked.most, whole)
    made = found.by_fixture()
    section(
        "by fixture, with how often it was made",
        ((f"{name}  ×{len(each)}", sum(each)) for name, each in made.items()),
        asked.most,
        whole,
    )
    return 0


def chosen(found: Durations, under: str, nightly: bool) -> Durations:
    """Select nightly or regular tests below a path."""
    names = [name for name in found.tests if name.startswith(under) and (name in found.nightly) == nightly]
    return Durations(
        {name: found.tests[name] for name in names},
        {name: found.fixtures[name] for name in names},
        found.nightly,
    )


def section(title: str, rows: Iterable[tuple[str, float]], most: int, whole: float) -> None:
    """Print the largest rows of a table in seconds, each with its share of the total."""
    print(f"\n{title}")
    for name, seconds in sorted(rows, key=lambda row: -row[1])[:most]:
        print(f"{seconds:8.2f} s  {100 * seconds / whole:5.1f} %  {name}")


if __name__ == "__main__":
    sys.exit(main())
