"""Column maps of tables in foreign formats: proposal, questions to the operator, and storage in the run."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.cli.console import progress_of, say
from analysis.cli.dialogue import Dialogue, has_keyboard
from analysis.intake.imports import is_plain, propose_map, read_mapped
from analysis.intake.map_proposal import MapProposal
from analysis.intake.table_map import MAPPED, TableMap, load_map, map_text, value_text
from analysis.intake.table_reading import Question, TableReading
from analysis.intake.touch_map import needs_touch_map, propose_touch_map
from analysis.runs.table_layout import JointSource
from analysis.runs.written_files import holding, write_new
from rigs.errors import FileError, UseError
from rigs.load import load
from rigs.schema.vocabulary import Direction, TestName

if TYPE_CHECKING:
    from analysis.runs.loading import Measured


def has_person() -> bool:
    """True if an operator can answer. Questions go to standard error, because scripts read the run path from
    standard output.
    """
    return has_keyboard() and sys.stderr.isatty()


def needs_map(table: Path, test: TestName, socket: str = "") -> bool:
    """True if a file differs from the format of docs/tables.md but can be read with a proposed map.

    socket: socket of all rows of a table of touches.
    """
    return needs_touch_map(table, test, socket) or (test == MAPPED and not is_plain(table, test))


def mapped_run(
    files: Sequence[Path],
    rig_file: str,
    test: TestName,
    run: Path,
    *,
    map_file: Path | None,
    join: str,
    yes: bool,
    topic: str,
    socket: str,
    direction: Direction | None,
    operator: str,
    placement: str,
    joints: JointSource,
) -> Measured:
    """Run of the files of a measurement, read with a given map or with a map proposed and completed here."""
    if map_file:
        table_map = load_map(map_file)
        if topic:
            problem = "is already in the map (topic of a file)"
            raise UseError("--topic", problem, "remove the option, or change the map", code="import.in_map")
        if socket:
            remedy = "remove the option, or change the constants in the map"
            raise UseError("--socket", "is already in the map", remedy, code="import.in_map")
        if join and join != table_map.join:
            problem = f"is {join}, but the map joins by {table_map.join or 'nothing'}"
            raise UseError("--join", problem, "remove it", code="import.in_map")
    elif not join and needs_touch_map(files[0], test, socket):
        table_map = propose_touch_map(files[0], load(rig_file)[0], test, socket)
        _say_map(table_map)
    elif test != MAPPED:
        remedy = "write one and give it with --map (docs/tables.md)"
        raise UseError("--join", f"needs a map of a {test} table", remedy, code="import.no_map")
    else:
        table_map = _proposed(files, rig_file, join, run, topic=topic, yes=yes)
    with progress_of(f"reading {files[0]}"):
        return read_mapped(
            files,
            table_map,
            rig_file=rig_file,
            test=test,
            direction=direction,
            operator=operator,
            placement=placement,
            joints=joints,
        )


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
            raise UseError(question.key, problem, f"give 1 to {len(question.readings)}", code="answer.choice")
        return question.readings[int(text) - 1]

    return read


def _refuse(proposal: MapProposal, run: Path, files: Sequence[Path]) -> None:
    """Write the map, mark the open questions, and raise FileError: no terminal is available for answers."""
    path = Path(f"{run.name}.map.yaml")  # not next to the run, since every file in that directory counts as a run
    choices = {
        question.key: [
            question.asks,
            *(f"{value_text(reading.value)}  # {reading.line()}" for reading in question.readings),
        ]
        for question in proposal.questions
    }
    write_new(path, holding(map_text(proposal.table_map, choices).encode()))
    open_keys = "; ".join(f"{question.key}: {question.asks}" for question in proposal.questions)
    problem = f"has open questions ({open_keys}), and rig cannot ask without a terminal"
    raise FileError(
        str(files[0]),
        problem,
        f"write the answer in place of the ? in {path}, and give it with --map",
        code="map.questions",
    )
