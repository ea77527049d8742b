"""Output of rig for some forty runs and cells, compared with the stored golden answers."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from fnmatch import fnmatch
from pathlib import Path

from tests.trials.golden.golden import CASES, DATA, changes, file_of, keep, kept, made

SHOWN = 12
"""Changes of a case that are printed, the largest first."""


def main() -> int:
    """Run the cases and print all changes; return 0 if nothing changed."""
    parser = argparse.ArgumentParser(
        prog="scripts/dev golden",
        description="Compare what rig says of some forty runs and cells with tests/golden, or keep it there.",
    )
    parser.add_argument("cases", nargs="*", default=["*"], metavar="CASE", help="names or patterns of names (all)")
    parser.add_argument("--update", action="store_true", help="keep what is said now; look at the difference in git")
    parser.add_argument("--all", action="store_true", help=f"print every change, not the {SHOWN} largest of a case")
    parser.add_argument("--data", type=Path, default=DATA, help="the folder of measured data (../shared/data)")
    given = parser.parse_args()
    chosen = [case for case in CASES if any(fnmatch(case.name, word) for word in given.cases)]
    if not chosen:
        parser.error(f"there is no case {', '.join(given.cases)}; there are {', '.join(case.name for case in CASES)}")
    changed = 0
    with tempfile.TemporaryDirectory(prefix="rig-golden-") as root:
        for case in chosen:
            begin = time.process_time()
            said = made(case, Path(root).resolve() / case.name, given.data)
            took = f"{time.process_time() - begin:.1f} s"
            if said is None:
                print(f"{case.name}: its data are not in {given.data}", flush=True)
                continue
            there = file_of(case).is_file()
            if given.update:
                keep(case, said)
                print(f"{case.name}: kept, {took}", flush=True)
                continue
            if not there:
                print(f"{case.name}: nothing is kept of it; --update keeps it", flush=True)
                changed += 1
                continue
            found = sorted(changes(kept(case), said), key=lambda one: -one.size)
            changed += len(found)
            print(f"{case.name}: {f'{len(found)} changed' if found else 'as kept'}, {took}", flush=True)
            for one in found if given.all else found[:SHOWN]:
                print(f"  {one}")
    return int(changed > 0)


if __name__ == "__main__":
    sys.exit(main())
