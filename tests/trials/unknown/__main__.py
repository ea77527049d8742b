"""Cells with one cause outside the library: whether that is reported, a wrong part is named, the first act helps.

`scripts/dev unknown 60 --seed 1000` draws 60 cells of eight causes, diagnoses each one and the same cell without its
cause by commands of rig, and prints a row per cell and the counts. With `--json FILE` each cell is appended to FILE
as it ends, and cells that stand in FILE are not diagnosed again.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from tests.trials.unknown.judging import judge
from tests.trials.unknown.rig_cli import RigFailedError, diagnose, import_tables
from tests.worlds.unknown.causes import CAUSES
from tests.worlds.unknown.cells import Cell, draw_cell, noise_um
from tests.worlds.unknown.files import write_cell

GOALS = "goals: told at least 95 %, cells with a wrong name at most 5 %, worse 0, time at most 3 times"
Row = dict[str, Any]


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="scripts/dev unknown",
        description="Diagnose cells with one cause of error that is outside rig's library; count what is said.",
        epilog="Seeds below 1000 are for development. Ctrl-C prints the counts of the cells that are finished.",
    )
    parser.add_argument("cells", type=int, nargs="?", default=60, help="cells to draw (60)")
    parser.add_argument("--seed", type=int, default=0, help="of the first cell; the others follow (0)")
    known = ",".join(kind.kind for kind in CAUSES)
    parser.add_argument("--causes", help=f"some of: {known} (all)")
    parser.add_argument("--no-sound", action="store_true", help="leave out the same cells without their causes")
    parser.add_argument("--json", type=Path, help="append each cell to this file; finished cells are read from it")
    parser.add_argument("--keep", type=Path, help="keep tables, runs and answers here; answers there are judged again")
    return parser.parse_args()


def main() -> None:
    given = arguments()
    kinds = [kind for kind in CAUSES if not given.causes or kind.kind in given.causes.split(",")]
    rows: list[Row] = []

    def make(seed: int) -> Row:
        with tempfile.TemporaryDirectory() as scratch:
            root = given.keep or Path(scratch)
            return judged_cell(draw_cell(seed, kinds), root / f"cell-{seed}", not given.no_sound)

    try:
        for row in streamed(range(given.seed, given.seed + given.cells), make, given.json):
            rows.append(row)
            print(row_text(row), flush=True)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
    print(counts_text(rows))


def streamed(seeds: Sequence[int], make: Callable[[int], Row], file: Path | None) -> Iterator[Row]:
    """Yield the row of each seed: from the file if it is there, else made and appended to it."""
    known: dict[int, Row] = {}
    if file and file.exists():
        known = {row["seed"]: row for row in map(json.loads, file.read_text(encoding="utf-8").splitlines())}
    for seed in seeds:
        row = known.get(seed)
        if row is None:
            row = make(seed)
            if file:
                with file.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(row) + "\n")
        yield row


def judged_cell(cell: Cell, directory: Path, with_sound: bool) -> Row:
    """Diagnose a cell, and the same cell without its cause; judge both."""
    assert cell.cause is not None
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
    file = directory / "answer.json"
    if not file.exists():
        try:
            runs = import_tables(write_cell(cell, directory), directory / "cell.yaml", directory / "runs")
            answer = diagnose(runs, directory / "found")
        except RigFailedError as error:
            return {"error": str(error)}
        file.write_text(json.dumps(answer, indent=1), encoding="utf-8")
    answer = json.loads(file.read_text(encoding="utf-8"))
    return judge(cell, answer, directory / "found").as_json()


# --- what is printed


def row_text(row: Row) -> str:
    """Return the lines of one cell."""
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
    """Return the processor time as a multiple of the sound cell's; None without a sound one."""
    sound, said = row.get("sound", {}), row["with"]
    return said["cpu_s"] / sound["cpu_s"] if sound.get("cpu_s") and said.get("cpu_s") else None


COLUMNS = ("cause", "cells", "told", "imitated, not told", "wrong fault", "wrong name at 95 %", "related name",
           "act worse", "time, median", "time, most")  # fmt: skip


def counts_text(rows: Sequence[Row]) -> str:
    """Return the table of counts, by cause, over all, and of the sound cells."""
    lines = ["", "| " + " | ".join(COLUMNS) + " |", "| --- " * len(COLUMNS) + "|"]
    for kind in dict.fromkeys(row["kind"] for row in rows):
        lines.append(_counts(kind, [row for row in rows if row["kind"] == kind]))
    lines.append(_counts("all", rows))
    sound = [row | {"with": row["sound"], "sound": {}} for row in rows if "sound" in row]
    if sound:
        lines.append(_counts("the same without the cause", sound))
    errors = sum("error" in row["with"] for row in rows)
    return "\n".join([*lines, "", f"{errors} ended in an error; {GOALS}"])


def _counts(name: str, rows: Sequence[Row]) -> str:
    said = [row["with"] for row in rows if "error" not in row["with"]]
    times = [value for row in rows if (value := ratio(row))]
    cells = [
        name,
        str(len(rows)),
        str(sum(one["told"] for one in said)),
        str(sum(one["imitated"] and not one["told"] for one in said)),
        *(str(sum(bool(one[key]) for one in said)) for key in ("wrong_faults", "wrong_certain", "related")),
        str(sum(one["worse"] for one in said)),
        f"{median(times):.1f}" if times else "",
        f"{max(times):.1f}" if times else "",
    ]
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    main()
