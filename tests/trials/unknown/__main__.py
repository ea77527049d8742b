"""Cells with one cause outside the library: whether that is reported, a wrong part is named, the first act helps.

`scripts/dev unknown 60 --seed 1000` draws 60 cells of eight causes, diagnoses each one and the same cell without its
cause by commands of rig, and prints a row per cell and the counts. With `--json FILE` each cell is appended to FILE
as it ends, and cells that stand in FILE are not diagnosed again.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from tests.support.trial import Trial, main, markdown, seeds
from tests.trials.unknown.judging import judge
from tests.trials.unknown.rig_cli import RigFailedError, kept_answer
from tests.worlds.unknown.causes import CAUSES
from tests.worlds.unknown.cells import Cell, draw_cell, noise_um

GOALS = "goals: told at least 95 %, cells with a wrong name at most 5 %, worse 0, time at most 3 times"
Row = dict[str, Any]


def draw(given: Namespace) -> Iterator[tuple[int, str, bool, Path | None]]:
    yield from ((seed, given.causes, not given.no_sound, given.keep) for seed in seeds(given))


def judged(case: tuple[int, str, bool, Path | None]) -> Row:
    seed, causes, with_sound, keep = case
    kinds = [kind for kind in CAUSES if not causes or kind.kind in causes.split(",")]
    with tempfile.TemporaryDirectory() as scratch:
        return judged_cell(draw_cell(seed, kinds), (keep or Path(scratch)) / f"cell-{seed}", with_sound)


def judged_cell(cell: Cell, directory: Path, with_sound: bool) -> Row:
    """Diagnose a cell, and the same cell without its cause; judge both."""
    row: Row = {
        "seed": cell.seed,
        "arm": cell.arm_name,
        "test": cell.test,
        "kind": cell.cause.kind,
        "cause": cell.cause.describe(),
        "foreign_um": round(cell.foreign_um, 1),
        "healthy_um": round(cell.healthy_um, 1),
        "noise_um": round(noise_um(cell), 1),
    }
    cases = {"with": cell} | ({"sound": cell.sound()} if with_sound else {})
    return row | {name: _judged(case, directory / name) for name, case in cases.items()}


def _judged(cell: Cell, directory: Path) -> Row:
    found = directory / "found"
    try:
        return judge(cell, kept_answer(cell, directory, found), found).as_json()
    except RigFailedError as error:
        return {"error": str(error)}


# --- what is printed


def row_text(row: Row) -> str:
    """Lines of one cell."""
    head = f"{row['seed']} {row['arm']} {row['test']}, {row['kind']} ({row['cause']})"
    head += f"; foreign {row['foreign_um']:.0f}, healthy {row['healthy_um']:.0f}, noise {row['noise_um']:.0f} µm"
    said = row["with"]
    if "error" in said:
        return f"{head}\n    ERROR {said['error']}"
    words = [said["condition"], "told" if said["told"] else "imitated" if said["imitated"] else "NOT TOLD"]
    words += [f"WRONG {name}" for name in said["wrong_certain"]]
    words += [f"related {name}" for name in said["related"]] + [f"right {name}" for name in said["right"]]
    act = f"{said['act']}: {_um(said['before_um'])} -> {_um(said['after_um'])} µm" + " WORSE" * said["worse"]
    times = ratio(row)
    cost = f"{said['cpu_s']:.1f} s" + (f", {times:.1f} times the sound cell" if times else "")
    return f"{head}\n    {'; '.join(words)}\n    {act}; {cost}"


def _um(value: float | None) -> str:
    return "?" if value is None else f"{value:.0f}"


def ratio(row: Row) -> float | None:
    """Processor time as a multiple of the sound cell's; None without a sound one."""
    sound, said = row.get("sound", {}), row["with"]
    return said["cpu_s"] / sound["cpu_s"] if sound.get("cpu_s") and said.get("cpu_s") else None


COLUMNS = ("cause", "cells", "told", "imitated, not told", "wrong fault", "wrong name at 95 %", "related name",
           "act worse", "time, median", "time, most")  # fmt: skip


def counts_text(rows: Sequence[Row]) -> str:
    """Table of counts, by cause, over all, and of the sound cells."""
    lines = []
    for kind in dict.fromkeys(row["kind"] for row in rows):
        lines.append(_counts(kind, [row for row in rows if row["kind"] == kind]))
    lines.append(_counts("all", rows))
    sound = [row | {"with": row["sound"], "sound": {}} for row in rows if "sound" in row]
    if sound:
        lines.append(_counts("the same without the cause", sound))
    errors = sum("error" in row["with"] for row in rows)
    return f"{markdown(COLUMNS, lines)}\n\n{errors} ended in an error; {GOALS}"


def _counts(name: str, rows: Sequence[Row]) -> list[str]:
    said = [row["with"] for row in rows if "error" not in row["with"]]
    times = [value for row in rows if (value := ratio(row))]
    return [
        name,
        str(len(rows)),
        str(sum(one["told"] for one in said)),
        str(sum(one["imitated"] and not one["told"] for one in said)),
        *(str(sum(bool(one[key]) for one in said)) for key in ("wrong_faults", "wrong_certain", "related")),
        str(sum(one["worse"] for one in said)),
        f"{median(times):.1f}" if times else "",
        f"{max(times):.1f}" if times else "",
    ]


TRIAL = Trial(
    draw,
    judged,
    counts_text,
    line=row_text,
    count=60,
    keeps=True,
    options={
        "causes": ("", f"some of: {','.join(kind.kind for kind in CAUSES)} (all)"),
        "no_sound": (False, "leave out the same cells without their causes"),
        "keep": (Path, "keep tables, runs and answers here; answers there are judged again"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
