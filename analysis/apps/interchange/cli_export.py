"""`rig export RUN…`: write the tables of runs for other programs, or the streams for plotting."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, get_args

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say
from analysis.cli.options import Runs
from analysis.cli.several import for_each
from rigs.errors import UseError
from rigs.text import as_argument, enumerated

if TYPE_CHECKING:
    from daq.store import Run

Format = Literal["csv", "parquet", "xlsx", "mcap", "map"]


@command(app, "rig export runs/lap-acw --to parquet -o lap-acw.parquet")
def export(
    paths: Runs,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Output file; for several runs, the output directory."),
    ],
    to: Annotated[
        Format | None,
        typer.Option(
            help="Format: csv, parquet or xlsx for the table, mcap for the raw streams, map: the column map of an "
            "imported table; default: that of the ending of the output file."
        ),
    ] = None,
) -> None:
    """Write the table of each run as CSV, Parquet or a workbook, its raw streams as MCAP, or the map of its import.

    Foxglove and PlotJuggler show an MCAP file."""
    if len(paths) == 1:
        _export(paths[0], _format_of(output, to), output)
        return
    if to is None:
        raise UseError("--to", "is missing", f"give {enumerated(_FORMATS, 'or')} for several runs")
    for_each(paths, lambda path: _export(path, to, output / f"{path.name}.{to}"))


_FORMATS: tuple[Format, ...] = get_args(Format)


def _format_of(output: Path, to: Format | None) -> Format:
    """Format of a file. Raises UseError if its ending is that of a different one, or names none."""
    ending = output.suffix.lower().removeprefix(".")
    by_ending = next((name for name in _FORMATS if name == ending), None)
    if to and by_ending and to != by_ending:
        remedy = f"write -o {as_argument(output.with_suffix(f'.{to}'))}, or --to {by_ending}"
        raise UseError(f"-o {output}", f"ends like {by_ending}, but --to is {to}", remedy)
    if chosen := to or by_ending:
        return chosen
    raise UseError("--to", "is missing", f"give {enumerated(_FORMATS, 'or')}, or an output file with such an ending")


def _export(path: Path, to: Format, output: Path) -> None:
    """Write a file, and mark the run as exported. A map does not count as an export of the readings."""
    from functools import partial

    from analysis.apps.interchange.mcap_export import write_mcap
    from analysis.cli.console import progress_of
    from analysis.runs.loading import measured_of
    from analysis.runs.written_files import holding, write_csv, write_new, write_parquet, write_xlsx
    from daq.store import durable, mark_exported, read_run
    from rigs.errors import CellError, RigError

    if to == "map":
        write_new(output, holding(_map_of(read_run(path))))
        say(output)
        return
    with progress_of(f"exporting {path}"):
        run = read_run(path)
        measured = None if to == "mcap" else measured_of(run)
        if measured is None:
            write_new(output, partial(write_mcap, run))
        else:
            write = {"csv": write_csv, "parquet": write_parquet, "xlsx": write_xlsx}[to]
            write_new(output, partial(write, measured.to_table()))
    for doubt in measured.doubts if measured else ():
        say(f"note: {doubt}", err=True)
    try:
        durable.persist(output)  # rigd may delete a marked run, and a power failure must not destroy the only copy.
    except OSError as error:
        problem = f"could not be written durably, so {path} is not marked as exported: {error.strerror or error}"
        raise CellError(str(output), problem, "export to a different disk", code="output.not_writable") from None
    try:
        mark_exported(path, to, output)
    except RigError as error:
        say(f"{path} could not be marked as exported, so rigd will not delete the run: {error.what}", err=True)
    say(output)


def _map_of(run: Run) -> bytes:
    from rigs.errors import FileError

    table = run.manifest.table
    if table is None or not table.map:
        problem = "was imported without a column map" if table else "is a recorded run without an imported table"
        remedy = "give a run that rig import created from a table with different columns"
        raise FileError(str(run.path), problem, remedy, code="readings.unsuitable")
    return table.map.encode()
