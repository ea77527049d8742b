"""The arm in the controller, read from a file: factory constants, or poses that the controller itself computed."""

from __future__ import annotations

from pathlib import Path

from scipy.spatial.transform import Rotation

from analysis.intake.imports import poses_of_controller
from analysis.intake.read import read_file
from analysis.intake.table_files import header_names, read_head
from analysis.robot.description.controller_constants import (
    ControllerConstants,
    constants_from_poses,
    data_sheet_of,
    refuse_other_constants,
    robot_with,
)
from analysis.robot.description.linuxcnc_configuration import configured_robot
from analysis.robot.description.rig_section import flange_poses, largest_difference, random_postures, robot_text
from analysis.robot.description.ur_calibration import factory_constants, is_ur_calibration
from analysis.runs.tables import JOINTS, PLACE, TURN, PoseTable, table_from
from rigs.errors import FileError
from rigs.files import read_text
from rigs.load import parse
from rigs.rig import Rig
from rigs.schema.robot import ConstantsSource, LinkConstants, Pose, Robot, constants_hash
from rigs.yaml_text import nodes_of

DATA_SHEET = "data_sheet"
"""Given in place of a file: the controller computes with the data sheet."""
_MOST_BYTES = 10_000_000
_SAME_PINS_MM = 0.001
"""Distance up to which pins are those of the rig file: HAL files have six to ten digits."""


def rig_with_controller(rig: Rig, text: str, source: Path | str) -> tuple[Rig, str, ControllerConstants]:
    """Put the constants of a controller into a rig, and into the text of its file.

    source: as for `read_controller`. The axes of the rig become those of the controller. If the rig has effects, which
    are relative to its axes, the axes stay and `controller_axes` holds the constants.
    """
    read = read_controller(rig.robot, source)
    refuse_other_constants(rig, read, str(source))
    edited = text_with_robot(text, robot_with(rig, read))
    return parse(edited, rig.name).calibrated_as(rig), edited, read


def read_controller(robot: Robot, source: Path | str) -> ControllerConstants:
    """Read the arm in a controller.

    source: `data_sheet`, calibration.conf, the YAML of ur_calibration, the INI file of LinuxCNC, or a table of joint
    angles and flange poses. Raises FileError for another type of arm, and for poses that show but do not determine
    constants of the controller.
    """
    path = Path(source)
    if path.suffix.lower() == ".ini":
        return _from_pins(robot, path)
    robot = data_sheet_of(robot)
    if str(source) == DATA_SHEET:
        words = "the controller computes with the data sheet, as stated"
        return ControllerConstants(robot.axes, "data_sheet", 0.0, words)
    try:
        text = read_text(path, _MOST_BYTES) if path.suffix.lower() not in (".xlsx", ".ods") else ""
    except OSError as error:
        raise FileError.of_os(path, error, "check the path", code="file.unreadable") from None
    if not is_ur_calibration(text) and path.suffix.lower() in (".yaml", ".yml", ".conf"):
        problem = "is empty" if not text.strip() else "is neither calibration.conf nor the YAML of ur_calibration"
        remedy = "give one of them, or a table of joints and flange poses as CSV"
        raise FileError(str(path), problem, remedy, code="controller.invalid")
    if not is_ur_calibration(text):
        return _from_poses(robot, path)
    found = factory_constants(robot, path)
    if found.is_data_sheet:
        words = f"{path}: holds the constants of the data sheet: the controller's own are not in this file"
        return ControllerConstants(robot.axes, "unknown", found.moved_mm, words, found.notes)
    words = f"{path}: the controller's own constants; they move the flange by up to {found.moved_mm:.2f} mm"
    origin = ConstantsSource(file=path.name[:200], serial=found.serial, constants=constants_hash(found.axes))
    return ControllerConstants(found.axes, "constants", found.moved_mm, words, found.notes, origin)


def _from_pins(robot: Robot, path: Path) -> ControllerConstants:
    """Read the pins of LinuxCNC, relative to the axes of a robot: its configuration has no data sheet."""
    read, robot = configured_robot(path), robot.model_copy(update={"base": Pose(), "tool": Pose()})
    if len(robot.axes) != len(read.axes) or robot.coupling != read.coupling or any(a.offset_deg for a in robot.axes):
        problem = "sets pins of genserkins, which cannot express an arm with offset_deg, reversed or coupled axes"
        raise FileError(str(path), problem, f"describe the arm by its pins: --arm {path}", code="controller.invalid")
    pairs = zip(robot.axes, read.axes, strict=True)
    keys = LinkConstants.model_fields
    axes = tuple(axis.model_copy(update={key: getattr(its, key) for key in keys}) for axis, its in pairs)
    q = random_postures(robot)
    moved_mm, _ = largest_difference(flange_poses(robot.model_copy(update={"axes": axes}), q), flange_poses(robot, q))
    words = f"{path}: the pins of genserkins"
    if moved_mm > _SAME_PINS_MM:
        words += f", up to {moved_mm:.2f} mm at the flange from those of the rig file: check that they are of this arm"
    unit, source = read.linear_units, read.controller_source
    return ControllerConstants(axes, "constants", moved_mm, words, source=source, linear_units=unit)


def _from_poses(robot: Robot, path: Path) -> ControllerConstants:
    rig = parse(f"name: arm\n{robot_text(robot)}", robot.name)
    if header_names(read_head(path)) <= {*JOINTS, *PLACE, *TURN}:  # named with units, so a single row is enough
        poses = table_from(read_file(path, "pose", rig).table, "pose", None, str(path))
        assert isinstance(poses, PoseTable)  # noqa: S101 - the table of this test
        R = None if poses.rpy is None else Rotation.from_euler("xyz", poses.rpy).as_matrix()
        return constants_from_poses(robot, poses.q, poses.xyz_mm, R, str(path))
    seen = poses_of_controller([path], rig)
    R = None if seen.turn is None else seen.turn.as_matrix()
    return constants_from_poses(robot, seen.q, seen.xyz_mm, R, str(path))


def text_with_robot(text: str, robot: Robot) -> str:
    """Text of a rig file with another section `robot`. The other sections and their comments are kept."""
    root = nodes_of(text)
    section = next((key, value) for key, value in root.value if key.value == "robot")  # type: ignore[union-attr]
    before, old = text[: section[0].start_mark.index], text[section[0].start_mark.index : section[1].end_mark.index]
    lines = old.splitlines(keepends=True)
    while lines and (not lines[-1].strip() or lines[-1].startswith("#")):
        lines.pop()
    return before + robot_text(robot) + old[len("".join(lines)) :] + text[section[1].end_mark.index :]
