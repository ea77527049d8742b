"""Output of rig for some forty runs and cells, compared with the stored golden answers."""

from __future__ import annotations

import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

from tests.support.measured_series import DATA
from tests.support.trial import Trial, main
from tests.trials.golden.golden import CASES, changes, file_of, keep, kept, made

SHOWN = 12
"""Changes of a case that are printed, the largest first."""


def draw(given: Namespace) -> Iterator[tuple[str, Namespace]]:
    names = [case.name for case in CASES]
    chosen = [name for name in names if any(fnmatch(name, word) for word in given.names)]
    if not chosen:
        raise SystemExit(f"error: no such case; there are {', '.join(names)}")
    yield from ((name, given) for name in chosen)


def judged(drawn: tuple[str, Namespace]) -> tuple[str, int]:
    """The lines of a case, and the number of changes."""
    name, given = drawn
    case = next(case for case in CASES if case.name == name)
    begin = time.process_time()
    with tempfile.TemporaryDirectory(prefix="rig-golden-") as root:
        said = made(case, Path(root).resolve() / case.name, given.data)
    took = f"{time.process_time() - begin:.1f} s"
    if said is None:
        return f"{case.name}: its data are not in {given.data}", 0
    if given.update:
        keep(case, said)
        return f"{case.name}: kept, {took}", 0
    if not file_of(case).is_file():
        return f"{case.name}: nothing is kept of it; --update keeps it", 1
    found = [one for one in changes(kept(case), said) if given.exact or not one.is_of_processor]
    found.sort(key=lambda one: -one.size)
    shown = [f"  {one}" for one in (found if given.all else found[:SHOWN])]
    return "\n".join([f"{case.name}: {f'{len(found)} changed' if found else 'as kept'}, {took}", *shown]), len(found)


TRIAL = Trial(
    draw,
    judged,
    line=lambda one: one[0],
    failed=lambda done: any(changed for _, changed in done),
    options={
        "NAMES": (("*",), "names or patterns of names (all)"),
        "update": (False, "keep what is said now; look at the difference in git"),
        "all": (False, f"print every change, not the {SHOWN} largest of a case"),
        "exact": (False, "also changes that another processor may cause"),
        "data": (DATA, "the folder of measured data (../shared/data)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
