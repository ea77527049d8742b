"""`rig import TABLE…`: runs from tables of other programs and from ROS 2 bags, with maps of foreign columns."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.api import save_run
from analysis.cli.commands import app, command
from analysis.cli.console import progress_of, say
from analysis.cli.dialogue import Dialogue, has_person
from analysis.cli.options import Calibration, Operator, direction_option, operator_or_user, rig_option
from analysis.cli.several import for_each, with_controller
from analysis.intake.imports import (
    RunLabels,
    is_plain,
    needs_touch_map,
    propose_map,
    propose_touch_map,
    read_mapped,
    read_table,
    refuse_two_arms,
    test_of,
)
from analysis.intake.map_proposal import MapProposal
from analysis.intake.readers import file_of
from analysis.intake.table_map import MAPPED, TableMap, load_map, map_text, value_text
from analysis.intake.table_reading import Question, TableReading
from analysis.runs.tables import SOCKET, JointSource, format_of
from analysis.runs.written_files import holding, refuse_existing, write_new
from rigs.errors import FileError, UseError
from rigs.load import load
from rigs.schema.vocabulary import CIRCLES, Direction, TestName

if TYPE_CHECKING:
    from analysis.runs.loading import Measured


def mapped_run(
    files: Sequence[Path],
    rig_file: str,
    test: TestName,
    run: Path,
    labels: RunLabels,
    *,
    map_file: Path | None,
    join: str,
    yes: bool,
    topic: str,
    socket: str,
) -> Measured:
    """Run of the files of a measurement, read with a given map or with one that is proposed and completed here."""
    if map_file:
        table_map = load_map(map_file)
        if topic:
            problem = "is already in the map (topic of a file)"
            raise UseError("--topic", problem, "remove the option, or change the map", code="usage")
        if socket:
            remedy = "remove the option, or change the constants in the map"
            raise UseError("--socket", "is already in the map", remedy, code="usage")
        if join and join != table_map.join:
            problem = f"is {join}, but the map joins by {table_map.join or 'nothing'}"
            raise UseError("--join", problem, "remove it", code="usage")
    elif not join and needs_touch_map(files[0], test, socket):
        table_map = propose_touch_map(files[0], load(rig_file)[0], test, socket)
        _say_map(table_map)
    elif test != MAPPED:
        remedy = "write one and give it with --map (docs/tables.md)"
        raise UseError("--join", f"needs a map of a {test} table", remedy, code="usage")
    else:
        table_map = _proposed(files, rig_file, join, run, topic=topic, yes=yes)
    with progress_of(f"reading {files[0]}"):
        return read_mapped(files, table_map, rig_file, test, labels)


def _proposed(files: Sequence[Path], rig_file: str, join: str, run: Path, *, topic: str, yes: bool) -> TableMap:
    with progress_of(f"reading {files[0]}"):
        proposal = propose_map(files, rig_file, join, topic)
    for line in proposal.checked:
        say(line, err=True)
    if proposal.questions and not yes:
        if not has_person():
            _refuse(proposal, run, files)
        dialogue = Dialogue(lambda line: say(line, err=True), progress_of, True, sys.stdin, sys.stderr)
        while proposal.questions:
            question = proposal.questions[0]
            lines = [f"{question.key}: {question.asks}"]
            lines += [f"  {number}  {reading.line()}" for number, reading in enumerate(question.readings, start=1)]
            lines += [f"number, 1 to {len(question.readings)}"]
            chosen = dialogue.ask("\n".join(lines), "--map", _answer_of(question))
            proposal = proposal.answered(question, chosen)
    proposal = proposal.assumed()
    _say_map(proposal.table_map)
    return proposal.table_map


def _say_map(table_map: TableMap) -> None:
    say("The columns were read with this map, which is stored in the run:", err=True)
    for line in map_text(table_map).splitlines():
        say(f"  {line}", err=True)


def _answer_of(question: Question) -> Callable[[str], TableReading]:
    def read(text: str) -> TableReading:
        if not text.isdigit() or not 1 <= int(text) <= len(question.readings):
            problem = f"{text!r} is not a number in the list"
            raise UseError(question.key, problem, f"give 1 to {len(question.readings)}")
        return question.readings[int(text) - 1]

    return read


def _refuse(proposal: MapProposal, run: Path, files: Sequence[Path]) -> None:
    """Write the map with the open questions, and raise FileError: there is no terminal for answers."""
    path = Path(f"{run.name}.map.yaml")  # not next to the run, since every file in that directory counts as a run
    choices = {
        one.key: [one.asks, *(f"{value_text(reading.value)}  # {reading.line()}" for reading in one.readings)]
        for one in proposal.questions
    }
    write_new(path, holding(map_text(proposal.table_map, choices).encode()))
    problem = f"has open questions ({proposal.asks}), and rig cannot ask without a terminal"
    remedy = f"write the answer in place of the ? in {path}, and give it with --map"
    raise FileError(str(files[0]), problem, remedy, code="table.unclear")


@command(app, "rig import laps.csv --rig cell.yaml --test yaw -o runs/lap-acw", name="import")
def import_(
    tables: Annotated[
        list[Path],
        typer.Argument(
            metavar="TABLE…", help="CSV, Parquet, npz, JSON lines, workbooks, bags of ROS 2: docs/tables.md."
        ),
    ],
    rig_file: Annotated[str, rig_option("Rig file, or the name of a shipped rig or of an arm in the library.")],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Run directory to create; with several tables: directory in which each run gets the name of its "
            "table.",
        ),
    ],
    calibration: Calibration = None,
    test: Annotated[TestName | None, typer.Option(help="Test of the tables; default: by their columns.")] = None,
    direction: Annotated[
        Direction | None, direction_option("Direction of yaw and roll; default: the column direction of the table")
    ] = None,
    operator: Operator = "",
    placement: Annotated[str, typer.Option(help="Label of the place of instrument or ball; default: none.")] = "",
    joints: Annotated[
        JointSource, typer.Option(help="Joint angles to use: columns qN_deg, or qN_commanded_deg.")
    ] = "measured",
    map_file: Annotated[
        Path | None, typer.Option("--map", help="Map of the columns; default: proposed by rig if needed.")
    ] = None,
    join: Annotated[
        str,
        typer.Option(
            metavar="rows|COLUMN",
            help="The files are one measurement, joined row by row or by a column; default: a run of each file.",
        ),
    ] = "",
    socket: Annotated[
        str, typer.Option(help="With --test touch: socket that all rows touch; default: the column socket.")
    ] = "",
    topic: Annotated[
        str,
        typer.Option(help="Topic of the poses in a bag, of a transform /tf:CHILD; default: the only topic of poses."),
    ] = "",
    yes: Annotated[
        bool,
        typer.Option(
            "--yes",
            help="Take the likeliest answer to each open question about a table; each becomes a doubt of the run.",
        ),
    ] = False,
) -> None:
    """Create a run from each table of measurements; report every bad row with its line and the reason.

    Tables of poses may have the format of the instrument: rig proposes a map of
    the columns, checks it with the arm of the rig file, shows it and stores it
    in the run. You answer open questions at the terminal. If there is none, rig
    writes the map for you to complete and imports nothing.
    """
    labels = RunLabels(direction, operator_or_user(operator), placement, joints)
    rig_file = with_controller(rig_file, calibration)
    if test:
        _refuse_other_options(test, direction, topic, socket)

    def make_run(table: Path) -> None:
        files = [file_of(source) for source in (tables if join else [table])]
        run = output / table.stem if len(tables) > 1 and not join else output
        refuse_existing(run)
        kind = test or test_of(files[0], load(rig_file)[0])
        if not test:
            say(f"{files[0]}: a {kind} table according to the columns; --test overrides this", err=True)
        _refuse_other_options(kind, direction, topic, socket)
        refuse_two_arms(files[0], kind)
        is_foreign = needs_touch_map(files[0], kind, socket) or (kind == MAPPED and not is_plain(files[0], kind))
        if join or map_file or is_foreign:
            measured = mapped_run(
                files, rig_file, kind, run, labels, map_file=map_file, join=join, yes=yes, topic=topic, socket=socket
            )
        else:
            with progress_of(f"reading {table}"):
                measured = read_table(files[0], rig_file, kind, labels)
        save_run(measured, run)
        for doubt in measured.doubts:
            say(f"doubt: {doubt}", err=True)
        say(run)

    for_each(tables[:1] if join else tables, make_run)


def _refuse_other_options(test: TestName, direction: Direction | None, topic: str, socket: str) -> None:
    if direction and test not in CIRCLES:
        problem = f"a {test} test does not have a direction"
        raise UseError("--direction", problem, "remove it")
    if socket and SOCKET not in format_of(test).layout().required:
        raise UseError("--socket", f"is of touches, and the test is {test}", "remove it")
    if topic and test != MAPPED:
        raise UseError("--topic", f"is of poses, and the test is {test}", "remove it")
