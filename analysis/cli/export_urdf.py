"""`rig export-urdf RIG`: the geometric part of a rig's model as a URDF, or for the driver of Universal Robots."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from analysis.cli.arms import write_section
from analysis.cli.commands import app, command
from analysis.cli.console import say
from analysis.cli.options import RigArgument

if TYPE_CHECKING:
    from analysis.correction.geometric_share import GeometricShare

Reader = Literal["urdf", "ur-driver"]
_MOST_LISTED = 4


@command(app, "rig export-urdf found/cell.yaml -o arm.urdf", name="export-urdf")
def export_urdf(
    rig_file: RigArgument,
    reader: Annotated[
        Reader,
        typer.Option(
            "--for",
            help="Who reads the file: urdf is any program that reads URDF, ur-driver the ROS driver of Universal "
            "Robots, which takes a calibration.yaml.",
        ),
    ] = "urdf",
    calibration_hash: Annotated[
        str | None,
        typer.Option(
            "--hash",
            metavar="CALIB",
            help="Hash of the controller's own calibration, from the file that the driver extracted; default: one "
            "that the driver reports as not the controller's. With --for ur-driver.",
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write, which must not exist; default: the screen.")
    ] = None,
) -> None:
    """Write the arm of a rig file as a URDF, with the joint zeros and link constants that were found.

    Compliance, waves and plays are not geometry: they stay behind, and the command says how much that is.
    """
    from analysis.arms.ur_driver import ur_driver_text
    from analysis.arms.urdf_text import urdf_text
    from analysis.correction.geometric_share import geometric_share
    from analysis.model.predict import geometric_arm, model_of
    from rigs.load import load

    if calibration_hash is not None and reader == "urdf":
        raise typer.BadParameter("a URDF has no hash; add --for ur-driver", param_hint="--hash")
    rig, _ = load(rig_file)
    model = model_of(rig)
    arm, carried = geometric_arm(model), _carried(geometric_share(model))
    if reader == "urdf":
        text = urdf_text(rig.robot, arm, rig_file, [carried])
    else:
        text = ur_driver_text(arm, rig_file, calibration_hash, [carried])
    write_section(text, output)
    say(carried, err=True)
    if rig.robot.rail:
        say("The rail is not in this file: this is the arm where the rail stands at 0.", err=True)
    if reader == "ur-driver":
        _say_of_the_driver(calibration_hash)


def _carried(share: GeometricShare) -> str:
    """What the file has of the model, as a sentence."""
    if share.all_um == 0:
        return "The rig file has no effect that moves the tool: this is the arm as its constants say."
    moved = f"the effects of the rig file move the tool by {share.all_um:.1f} µm rms over its work"
    if not share.left_out:
        return f"All of the model is geometry and is in this file: {moved}."
    names = [f"{effect.effect} {effect.seat}".strip() for effect in share.left_out]
    more = f" and {len(names) - _MOST_LISTED} more" if len(names) > _MOST_LISTED else ""
    listed = ", ".join(names[:_MOST_LISTED]) + more
    return f"Only the geometry is in this file: {moved}; {share.left_um:.1f} µm rms of it are left out ({listed})."


def _say_of_the_driver(calibration_hash: str | None) -> None:
    """Say what calibration.yaml does not hold."""
    say("base and tool of the rig file are not in it: it goes from the controller's base to tool0", err=True)
    if calibration_hash is None:
        what = "the driver will report that the calibration does not match the robot's; --hash takes the robot's own"
        say(what, err=True, mark="note: ")
