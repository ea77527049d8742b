"""Every next line and remedy that rig prints on the golden cells, followed: lines, ends, and which are dead."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from tests.trials.golden.golden import DATA
from tests.trials.next_lines.next_line_cases import cases, followed
from tests.trials.next_lines.next_lines import Followed, table


def main() -> None:
    """Print the counts by case, and each dead end with the line that names it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="cases to follow (all)")
    parser.add_argument("--quick", action="store_true", help="those alone that each commit follows")
    parser.add_argument("--data", type=Path, default=DATA, help="the folder of measured data (../shared/data)")
    given = parser.parse_args()
    found: dict[str, Followed] = {}
    for case in cases(given.data):
        if (given.names and case.name not in given.names) or (given.quick and not case.quick):
            continue
        with tempfile.TemporaryDirectory() as work:
            found[case.name] = followed(case, Path(work))
        print(f"{case.name}: {found[case.name]}", file=sys.stderr, flush=True)
    print(table(found))
    sys.exit(1 if any(one.dead for one in found.values()) else 0)


if __name__ == "__main__":
    main()
