"""`rig export-urdf RIG`: the calibrated arm of a rig's model as what other programs read: URDF, xacro, MJCF, YAML."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from analysis.cli.arms import write_section
from analysis.cli.commands import app, command
from analysis.cli.console import say
from analysis.cli.options import RigArgument

if TYPE_CHECKING:
    from analysis.correction.work import GeometricShare
    from analysis.kinematics.arm import Arm
    from rigs.rig import Rig

Reader = Literal["urdf", "xacro", "mjcf", "ur-driver", "franka", "xarm"]
_MOST_LISTED = 4


@command(app, "rig export-urdf found/cell.yaml -o arm.urdf", name="export-urdf")
def export_urdf(
    rig_file: RigArgument,
    reader: Annotated[
        Reader,
        typer.Option(
            "--for",
            help="Who reads the file: urdf is any program that reads URDF, xacro a description of your own, which "
            "includes a macro, mjcf MuJoCo, with the play of each joint and what it yields under load; ur-driver the "
            "ROS driver of Universal Robots, which takes a calibration.yaml, franka and xarm the descriptions of these "
            "makers, which take a kinematics.yaml.",
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
    friction_of: Annotated[
        Path | None,
        typer.Option(
            "--friction-of",
            metavar="RUN",
            help="Run whose motor currents show the friction of the joints; default: no friction. With --for mjcf.",
        ),
    ] = None,
    nm_per_a: Annotated[
        str | None,
        typer.Option(
            "--nm-per-a",
            metavar="NUMBERS",
            help="Torque at each joint for one ampere of its motor, separated by commas, from the maker's data sheet; "
            "default: none. With --friction-of.",
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write, which must not exist; default: the screen.")
    ] = None,
) -> None:
    """Write the arm of a rig file for other programs, with the joint zeros and link constants that were found.

    What is not geometry stays behind (all but MJCF leave plays, too), and the command says how much that is.
    """
    from analysis.correction.work import geometric_share
    from analysis.model.predict import geometric_arm, model_of
    from rigs.load import load

    if calibration_hash is not None and reader != "ur-driver":
        raise typer.BadParameter("only calibration.yaml has a hash; add --for ur-driver", param_hint="--hash")
    if friction_of is not None and reader != "mjcf":
        raise typer.BadParameter("only MJCF has friction; add --for mjcf", param_hint="--friction-of")
    if (friction_of is None) != (nm_per_a is None):
        raise typer.BadParameter("give the run and the torques for each ampere together", param_hint="--friction-of")
    rig, _ = load(rig_file)
    model = model_of(rig)
    arm, carried = geometric_arm(model), _carried(geometric_share(model))
    if reader == "ur-driver":
        from analysis.arms.ur_driver import ur_driver_text

        text = ur_driver_text(arm, rig_file, calibration_hash, [carried])
    elif reader == "mjcf":
        text, carried = _mjcf(rig, arm, rig_file, carried, friction_of, nm_per_a)
    else:
        text = _geometry(reader, rig, arm, rig_file, carried)
    write_section(text, output)
    say(carried, err=True)
    if rig.robot.rail and reader in ("ur-driver", "franka", "xarm"):
        say("The rail is not in this file: this is the arm where the rail stands at 0.", err=True)
    if reader == "ur-driver":
        _say_of_the_driver(calibration_hash)
    elif reader in ("franka", "xarm"):
        say("base and tool of the rig file are not in it: it goes from the robot's base to its flange", err=True)


def _geometry(reader: Reader, rig: Rig, arm: Arm, where: str, carried: str) -> str:
    """The text of a format that holds the geometry alone."""
    from analysis.arms.driver_kinematics import driver_kinematics
    from analysis.arms.urdf_text import urdf_text
    from analysis.arms.xacro_text import xacro_text

    if reader == "urdf":
        return urdf_text(rig.robot, arm, where, [carried])
    if reader == "xacro":
        return xacro_text(rig.robot, arm, where, [carried])
    return driver_kinematics(rig.robot, arm, reader, where, [carried])


def _mjcf(
    rig: Rig, arm: Arm, where: str, carried: str, friction_of: Path | None, nm_per_a: str | None
) -> tuple[str, str]:
    """The text of MJCF, and what it holds of the model, as sentences."""
    import analysis
    from analysis.arms.mjcf_text import mjcf_text
    from analysis.correction.joint_traits import friction_nm, joint_traits, torques_of
    from rigs.errors import FileError

    friction: dict[int, float] = {}
    if friction_of is not None and nm_per_a is not None:
        torques = torques_of(nm_per_a)
        friction = friction_nm(analysis.load_run(friction_of).condition.friction or {}, torques)
        if not friction:
            problem = "shows no friction: it has no motor currents, or no joint turns back in motion"
            raise FileError(str(friction_of), problem, "give a run of a circle with the currents of the motors")
    traits = joint_traits(rig, friction)
    parts = [
        f"{cause} of axis {', '.join(map(str, sorted(of)))}"
        for cause, of in (
            ("play", traits.play_deg),
            ("deflection under load", traits.compliance_deg_per_nm),
            ("friction", traits.friction_nm),
        )
        if of
    ]
    held = (
        f"In hinges beside the joints' own: {'; '.join(parts)}."
        if parts
        else "Neither play nor deflection under load was found."
    )
    text = mjcf_text(rig.robot, arm, traits, where, [carried, held])
    return text, f"{carried} {held}"


def _carried(share: GeometricShare) -> str:
    """What the file has of the model, as a sentence."""
    if share.all_um == 0:
        return "The rig file has no effect that moves the tool: this is the arm as its constants say."
    moved = f"the effects of the rig file move the tool by {share.all_um:.1f} µm rms over its work"
    if not share.left_out:
        return f"All of the model is geometry and is in this file: {moved}."
    names = [f"{effect.effect} {effect.seat}".strip() for effect in share.left_out]
    ending = f" and {len(names) - _MOST_LISTED} more" if len(names) > _MOST_LISTED else ""
    listed = ", ".join(names[:_MOST_LISTED]) + ending
    return f"Only the geometry is in this file: {moved}; {share.left_um:.1f} µm rms of it are left out ({listed})."


def _say_of_the_driver(calibration_hash: str | None) -> None:
    """Say what calibration.yaml does not hold."""
    say("base and tool of the rig file are not in it: it goes from the controller's base to tool0", err=True)
    if calibration_hash is None:
        remark = "the driver will report that the calibration does not match the robot's; --hash takes the robot's own"
        say(remark, err=True, mark="note: ")
