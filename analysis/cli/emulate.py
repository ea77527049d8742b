"""`rig emulate RIG`: a cell to try everything on, without hardware."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say
from analysis.cli.options import RigArgument, maker_option
from rigs.schema.vocabulary import MakerName

if TYPE_CHECKING:
    from daq.service.trust import InstanceLock

MARKS = "out-of-step.txt"
"""A file beside the rig file of a replayed cell."""
HiddenEffects = Annotated[
    str | None,
    typer.Option(
        "--effects",
        metavar="FILE",
        help="YAML file of hidden effects, or the name of a shipped rig; default: the effects of RIG.",
    ),
]


@command(app, "rig emulate ur10e -o cell")
def emulate(
    rig_file: RigArgument,
    directory: Annotated[Path, typer.Option("--output", "-o", help="Directory for rig.yaml and truth.json.")] = Path(
        "cell"
    ),
    effects: HiddenEffects = None,
    programs: Annotated[
        Path | None,
        typer.Option(help="Directory of robot programs that the robot drives by name; default: none."),
    ] = None,
    maker: Annotated[
        MakerName | None,
        maker_option(
            "Maker of the controller that drives --programs",
            "that of the robot feedback, else of the first program",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise of the gauges.")] = 1,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print each line as a JSON object: event, name, text.")
    ] = False,
) -> None:
    """Start the gauges and the robot of RIG on ptys and local ports, and serve until stopped.

    Writes rig.yaml, the rig file with these ports in it, for rigd; and
    truth.json, what a perfect measurement would find. Type acw, cw, roll acw,
    roll cw, radial or repeatability to start a program of its own, run NAME to
    start one of --programs; stop, pause and go on, as a person at the robot;
    enter FILE to enter what rig correct wrote into its controller; quit to
    end. show speed_percent 40, and the like, changes what the robot shows of
    its condition, not how it drives.
    """
    import signal
    from queue import SimpleQueue

    from analysis.emulation.keyboard import CellEvent, Keyboard
    from analysis.emulation.pendant import Pendant
    from analysis.setup.dialogue import has_keyboard
    from analysis.simulation.emulated_robot import PROGRAMS, EmulatedRobot, write_cell_files
    from daq.emulators import emulated
    from rigs.errors import FileError, UseError
    from rigs.load import load, load_hidden, named_by
    from rigs.signals import end_from

    if maker and programs is None:
        raise UseError("--for", "is for the controller that drives --programs", "give --programs as well")
    if programs is not None and not programs.is_dir():
        raise FileError(str(programs), "is no directory", "give the directory that holds the programs")
    rig, text = load(rig_file)
    path = rig_file_of_cell(directory)
    rig = load_hidden(effects).within(rig) if effects else rig
    with named_by(rig_file, rig):
        robot = EmulatedRobot.of_rig(rig, seed)
    cell = emulated(rig, robot, robot.signal, condition=robot.condition)
    lock = locked_cell(directory)
    write_cell_files(directory, rig, robot, cell.rig_text(text, emulated=True))

    def report(event: CellEvent) -> None:
        say(event.as_line if as_json else event.text)

    ends: SimpleQueue[int] = SimpleQueue()
    signal.signal(signal.SIGTERM, lambda *_: ends.put(0))
    signal.signal(signal.SIGINT, lambda *_: ends.put(130))
    cell.start()
    try:
        for name, port in cell.ports.items():
            report(CellEvent("port", name, f"{name}: {port}"))
        programs_known = ", ".join(["run NAME"] if programs else PROGRAMS)
        next_line = f"ready; next: rigd {path}; then type here: {programs_known} or quit"
        report(CellEvent("ready", str(path), next_line))
        keyboard = Keyboard(robot, Pendant(rig, programs, maker) if programs else None, ends.put, report)
        keyboard.start()
        keyboard.read(has_person=has_keyboard())
        exit_code = end_from(ends)
    finally:
        sent = cell.stop()
        lock.release()
    for name, count in sent.items():
        report(CellEvent("sent", name, f"{name}: {count} sent"))
    raise typer.Exit(exit_code)


def locked_cell(directory: Path) -> InstanceLock:
    """Make the directory of an emulated or replayed cell, and lock it. Raises FileError where it cannot be made, and
    CellError where another cell is served in it."""
    from daq.service.trust import InstanceLock
    from rigs.errors import FileError

    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "give another --output") from None
    return InstanceLock.take_cell(directory)


def rig_file_of_cell(directory: Path) -> Path:
    """Return where to write the rig file of an emulated or replayed cell, in place of that of an earlier one. Raises
    FileError for any other rig file."""
    from analysis.simulation.emulated_robot import RIG, TRUTH
    from rigs.errors import FileError

    path = directory / RIG
    if path.exists() and not any((directory / file).exists() for file in (TRUTH, MARKS)):
        raise FileError(str(path), "exists already, and is not of an emulated cell", "give another --output")
    return path
