"""Tables of poses as others write them: which are imported without a word, with one question, or not."""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path

from tests.support.foreign_tables import Foreign, drawn, foreign_tables, in_format, tried


def main() -> None:
    """Print the table, then the counts of drawn poses in every format."""
    parser = argparse.ArgumentParser(prog="scripts/dev tables", description=__doc__)
    parser.add_argument("--drawn", type=int, default=0, help="sets of few or many poses in every format beside it (0)")
    given = parser.parse_args()
    print("| table | | imported |\n| --- | --- | --- |")
    for foreign in foreign_tables():
        if foreign.is_here:
            kind = "measured" if foreign.real else "in the format"
            print(f"| {foreign.words} | {kind} | {_said(foreign)} |", flush=True)
    counts = Counter[str]()
    for seed in range(given.drawn):
        rig, poses = drawn(seed)
        for foreign in in_format(poses, rig):
            said = _said(foreign)
            counts[said] += 1
            if "wrong" in said:
                print(f"set {seed}, {foreign.words}: {said}", flush=True)
    if given.drawn:
        print(", ".join(f"{said}: {count}" for said, count in counts.most_common()))


def _said(foreign: Foreign) -> str:
    with tempfile.TemporaryDirectory(prefix="rig-tables-") as folder:
        done = tried(foreign, Path(folder))
    return f"{done.outcome}, wrong in silence: {done.wrong}" if done.wrong else done.outcome


if __name__ == "__main__":
    main()
