"""The same poses in another order, or a joint a whole turn further: relative differences of the results.

`scripts/dev order 10` writes pose tables without times of cells of `tests/worlds/unknown`, as they are, with shuffled
rows, and with one joint 360 degrees further in some rows; it diagnoses each and prints the largest relative difference
of gaps, worths, odds and sizes.
"""

from __future__ import annotations

import argparse
import csv
import random
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from tests.trials.unknown.rig_cli import RigFailedError, diagnose, import_tables
from tests.worlds.unknown.causes import CAUSES
from tests.worlds.unknown.cells import draw_cell
from tests.worlds.unknown.files import write_cell

EQUAL = 1e-6
_COMPARED = ("gap", "effects", "accuracy", "remainder")
Rows = list[dict[str, str]]


def shuffled(rows: Rows, seed: int) -> Rows:
    """Return the rows in another order."""
    return random.Random(seed).sample(rows, len(rows))


def turned(rows: Rows, seed: int) -> Rows:
    """Return the rows, the last joint a whole turn further in every third one."""
    joint = max(key for key in rows[0] if key.startswith("q"))
    return [
        row | {joint: f"{float(row[joint]) + 360.0:.5f}"} if k % 3 == seed % 3 else dict(row)
        for k, row in enumerate(rows)
    ]


WAYS: dict[str, Callable[[Rows, int], Rows]] = {"shuffled": shuffled, "turned": turned}


def numbers(answer: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Yield every number of an answer with its place in it, except the row numbers, which other orders change."""
    if isinstance(answer, Mapping):
        for key in answer.keys() - {"rows"}:
            yield from numbers(answer[key], f"{path}.{key}")
    elif isinstance(answer, list):
        for k, value in enumerate(answer):
            yield from numbers(value, f"{path}.{k}")
    elif isinstance(answer, int | float) and not isinstance(answer, bool):
        yield path, float(answer)


def difference(first: Mapping[str, Any], second: Mapping[str, Any]) -> tuple[float, str]:
    """Return the largest relative difference of two answers and where it is; infinite if their shape differs."""
    one, other = (dict(numbers({key: answer.get(key) for key in _COMPARED})) for answer in (first, second))
    if one.keys() != other.keys():
        return float("inf"), sorted(one.keys() ^ other.keys())[0]
    largest = {key: abs(one[key] - other[key]) / max(abs(one[key]), 1e-3) for key in one}
    where = max(largest, key=lambda key: largest[key])
    return largest[where], where


def main() -> None:
    parser = argparse.ArgumentParser(prog="scripts/dev order", description="Compare answers to equal pose tables.")
    parser.add_argument("tables", type=int, nargs="?", default=10, help="tables to draw (10)")
    parser.add_argument("--seed", type=int, default=0, help="of the first table (0)")
    given = parser.parse_args()
    equal = dict.fromkeys(WAYS, 0)
    # Causes of posture alone: what has a memory changes with the order in truth.
    kinds = [kind for kind in CAUSES if kind.kind in ("cubic torsion", "wandering axis", "cable drag")]
    for seed in range(given.seed, given.seed + given.tables):
        with tempfile.TemporaryDirectory() as scratch:
            for way, (size, where) in compared(seed, kinds, Path(scratch)):
                equal[way] += size <= EQUAL
                print(f"{seed} {way}: {size:.2g} at {where}", flush=True)
    print(f"equal to {EQUAL:g}: " + ", ".join(f"{way} {count} of {given.tables}" for way, count in equal.items()))


def compared(seed: int, kinds: list[Any], directory: Path) -> Iterator[tuple[str, tuple[float, str]]]:
    """Yield the difference of each way from the table as it is."""
    cell = draw_cell(seed, kinds)
    while cell.test != "pose":
        seed += len(kinds)
        cell = draw_cell(seed, kinds)
    ((table, test, direction),) = write_cell(cell, directory)
    with table.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    first = _answer(table, test, direction, directory / "as-it-is")
    for way, change in WAYS.items():
        other = directory / f"{way}.csv"
        with other.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(change(rows, seed))
        try:
            yield way, difference(first, _answer(other, test, direction, directory / way))
        except RigFailedError as error:
            yield way, (float("inf"), str(error))


def _answer(table: Path, test: str, direction: str, directory: Path) -> dict[str, Any]:
    return diagnose(import_tables([(table, test, direction)], table.parent / "cell.yaml", directory))


if __name__ == "__main__":
    main()
