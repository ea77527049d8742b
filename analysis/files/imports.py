"""From a table file to a run: read, held against the rig, stored."""

from __future__ import annotations

from pathlib import Path

from analysis.files.read import read_csv
from analysis.files.units import check_units
from analysis.measures.checks import hold_alive
from analysis.traces.csv_tables import table_from
from analysis.traces.laps import laps_of
from analysis.traces.table_layout import JointSource
from analysis.traces.tables import CircleTable, PoseTable, Table
from daq.store import write_table_run
from rigs.errors import FileError
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName


def import_table(  # noqa: PLR0913 - one keyword for each option of the command
    source: Path,
    run: Path,
    *,
    rig_file: str,
    test: TestName,
    direction: Direction | None,
    operator: str,
    placement: str = "",
    joints: JointSource = "measured",
) -> list[str]:
    """Make a run directory of a table file. What a person should know of it, in words.

    Raises FileError for mistakes in either file or a directory that exists, CellError when the disk refuses.
    """
    if run.exists():
        raise FileError(str(run), "exists already", "give the run a directory of its own")
    rig, rig_text = load(rig_file)
    read = read_csv(source, test, rig, direction, joints)
    table = table_from(read.table, test, read.direction, str(source))
    doubts = check_units(table, rig, str(source))
    write_table_run(
        run,
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
    return doubts + _doubts(table, rig, str(run))


def _doubts(table: Table, rig: Rig, where: str) -> list[str]:
    """What an evaluation will refuse: it is better reported now."""
    try:
        if isinstance(table, CircleTable):
            laps_of(table, rig, where)
        if not isinstance(table, PoseTable):
            columns = table.g_mm.reshape(len(table.g_mm), -1).T
            hold_alive(where, **{f"g{number}_mm": column for number, column in enumerate(columns, start=1)})
    except FileError as error:
        return [str(error)]
    return []
