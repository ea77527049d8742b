"""`rig arms`: the arm library, and the section of a rig file that each of its arms is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import say, say_json
from analysis.cli.options import AsJson
from rigs.text import plain_lines


@command(app, "rig arms ur10e -o arm.yaml")
def arms(
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", autocompletion=completion.arms, help="An arm; default: the table of all."),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="The arm's own calibration.conf, from the controller of a UR (~/.urcontrol); default: as published."
        ),
    ] = None,
    poses: Annotated[
        Path | None,
        typer.Option(
            help="Joints and flange poses as the controller computed them, 20 or more: its own constants are read out "
            "of them; default: none."
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write the section to; default: the screen.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the arm library, or show one arm as the robot section of a rig file."""
    from analysis.reporting.listings import arm_object, arm_section, arms_table
    from analysis.reporting.plain_console import PlainConsole
    from rigs.arms import arm_names, load_arm

    if name is None:
        if calibration or output or poses:
            raise typer.BadParameter("name the arm", param_hint="NAME")
        library = [load_arm(arm_name) for arm_name in arm_names()]
        if as_json:
            say_json({"arms": [arm_object(entry) for entry in library]})
        else:
            PlainConsole().print(arms_table(library))
        return
    if calibration and poses:
        raise typer.BadParameter("give the calibration of the controller, or poses of it", param_hint="--poses")
    arm = load_arm(name)
    robot, text = arm.robot, arm_section(arm)
    if calibration:
        from analysis.arms.ur_calibration import calibrated

        calibration_of_arm = calibrated(arm, calibration)
        robot, text = calibration_of_arm.section.robot, calibration_of_arm.section.text
        say(f"{calibration} moves the flange by up to {calibration_of_arm.moved_mm:.3f} mm", err=True)
        for doubt in calibration_of_arm.doubts:
            say(doubt, err=True, mark="note: ")
    if poses:
        from analysis.files.controller_constants import controller_constants
        from analysis.files.imports import poses_of_controller
        from rigs.load import parse

        seen = poses_of_controller([poses], parse(f"name: {name}\n{arm.text}", name))
        R = None if seen.turn is None else seen.turn.as_matrix()
        computed = controller_constants(arm, seen.q, seen.xyz_mm, R, str(poses))
        robot, text = computed.robot, computed.text
        say(computed.words, err=True)
    if output or not as_json:
        write_section(text, output)
    if as_json:
        say_json(arm_object(arm) | {"robot": robot.model_dump(mode="json")})


def write_section(text: str, output: Path | None) -> None:
    """Write a section into a new file, or to the screen."""
    from analysis.files.write import holding, write_new

    if output is None:
        typer.echo(plain_lines(text), nl=False)
        return
    write_new(output, holding(text.encode()))
    say(f"wrote {output}", err=True)
