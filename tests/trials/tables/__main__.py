"""Tables of poses as others write them: which are imported without a word, with one question, or not."""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path
from typing import get_args

from tests.support import drawn_tables
from tests.support.foreign_tables import Foreign, drawn, foreign_tables, in_format, tried


def main() -> None:
    """Print the table, then the counts of drawn poses in every format."""
    parser = argparse.ArgumentParser(prog="scripts/dev tables", description=__doc__)
    parser.add_argument("--drawn", type=int, default=0, help="sets of few or many poses in every format beside it (0)")
    parser.add_argument("--files", type=int, default=0, help="drawn files of every exporter and trouble alone (0)")
    parser.add_argument("--new", action="store_true", help="draw them with the added troubles and exporters")
    parser.add_argument("--seed", type=int, default=0, help="of the first of these files (0)")
    given = parser.parse_args()
    if given.files:
        _drawn_files(range(given.seed, given.seed + given.files), new=given.new)
        return
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


def _drawn_files(seeds: range, *, new: bool) -> None:
    """Print what an import made of each drawn file by its trouble, and each that is refused or wrong."""
    outcomes, counts = [*get_args(drawn_tables.Outcome), "wrong in silence"], Counter[tuple[str, str]]()
    for seed in seeds:
        file = drawn_tables.drawn(seed, new=new)
        with tempfile.TemporaryDirectory(prefix="rig-tables-") as folder:
            done = drawn_tables.judged(file, Path(folder))
        outcome = "wrong in silence" if done.wrong else done.outcome
        counts[file.trouble, outcome] += 1
        if done.wrong or "answer" in outcome or (file.sound and done.outcome == "refused"):
            last = (done.lines.strip().splitlines() or [""])[-1]
            print(f"  {seed}, {file.arm}, {file.exporter}, {file.trouble}: {outcome}: {done.wrong or last}", flush=True)
    print(f"| | files | {' | '.join(outcomes)} |\n|{' --- |' * (len(outcomes) + 2)}")
    for trouble in sorted({trouble for trouble, _ in counts}):
        row = [counts[trouble, outcome] for outcome in outcomes]
        print(f"| {trouble} | {sum(row)} | {' | '.join(map(str, row))} |")
    total = [sum(count for (_, of), count in counts.items() if of == outcome) for outcome in outcomes]
    print(f"| all | {len(seeds)} | {' | '.join(map(str, total))} |")


def _said(foreign: Foreign) -> str:
    with tempfile.TemporaryDirectory(prefix="rig-tables-") as folder:
        done = tried(foreign, Path(folder))
    return f"{done.outcome}, wrong in silence: {done.wrong}" if done.wrong else done.outcome


if __name__ == "__main__":
    main()
