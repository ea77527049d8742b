"""`rig arms`, `rig import-urdf` and `rig export-urdf`: the arm library, and arms as files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import say, say_json
from analysis.cli.options import AsJson, RigArgument
from rigs.schema.vocabulary import Build
from rigs.text import escape_lines

if TYPE_CHECKING:
    from analysis.apps.report.blocks import Block
    from analysis.robot.kinematics.arm import Arm
    from rigs.arms import LibraryArm
    from rigs.rig import Rig


@command(app, "rig arms ur10e -o arm.yaml")
def arms(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME", autocompletion=completion.arms, help="Name of an arm; default: a table of all arms."
        ),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="Constants of this robot: calibration.conf from the controller of a UR (~/.urcontrol), or the YAML of "
            "ur_calibration; default: as published."
        ),
    ] = None,
    poses: Annotated[
        Path | None,
        typer.Option(
            help="Joints and flange poses as the controller computed them, 20 or more, to read the constants of the "
            "controller from them; default: none."
        ),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File for the section; default: the screen.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the arm library, or show one arm as the robot section of a rig file."""
    from analysis.apps.report.blocks import say_answer
    from rigs.arms import arm_names, load_arm

    if name is None:
        if calibration or output or poses:
            raise typer.BadParameter("name the arm", param_hint="NAME")
        library = [load_arm(arm_name) for arm_name in arm_names()]
        if as_json:
            say_json({"arms": [entry.model_dump(mode="json", exclude={"text"}) for entry in library]})
        else:
            say_answer(_table_of(library))
        return
    if calibration and poses:
        raise typer.BadParameter("give either the calibration of the controller or its poses", param_hint="--poses")
    arm = load_arm(name)
    robot, text = arm.robot, _section(arm)
    if source := calibration or poses:
        from analysis.intake.controller_arm import rig_with_controller
        from analysis.robot.description.rig_section import robot_text
        from rigs.load import load

        rig, _, read = rig_with_controller(*load(name), source)
        robot, text = rig.robot, f"# {arm.maker} {arm.model}; {read.words}\n" + robot_text(rig.robot)
        say(read.words, err=True)
        for note in read.notes:
            say(note, err=True, mark="note: ")
    if output or not as_json:
        _write_section(text, output)
    if as_json:
        say_json(arm.model_dump(mode="json", exclude={"text"}) | {"robot": robot.model_dump(mode="json")})


def _write_section(text: str, output: Path | None) -> None:
    from analysis.runs.written_files import holding, write_new

    if output is None:
        typer.echo(escape_lines(text), nl=False)
        return
    write_new(output, holding(text.encode()))
    say(f"wrote {output}", err=True)


def _table_of(arms: Sequence[LibraryArm]) -> list[Block]:
    from analysis.apps.report.blocks import Sentence, Table

    rows = []
    for arm in arms:
        repeatability = f"{arm.repeatability_mm:g} mm" if arm.repeatability_mm else "unknown"
        rows.append((arm.name, f"{arm.maker} {arm.model}", repeatability, "known" if arm.sources.masses else "unknown"))
    counted = f"{len(arms)} arms; rig arms NAME shows the robot section and the sources of an arm"
    return [Table(("name", "arm", "repeatability", "masses"), tuple(rows), frozenset({2})), Sentence(counted)]


def _section(arm: LibraryArm) -> str:
    repeatability = f", repeatability {arm.repeatability_mm:g} mm" if arm.repeatability_mm else ""
    head = [f"{arm.maker} {arm.model}{repeatability}", *([arm.note] if arm.note else []), f"frames: {arm.frames}"]
    head += [f"{key}: {words}" for key, words in arm.sources.model_dump(exclude_defaults=True).items()]
    return "".join(f"# {line}\n" for line in head) + arm.text


@command(app, "rig import-urdf arm.urdf -o arm.yaml", name="import-urdf")
def import_urdf(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="URDF of an arm of 4 to 7 axes, with or without a rail; meshes are not needed."
        ),
    ],
    base: Annotated[
        str | None, typer.Option(help="Link of the base frame; default: the link named base, or the root.")
    ] = None,
    tip: Annotated[
        str | None,
        typer.Option(help="Link of the flange frame; default: the link named tool0, or the only end link."),
    ] = None,
    build: Annotated[
        Build | None,
        typer.Option(help="Construction of the arm, which determines the typical error sizes; default: unknown."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File for the section; default: the screen.")
    ] = None,
) -> None:
    """Convert a URDF to the robot section of a rig file, accurate to 1e-9 mm and rad."""
    from analysis.apps.interchange.urdf import import_urdf as imported

    arm = imported(file, base, tip)
    section = arm.section.with_build(build) if build else arm.section
    _write_section(section.text, output)
    for doubt in arm.doubts:
        say(doubt, err=True, mark="note: ")
    if build is None:
        judged = f"play, zeros and lengths are compared with those typical of {section.robot.design}"
        others = "for hobby servos add --build servo; for strain-wave gears, as in cobots, --build light"
        say(f"the construction of the arm is unknown, so {judged}; {others}", err=True, mark="note: ")
    difference = f"differs from the URDF by at most {section.largest_mm:.0e} mm and {section.largest_rad:.0e} rad"
    say(f"{arm.base} to {arm.tip}: {difference}", err=True)


Reader = Literal["urdf", "xacro", "mjcf", "ur-driver", "franka", "xarm"]


@command(app, "rig export-urdf found/cell.yaml -o arm.urdf", name="export-urdf")
def export_urdf(
    rig_file: RigArgument,
    reader: Annotated[
        Reader,
        typer.Option(
            "--for",
            help="Target program: urdf for all programs that read URDF; xacro for a macro to include in a "
            "description; mjcf for MuJoCo, with the play and compliance of the joints; ur-driver for the "
            "ROS driver of Universal Robots (calibration.yaml); franka and xarm for the descriptions of "
            "these makers (kinematics.yaml).",
        ),
    ] = "urdf",
    calibration_hash: Annotated[
        str | None,
        typer.Option(
            "--hash",
            metavar="CALIB",
            help="Hash of the controller's own calibration, from the file extracted by the driver; default: a "
            "hash that the driver reports as a mismatch. With --for ur-driver.",
        ),
    ] = None,
    friction_of: Annotated[
        Path | None,
        typer.Option(
            "--friction-of",
            metavar="RUN",
            help="Run with motor currents to derive the friction of the joints; default: no friction. With --for mjcf.",
        ),
    ] = None,
    nm_per_a: Annotated[
        str | None,
        typer.Option(
            "--nm-per-a",
            metavar="NUMBERS",
            help="Torque constants of the joints, Nm per ampere of motor current, separated by commas, from "
            "the data sheet; default: none. With --friction-of.",
        ),
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="New output file; default: the screen.")] = None,
) -> None:
    """Write the arm of a rig file for other programs, with the joint zeros and link constants that were found.

    Errors other than geometry are omitted (play as well, except in MJCF), and
    the command reports the size of the omitted errors.
    """
    from analysis.apps.interchange.exported_arm import geometric_share, simulated_arm
    from analysis.robot.predict import geometric_arm, model_of
    from rigs.load import load

    if calibration_hash is not None and reader != "ur-driver":
        problem = "applies only to --for ur-driver: only calibration.yaml has a hash"
        raise typer.BadParameter(problem, param_hint="--hash")
    if friction_of is not None and reader != "mjcf":
        raise typer.BadParameter("applies only to --for mjcf: only MJCF has friction", param_hint="--friction-of")
    if (friction_of is None) != (nm_per_a is None):
        raise typer.BadParameter("give both --friction-of and the torque constants", param_hint="--friction-of")
    rig, _ = load(rig_file)
    model = model_of(rig)
    arm, carried = geometric_arm(model), geometric_share(model).words
    if reader == "mjcf":
        friction = _friction(friction_of, nm_per_a) if friction_of and nm_per_a else {}
        text, carried = simulated_arm(rig, arm, rig_file, carried, friction)
    else:
        text = _description(rig, arm, reader, rig_file, calibration_hash, carried)
    _write_section(text, output)
    say(carried, err=True)
    if reader in ("ur-driver", "franka", "xarm"):
        _say_limits_of_kinematics(rig, is_ur=reader == "ur-driver")
    if reader == "ur-driver" and calibration_hash is None:
        problem = "the driver will report a calibration mismatch"
        say(f"{problem}; set the robot's hash with --hash", err=True, mark="note: ")


def _say_limits_of_kinematics(rig: Rig, *, is_ur: bool) -> None:
    """Say which parts of a rig file the kinematics for a driver omit."""
    if rig.robot.rail:
        say("The rail is not included: the file describes the arm at rail position 0.", err=True)
    covered = "controller's base to tool0" if is_ur else "robot's base to the flange"
    say(f"base and tool of the rig file are not included: the file covers the {covered}", err=True)


def _description(rig: Rig, arm: Arm, reader: Reader, rig_file: str, calibration_hash: str | None, carried: str) -> str:
    if reader == "ur-driver":
        from analysis.apps.interchange.driver_kinematics import ur_driver_text

        return ur_driver_text(arm, rig_file, calibration_hash, [carried])
    if reader in ("urdf", "xacro"):
        from analysis.apps.interchange.urdf_text import urdf_text, xacro_text

        return (urdf_text if reader == "urdf" else xacro_text)(rig.robot, arm, rig_file, [carried])
    from analysis.apps.interchange.driver_kinematics import driver_kinematics

    return driver_kinematics(rig.robot, arm, reader, rig_file, [carried])


def _friction(run: Path, nm_per_a: str) -> dict[int, float]:
    """Friction of the joints in Nm, derived from the motor currents of a run."""
    import analysis
    from analysis.apps.interchange.exported_arm import friction_nm, torques_of
    from rigs.errors import FileError

    torques = torques_of(nm_per_a)
    friction = friction_nm(analysis.load_run(run).condition.friction or {}, torques)
    if not friction:
        problem = "contains no data on friction: motor currents or reversals of a joint are missing"
        raise FileError(str(run), problem, "give a circle run with motor currents", code="readings.unsuitable")
    return friction
