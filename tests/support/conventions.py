"""Cells of an independent world, sound or with one broken convention, and the expected findings of rig.

`tests/tables/conventions.xz` has them as the retired trial `conventions` drew them (docs/evidence/conventions.md):
circles and targets of `tests.worlds.stranger`, laps that begin where the one before ended, laps with a joint a turn on,
and poses of five arms. Each
arm has every effect at its healthy size.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from analysis.procedures.shared.test_kind import Finding
from analysis.runs.loading import Measured, measured_of
from analysis.runs.tables import CircleTable, PoseTable, RadialTable, RepeatabilityTable, Table, columns_of
from daq.store import table_run
from rigs.load import load
from rigs.rig import Rig
from tests.support.archives import Archive

_TABLES = {table.__name__: table for table in (CircleTable, PoseTable, RadialTable, RepeatabilityTable)}


def run_of(table: Table, name: str, rig: Rig) -> Measured:
    direction = table.direction if isinstance(table, CircleTable) else None
    kind = {RadialTable: "radial", RepeatabilityTable: "repeatability", PoseTable: "pose"}
    test = table.test if isinstance(table, CircleTable) else kind[type(table)]
    run = table_run(
        Path(name), columns_of(table), test=test, direction=direction, rig_name=rig.name,  # type: ignore[arg-type]
        rig_text=load("paper-fanuc")[1], operator="", source="t.csv", source_sha256="0" * 64,
    )  # fmt: skip
    return measured_of(run, rig)


@dataclass(frozen=True)
class Drawn:
    """Named tables of a cell; of a broken one the convention, and words of which the finding must contain one."""

    rig: Rig
    tables: tuple[tuple[str, Table], ...]
    convention: str = ""
    meant: tuple[str, ...] = ()

    @cached_property
    def runs(self) -> list[Measured]:
        return [run_of(table, name, self.rig) for name, table in self.tables]

    def is_named(self, finding: Finding) -> bool:
        return finding.convention == self.convention and any(words in finding.meant for words in self.meant)


@cache
def cells() -> dict[str, Drawn]:
    """Cells by name: `sound 3`, `driven on 0`, or the broken convention with a number."""
    archive, found = Archive("conventions"), {}
    rigs = [Rig.model_validate(rig) for rig in archive.about["rigs"]]
    for name, cell in archive.about["cells"].items():
        rig, tables = rigs[cell.pop("rig")], []
        for run in cell.pop("runs"):
            columns = {key: np.array(run["stated"].pop(key), dtype=kind) for key, kind in run["dtypes"].items()}
            columns |= archive.columns(run["measured"])
            tables.append((run["name"], _TABLES[run["kind"]](**run["stated"], **columns)))
        found[name] = Drawn(rig, tuple(tables), **cell)
    return found
