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
    from analysis.kinematics.arm import Arm
    from rigs.rig import Rig

Reader = Literal["urdf", "xacro", "mjcf", "ur-driver", "franka", "xarm"]


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
    from analysis.correction.exported_arm import geometric_share, simulated_arm
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
    arm, carried = geometric_arm(model), geometric_share(model).words
    if reader == "ur-driver":
        from analysis.arms.driver_kinematics import ur_driver_text

        text = ur_driver_text(arm, rig_file, calibration_hash, [carried])
    elif reader == "mjcf":
        friction = _friction(friction_of, nm_per_a) if friction_of and nm_per_a else {}
        text, carried = simulated_arm(rig, arm, rig_file, carried, friction)
    else:
        text = _geometry(reader, rig, arm, rig_file, carried)
    write_section(text, output)
    say(carried, err=True)
    if rig.robot.rail and reader in ("ur-driver", "franka", "xarm"):
        say("The rail is not in this file: this is the arm where the rail stands at 0.", err=True)
    if reader in ("franka", "xarm"):
        say("base and tool of the rig file are not in it: it goes from the robot's base to its flange", err=True)
    if reader == "ur-driver":
        say("base and tool of the rig file are not in it: it goes from the controller's base to tool0", err=True)
        if calibration_hash is None:
            problem = "the driver will report that the calibration does not match the robot's"
            say(f"{problem}; --hash takes the robot's own", err=True, mark="note: ")


def _geometry(reader: Reader, rig: Rig, arm: Arm, where: str, carried: str) -> str:
    """The text of a format that holds the geometry alone."""
    from analysis.arms.driver_kinematics import driver_kinematics
    from analysis.arms.urdf_text import urdf_text, xacro_text

    if reader == "urdf":
        return urdf_text(rig.robot, arm, where, [carried])
    if reader == "xacro":
        return xacro_text(rig.robot, arm, where, [carried])
    return driver_kinematics(rig.robot, arm, reader, where, [carried])


def _friction(run: Path, nm_per_a: str) -> dict[int, float]:
    """The friction of the joints in Nm that the motor currents of a run show. Raises FileError where they show none."""
    import analysis
    from analysis.correction.exported_arm import friction_nm, torques_of
    from rigs.errors import FileError

    torques = torques_of(nm_per_a)
    friction = friction_nm(analysis.load_run(run).condition.friction or {}, torques)
    if not friction:
        problem = "shows no friction: it has no motor currents, or no joint turns back in motion"
        raise FileError(str(run), problem, "give a run of a circle with the currents of the motors")
    return friction
