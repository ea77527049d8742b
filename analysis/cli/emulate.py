"""`rig emulate RIG`: a cell to try everything on, without hardware."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say
from analysis.cli.options import RigArgument, maker_option
from rigs.schema.vocabulary import MakerName

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
    from analysis.emulation.served_cell import EmulatedCell
    from analysis.setup.dialogue import has_keyboard

    cell = EmulatedCell(rig_file, effects, programs, maker, seed)
    exit_code = cell.serve(
        directory, lambda event: say(event.as_line if as_json else event.text), has_person=has_keyboard()
    )
    raise typer.Exit(exit_code)
