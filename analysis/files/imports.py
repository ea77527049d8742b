"""From a table file to a run: read, and held against the rig."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from analysis.conventions.check import doubts_of, refuse_impossible
from analysis.files.read import read_file
from analysis.measures.checks import hold_alive
from analysis.traces.laps import laps_of
from analysis.traces.loading import Measured, measured_of
from analysis.traces.table_layout import JointSource
from analysis.traces.tables import CircleTable, PlaceTable, Table
from daq.store import table_run
from rigs.errors import FileError
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName


def read_table(
    source: Path,
    *,
    rig_file: str | Path,
    test: TestName,
    direction: Direction | None,
    operator: str,
    placement: str = "",
    joints: JointSource = "measured",
) -> Measured:
    """The run of a table file, not written; among its doubts is what an evaluation will refuse.

    Raises FileError for mistakes in either file.
    """
    rig, rig_text = load(rig_file)
    read = read_file(source, test, rig, direction, joints)
    run = table_run(
        source,
        read.table,
        test=test,
        direction=read.direction,
        rig_name=rig.name,
        rig_text=rig_text,
        operator=operator,
        source=source.name,
        source_sha256=read.sha256,
        placement=placement,
    )
    measured = measured_of(run, rig)
    refuse_impossible(measured, str(source))
    doubts = (*read.doubts, *_doubts(measured.table, rig, str(source)), *measured.doubts)
    return replace(measured, doubts=doubts_of(replace(measured, doubts=doubts)))


def _doubts(table: Table, rig: Rig, where: str) -> list[str]:
    """What an evaluation will refuse: it is better reported now."""
    try:
        if isinstance(table, CircleTable):
            laps_of(table, rig, where)
        if not isinstance(table, PlaceTable):
            columns = table.g_mm.reshape(len(table.g_mm), -1).T
            hold_alive(where, **{f"g{number}_mm": column for number, column in enumerate(columns, start=1)})
    except FileError as error:
        return [str(error)]
    return []
