"""`rig emulate RIG`: a cell to try everything on, without hardware."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli import app
from analysis.cli.commands import command
from analysis.cli.console import say
from analysis.cli.options import RigArgument

if TYPE_CHECKING:
    from queue import SimpleQueue

    from analysis.simulation.emulated_robot import EmulatedRobot

TRUTH, MARKS = "truth.json", "out-of-step.txt"
"""Files beside the rig file of an emulated cell, and of a replayed one."""
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
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise of the gauges.")] = 1,
) -> None:
    """Start the gauges and the robot of RIG on ptys and local ports, and serve until stopped.

    Writes rig.yaml, the rig file with these ports in it, for rigd; and
    truth.json, what a perfect measurement would find. Type acw, cw, roll acw,
    roll cw, radial or repeatability to start the robot's program, quit to end;
    show speed_percent 40, and the like, changes what the robot shows of its
    condition, not how it drives.
    """
    import json  # noqa: PLC0415
    import signal  # noqa: PLC0415
    import threading  # noqa: PLC0415
    from queue import SimpleQueue  # noqa: PLC0415

    from analysis.simulation.emulated_robot import PROGRAMS, EmulatedRobot, truth  # noqa: PLC0415
    from daq.emulators import emulated  # noqa: PLC0415
    from daq.store import durable  # noqa: PLC0415
    from rigs.errors import FileError  # noqa: PLC0415
    from rigs.load import load, load_hidden, named_by  # noqa: PLC0415

    rig, text = load(rig_file)
    path = rig_file_of_cell(directory)
    rig = load_hidden(effects).within(rig) if effects else rig
    with named_by(rig_file, rig):
        robot = EmulatedRobot.of_rig(rig, seed)
    cell = emulated(rig, robot, robot.signal, condition=robot.condition)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        durable.replace(directory / TRUTH, (json.dumps(truth(rig, robot.traces), indent=2) + "\n").encode())
        for name, content in rig.beside.items():
            durable.replace(directory / name, content)
        durable.replace(
            path, cell.rig_text(text, emulated=True).encode()
        )  # the last: by the other it is known as an emulated cell's
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "give another --output") from None
    ends: SimpleQueue[int] = SimpleQueue()
    signal.signal(signal.SIGTERM, lambda *_: ends.put(0))
    signal.signal(signal.SIGINT, lambda *_: ends.put(130))
    cell.start()
    try:
        for name, port in cell.ports.items():
            say(f"{name}: {port}")
        say(f"ready; next: rigd {path}; then type here: {', '.join(PROGRAMS)} or quit")
        threading.Thread(target=_obey, args=(robot, ends), daemon=True).start()
        exit_code = ends.get()
    finally:
        sent = cell.stop()
    for name, count in sent.items():
        say(f"{name}: {count} sent")
    raise typer.Exit(exit_code)


def rig_file_of_cell(directory: Path) -> Path:
    """Return where to write the rig file of an emulated or replayed cell, in place of that of an earlier one. Raises
    FileError for any other rig file."""
    from rigs.errors import FileError  # noqa: PLC0415

    path = directory / "rig.yaml"
    if path.exists() and not any((directory / beside).exists() for beside in (TRUTH, MARKS)):
        raise FileError(str(path), "exists already, and is not of an emulated cell", "give another --output")
    return path


def _obey(robot: EmulatedRobot, ends: SimpleQueue[int]) -> None:
    """Lines of standard input start programs, or `show COLUMN VALUE`; `quit`, or a keyboard's end, ends the cell."""
    import sys  # noqa: PLC0415

    from analysis.setup.dialogue import has_keyboard  # noqa: PLC0415
    from rigs.errors import RigError  # noqa: PLC0415

    for program in filter(None, map(str.strip, sys.stdin or ())):  # none where standard input is closed
        if program == "quit":
            break
        try:
            if program.startswith("show "):
                column, _, value = program.removeprefix("show ").strip().partition(" ")
                robot.show(column, value.strip())
                say(f"{column}: {value.strip()}")
                continue
            seconds = robot.start(program)
        except RigError as error:
            say(str(error))
            continue
        say(f"{program}: driving, {seconds:.1f} s")
        robot.finished.wait()
        say(f"{program}: done")
    else:
        if not has_keyboard():
            return  # started without a keyboard: serve until a signal comes
    ends.put(0)
