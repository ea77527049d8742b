from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say, say_written
from analysis.cli.options import RigArgument
from rigs.yaml_text import flow

_PAIR = 2


@command(app, "rig parts cell.yaml -o parts")
def parts(
    rig_file: RigArgument,
    directory: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Output directory; default: none if only --over-balls-mm is given."),
    ] = None,
    ball_mm: Annotated[float, typer.Option("--ball-mm", min=8, max=60, help="Diameter of the steel balls.")] = 20.0,
    magnet_mm: Annotated[
        str,
        typer.Option("--magnet-mm", metavar="D,H", help="Diameter and height of the magnets, separated by a comma."),
    ] = "10,5",
    screw: Annotated[str, typer.Option(help="Countersunk screw of a socket: M3, M4 or M5.")] = "M4",
    over_balls_mm: Annotated[
        float | None,
        typer.Option(
            "--over-balls-mm",
            min=10,
            max=3000,
            help="Caliper reading over two balls on the bar, or on any two sockets, to print the line for the "
            "rig file; default: not measured.",
        ),
    ] = None,
    u_mm: Annotated[
        float, typer.Option("--u-mm", min=0.0001, max=10, help="Standard uncertainty of that reading.")
    ] = 0.02,
) -> None:
    """Write the parts of touches and of the link as STL, with a drawing and a list of what to buy."""
    from analysis.apps.parts.sheet import drawing, sheet
    from analysis.apps.parts.sizes import Bought, parts_of, remarks_of
    from analysis.runs.written_files import holding, write_all_new
    from rigs.load import load

    rig, _ = load(rig_file)
    bought = Bought(ball_mm, _pair(magnet_mm), screw.upper())
    if over_balls_mm is not None:
        apart_mm = over_balls_mm - ball_mm
        if apart_mm <= 0:
            raise typer.BadParameter("must be greater than the ball diameter", param_hint="--over-balls-mm")
        sockets = rig.tests.touch.sockets if rig.tests.touch else ()
        first, second = sockets[:_PAIR] if len(sockets) >= _PAIR else ("A", "B")
        say(f"distances: {flow([{'between': [first, second], 'distance_mm': round(apart_mm, 5), 'u_mm': u_mm}])}")
        say("next: add this line under tests: touch: in the rig file, with the names of the sockets", err=True)
    if directory is None:
        if over_balls_mm is None:
            raise typer.BadParameter("give the output directory", param_hint="--output")
        return
    printed, remarks = parts_of(rig, bought), remarks_of(rig, bought)
    files = {f"{part.name}.stl": part.solid.stl() for part in printed}
    files["parts.svg"] = drawing(printed, f"{rig.name}: parts to print, mm").encode()
    files["parts.md"] = sheet(printed, bought, rig.name, remarks).encode()
    paths = write_all_new(directory, {name: holding(content) for name, content in files.items()})
    for remark in remarks:
        say(remark, err=True, mark="note: ")
    say_written(paths)
    say("next: print the parts, and measure over both balls of the bar as described in parts.md", err=True)


def _pair(written: str) -> tuple[float, float]:
    try:
        first, second = (float(word) for word in written.split(","))
    except ValueError:
        raise typer.BadParameter("write diameter and height, such as 10,5", param_hint="--magnet-mm") from None
    if not (1 <= first <= 50 and 0.5 <= second <= 50):
        raise typer.BadParameter(
            "is not a valid magnet size in mm; write a size such as 10,5", param_hint="--magnet-mm"
        )
    return first, second
