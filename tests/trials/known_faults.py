"""Cells of the unknown world with one to three known faults instead: whether poses, touches and circles name them.

`scripts/dev known_faults 30 --keep DIR --json FILE` draws the cells, diagnoses them by commands of rig, and prints a
row per cell and the counts. `scripts/dev stated_odds DIR` judges the probabilities of the kept answers.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from tests.support.rates import counted, table
from tests.support.trial import Trial, main, seeds
from tests.trials.unknown.judging import truth_of_name
from tests.trials.unknown.rig_cli import RigFailedError, kept_answer
from tests.worlds.unknown.faults import draw_faulty

GOALS = {1: 0.96, 2: 0.93, 3: 0.93}
"""Share of cells in which every fault is confirmed, by the number of faults."""
Row = dict[str, Any]


def draw(given: Namespace) -> Iterator[tuple[int, Path | None]]:
    yield from ((seed, given.keep) for seed in seeds(given))


def judged(case: tuple[int, Path | None]) -> Row:
    seed, keep = case
    cell, faults = draw_faulty(seed)
    row: Row = {"seed": seed, "arm": cell.arm_name, "test": cell.test, "faults": faults}
    with tempfile.TemporaryDirectory() as scratch:
        try:
            answer = kept_answer(cell, (keep or Path(scratch)) / f"cell-{seed}" / "faulty")
        except RigFailedError as error:
            return row | {"error": str(error)}
    confirmed = [effect for effect in answer["effects"] if effect["stands"]]
    said = {str(name) for effect in confirmed for name in (effect["name"], *effect["twins"])}
    return row | {
        "condition": answer["condition"],
        "found": [name for name in faults if name in said],
        "wrong": [effect["name"] for effect in confirmed if truth_of_name(cell, effect) == "wrong"],
        "cpu_s": answer["cpu_s"],
    }


def row_text(row: Row) -> str:
    head = f"{row['seed']} {row['arm']} {row['test']}: {', '.join(row['faults'])}"
    if "error" in row:
        return f"{head}\n    ERROR {row['error']}"
    missed = [name for name in row["faults"] if name not in row["found"]]
    words = [row["condition"], *(f"MISSED {name}" for name in missed), *(f"WRONG {name}" for name in row["wrong"])]
    return f"{head}\n    {'; '.join(words)}; {row['cpu_s']:.1f} s"


def counts_text(rows: Sequence[Row]) -> str:
    """Cells with all faults confirmed, by number of faults and by readings, and cells with a wrong fault."""
    answered = [row for row in rows if "error" not in row]
    groups: dict[tuple[str, float], list[bool]] = {}
    for row in answered:
        count = len(row["faults"])
        for title, goal in ((f"{count} hidden: all named", GOALS[count]), (f"  {row['test']}: all named", GOALS[2])):
            groups.setdefault((title, goal), []).append(set(row["found"]) == set(row["faults"]))
    lines = [counted(title, goal, sum(own), len(own)) for (title, goal), own in sorted(groups.items())]
    wrong = [bool(row["wrong"]) for row in answered]
    lines.append(counted("cells with a wrong fault", 0.05, sum(wrong), len(wrong), most=True))
    return "\n".join([*table(lines), "", f"{len(rows) - len(answered)} ended in an error"])


TRIAL = Trial(
    draw,
    judged,
    counts_text,
    line=row_text,
    count=30,
    keeps=True,
    options={"keep": (Path, "keep tables, runs and answers here; answers there are judged again")},
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
