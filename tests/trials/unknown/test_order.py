import csv
import random
from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from tests.trials.unknown.rig_cli import diagnose, import_tables
from tests.worlds.unknown.causes import CAUSES
from tests.worlds.unknown.cells import draw_cell
from tests.worlds.unknown.files import write_cell

Rows = list[dict[str, str]]
OF_POSTURE = [kind for kind in CAUSES if kind.kind in ("cubic torsion", "wandering axis", "cable drag")]
"""Causes without memory, whose errors do not change with the order."""


def shuffled(rows: Rows) -> Rows:
    return random.Random(0).sample(rows, len(rows))


def turned(rows: Rows) -> Rows:
    joint = max(key for key in rows[0] if key.startswith("q"))
    return [row | ({joint: f"{float(row[joint]) + 360.0:.5f}"} if k % 3 == 0 else {}) for k, row in enumerate(rows)]


def numbers(answer: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Every number of an answer by its place, except the row numbers, which other orders change."""
    if isinstance(answer, Mapping):
        for key in answer.keys() - {"rows"}:
            yield from numbers(answer[key], f"{path}.{key}")
    elif isinstance(answer, list):
        for k, value in enumerate(answer):
            yield from numbers(value, f"{path}.{k}")
    elif isinstance(answer, int | float) and not isinstance(answer, bool):
        yield path, float(answer)


@pytest.mark.nightly
@pytest.mark.cpu_limit(300)
@pytest.mark.parametrize("change", [shuffled, turned])
def test_equal_tables_have_equal_answers(change, tmp_path):
    cell = next(cell for seed in range(20) if (cell := draw_cell(seed, OF_POSTURE)).test == "pose")
    ((table, test, direction),) = write_cell(cell, tmp_path)
    with table.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    with (tmp_path / "other.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(change(rows))
    first, again = (
        diagnose(import_tables([(path, test, direction)], tmp_path / "cell.yaml", tmp_path / f"runs-{path.stem}"))
        for path in (table, tmp_path / "other.csv")
    )
    compared = ("gap", "effects", "accuracy", "remainder")
    one, other = (dict(numbers({key: answer.get(key) for key in compared})) for answer in (first, again))
    assert other == pytest.approx(one, rel=1e-4, abs=1e-7)
