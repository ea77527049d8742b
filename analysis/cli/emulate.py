"""`rig emulate RIG`: a cell to try everything on, without hardware."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import app


@app.command()
def emulate(
    rig_file: Annotated[str, typer.Argument(metavar="RIG", help="Rig file, or the name of a shipped rig.")],
    directory: Annotated[Path, typer.Option("--output", "-o", help="Where rig.yaml and truth.json go.")] = Path("cell"),
    seed: Annotated[int, typer.Option(help="Of the gauges' noise.")] = 1,
) -> None:
    """Start the gauges and the robot of RIG on ptys and local ports, and serve until stopped.

    Writes rig.yaml, the rig file with these ports in it, for rigd; and truth.json, what a perfect
    measurement would find. Type acw or cw to start the robot's program, quit to end.
    """
    import json  # noqa: PLC0415

    from analysis.emulated import EmulatedRobot, truth  # noqa: PLC0415
    from daq.emulators import Cell  # noqa: PLC0415
    from rigs.errors import FileError  # noqa: PLC0415
    from rigs.load import load  # noqa: PLC0415

    rig, text = load(rig_file)
    robot = EmulatedRobot(rig, seed)
    cell = Cell(rig, robot)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        (directory / "rig.yaml").write_text(cell.rig_text(text), encoding="utf-8")
        (directory / "truth.json").write_text(json.dumps(truth(rig, robot.traces), indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "give another --output") from None
    cell.start()
    for name, port in cell.ports.items():
        typer.echo(f"{name}: {port}")
    typer.echo(f"ready; next: rigd {directory / 'rig.yaml'}; then type here: acw, cw or quit")
    try:
        _obey(robot)
    finally:
        for name, count in cell.stop().items():
            typer.echo(f"{name}: {count} sent")


def _obey(robot: object) -> None:
    """Lines of standard input start programs; its end or a signal ends the cell."""
    import signal  # noqa: PLC0415
    import sys  # noqa: PLC0415
    import threading  # noqa: PLC0415

    from analysis.emulated import EmulatedRobot  # noqa: PLC0415

    assert isinstance(robot, EmulatedRobot)  # noqa: S101
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    signal.signal(signal.SIGINT, lambda *_: ended.set())

    def listen() -> None:
        for line in sys.stdin:
            word = line.strip()
            if word in ("acw", "cw"):
                seconds = robot.start("acw" if word == "acw" else "cw")
                typer.echo(f"{word}: driving, {seconds:.1f} s")
                robot.finished.wait()
                typer.echo(f"{word}: done")
            elif word == "quit":
                break
            elif word:
                typer.echo(f"{word!r} is no program; type acw, cw or quit")
        else:
            if not sys.stdin.isatty():
                return  # started without a keyboard: serve until a signal comes
        ended.set()

    threading.Thread(target=listen, daemon=True).start()
    ended.wait()
