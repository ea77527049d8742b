"""`rig import-urdf FILE`: an arm of a URDF as the section of a rig file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli.arms import write_section
from analysis.cli.commands import app, command
from analysis.cli.console import say


@command(app, "rig import-urdf arm.urdf -o arm.yaml", name="import-urdf")
def import_urdf(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="URDF of an arm of 4 to 7 axes, on a rail or not; no meshes are needed."),
    ],
    base: Annotated[
        str | None, typer.Option(help="Link that is the base frame; default: the link named base, or the root.")
    ] = None,
    tip: Annotated[
        str | None,
        typer.Option(help="Link that is the flange frame; default: the link named tool0, or the only end."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write the section to; default: the screen.")
    ] = None,
) -> None:
    """Turn a URDF into the robot section of a rig file, equal to it within 1e-9 mm and rad."""
    from analysis.arms.urdf import import_urdf as imported

    arm = imported(file, base, tip)
    section = arm.section
    write_section(section.text, output)
    for doubt in arm.doubts:
        say(doubt, err=True, mark="note: ")
    difference = f"differs from the URDF by at most {section.largest_mm:.0e} mm and {section.largest_rad:.0e} rad"
    say(f"{arm.base} to {arm.tip}: {difference}", err=True)
