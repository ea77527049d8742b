"""`rig session CELL`: guided work from a checked rig file to a corrected robot."""

from __future__ import annotations

import shutil
import sys
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import rewrite_line, say, say_json
from analysis.cli.options import AsJson, Operator, RigArgument, maker_option, operator_or_user
from rigs.errors import FileError, UseError
from rigs.schema.vocabulary import MakerName

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analysis.apps.report.blocks import Block
    from analysis.apps.session.session_state import Session, SessionDirectory


@command(app, "rig session cell.yaml --for kuka")
def session(
    rig_file: RigArgument,
    minutes: Annotated[
        float, typer.Option(min=1, max=1440, help="Available time, including set-up and verification.")
    ] = 50.0,
    aim: Annotated[
        Literal["faults", "accuracy", "check"],
        typer.Option(
            help="Aim. faults: find worn, loose or shifted parts; accuracy: use the whole time; check: only the "
            "circle, without a correction."
        ),
    ] = "faults",
    maker: Annotated[
        MakerName | None, maker_option("Maker of the controller", "from the feedback or the name of the robot")
    ] = None,
    directory: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help="Directory of the session; default: session-NAME."),
    ] = None,
    correct: Annotated[
        Literal["entries", "programs", "none"] | None,
        typer.Option(
            help="Method of the correction; default: entries if they achieve at least four fifths of the gain of "
            "programs."
        ),
    ] = None,
    entered: Annotated[
        bool,
        typer.Option("--entered", help="Confirm that the values of the correction were entered at the controller."),
    ] = False,
    wait_min: Annotated[
        float, typer.Option(min=0.1, max=1440, help="Minutes to wait for the robot to start a program.")
    ] = 15.0,
    operator: Operator = "",
    emulated: Annotated[
        bool,
        typer.Option(
            "--emulated", help="Emulate the cell. The emulated robot starts automatically, without an operator."
        ),
    ] = False,
    effects: Annotated[
        str,
        typer.Option(
            metavar="FILE", help="With --emulated: hidden effects, or the name of a shipped rig; default: none."
        ),
    ] = "",
    fast: Annotated[
        bool,
        typer.Option("--fast", help="With --emulated: run in simulated time, 50 minutes in a few."),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="With --emulated: seed of the gauge noise.")] = 1,
    status: Annotated[bool, typer.Option("--status", help="Show the progress of the session, and end.")] = False,
    as_json: AsJson = False,
) -> None:
    """Measure, understand, correct and verify a robot, one program after the other.

    The session names the program to start, records the run, checks it, and
    shows the diagnosis so far. The state is saved in DIR/session.yaml after
    each step. Repeat the same command to continue after Ctrl-C or on another
    day.
    """
    from analysis.apps.session.session_state import Emulated, SessionDirectory
    from rigs.load import find, load, named_by

    rig, text = load(rig_file)
    place = SessionDirectory(directory or Path(f"session-{rig.name}"))
    if status:
        _show(*_status(place, rig_file, text), as_json=as_json)
        return
    if not emulated and (effects or fast):
        option = "--effects" if effects else "--fast"
        raise UseError(option, "is allowed only with --emulated", "add --emulated")
    controller = maker or rig.maker
    if controller is None:
        problem = "is required, because neither feedback nor robot names the maker"
        raise UseError("--for", problem, "give --for", code="maker.unknown")
    from analysis.apps.session.run_session import run_session
    from analysis.apps.session.session_answer import end_blocks
    from analysis.apps.session.session_plan import SessionOptions

    if Path(effects).is_file():  # an absolute path is valid in any working directory; the name of a shipped rig is kept
        effects = str(Path(effects).resolve())
    cell = Emulated(effects=effects, seed=seed, fast=fast) if emulated else None
    asked = SessionOptions(
        rig_file=str(find(rig_file).resolve()), aim=aim, minutes=minutes, maker=controller, emulated=cell,
        operator=operator_or_user(operator), wait_min=wait_min, correct=correct, entered=entered,
    )  # fmt: skip
    screen = _Lines(aside=as_json)
    try:
        with named_by(rig_file, rig):
            done = run_session(rig, text, place, asked, screen)
    except KeyboardInterrupt:
        screen.say(f"interrupted: the progress is saved in {place.file}; repeat the command to continue")
        raise typer.Exit(130) from None
    finally:
        screen.clear()
    _show(done, end_blocks(done, place.directory), as_json=as_json)


def _status(place: SessionDirectory, rig_file: Path | str, rig_text: str) -> tuple[Session, list[Block]]:
    from analysis.apps.session.next_step import next_of
    from analysis.apps.session.session_answer import status_blocks

    kept = place.read()
    if kept is None:
        remedy = f"start a session: {place.command(rig_file)}"
        raise FileError(str(place.file), "this directory has no session", remedy, code="session.missing")
    place.require_intact(kept, rig_text)
    return kept, status_blocks(kept, next_of(kept), place.directory)


def _show(session: Session, blocks: list[Block], *, as_json: bool) -> None:
    from analysis.apps.report.blocks import as_object, say_answer

    if as_json:
        say_json(session.model_dump(mode="json") | {"blocks": as_object(blocks)})
    else:
        say_answer(blocks)


class _Lines:
    """Output of a session: permanent lines, and a progress line that a terminal rewrites.

    aside: the permanent lines go to standard error, because JSON follows on standard output.
    """

    def __init__(self, *, aside: bool) -> None:
        self._shown, self._aside = False, aside

    def say(self, line: str) -> None:
        self.clear()
        pieces = [line]
        if sys.stdout.isatty():
            indent, columns = " " * (len(line) - len(line.lstrip()) + 2), shutil.get_terminal_size().columns
            pieces = textwrap.wrap(
                line, columns, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
            )
        for piece in pieces:
            say(piece, err=self._aside)
        sys.stdout.flush()

    def answer(self, blocks: Sequence[Block]) -> None:
        from analysis.apps.report.blocks import say_answer

        self.clear()
        say_answer(blocks, aside=self._aside)
        sys.stdout.flush()

    def show(self, line: str) -> None:
        if sys.stderr.isatty():
            rewrite_line(line)
            self._shown = True

    def clear(self) -> None:
        if self._shown:
            rewrite_line("")
            self._shown = False
