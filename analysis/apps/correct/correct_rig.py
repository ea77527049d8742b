"""All corrections of a rig: zeros, link constants, targets of a path, and programs of the user."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analysis.apps.correct.controller_entries import ControllerEntries, as_entered, controller_entries
from analysis.apps.correct.corrected_constants import Correction, joint_zeros, link_constants
from analysis.apps.correct.corrected_program import CorrectedProgram, Programs, correct_program
from analysis.apps.correct.stated_points import computed_points
from analysis.apps.correct.work_area import WorkArea
from analysis.apps.makers import maker_by
from analysis.apps.makers.reading import programs_at
from analysis.apps.programs.target_path import TargetPath, read_path, refuse_corrected_path
from analysis.correction.corrected_targets import CorrectedTargets, WorkError, corrected
from analysis.correction.pose_uncertainty import covered
from analysis.correction.reasons import how_to_state_controller
from analysis.correction.support import Support, supports, supports_of_usual_size
from analysis.correction.table_postures import (
    HOW_TO_STATE,
    StatedPosture,
    TablePostures,
    disagreeing,
    find_postures,
)
from analysis.correction.work import (
    rest_mm,
    tool_places,
)
from analysis.robot.kinematics.arm import controller_arm, forward
from analysis.robot.predict import model_of
from rigs.errors import FileError, RigPlace, UseError
from rigs.rig import Rig
from rigs.schema.vocabulary import DRIVEN_AXES, MakerName

NO_PROGRAMS = Programs()


@dataclass(frozen=True)
class Corrections:
    """The possible corrections of a rig. If the constants of the controller are unknown, nothing is to be entered."""

    rig: Rig
    effects: tuple[Support, ...]
    """With their use."""
    zeros: tuple[Correction, ...]
    constants: tuple[Correction, ...]
    work: WorkError
    """Error over the work area."""
    path: tuple[Path, TargetPath, CorrectedTargets] | None
    """A table of targets with the corrected targets, for a controller with the entries if `entered`."""
    at_controller: ControllerEntries | None = None
    entered: bool = False
    programs: tuple[CorrectedProgram, ...] = ()
    calibrated: tuple[Support, ...] = ()
    """Effects that exist only in the calibration; zeros and constants include them."""
    postures: TablePostures | None = None
    """Postures of a path of poses."""

    @property
    def errors(self) -> dict[Path, WorkError | None]:
        """Error at the covered targets of the path and of each written program that a model corrects; None if no target
        is covered."""
        written = [program for program in self.programs if program.names and not program.held]
        programs = {program.path: program.error for program in written if program.judged}
        return ({self.path[0]: self.path[2].error} if self.path else {}) | programs

    @property
    def in_vain(self) -> dict[Path, str]:
        """Paths and programs without a certain gain, each with the reason."""
        nothing = "corrected targets do not reduce the error there"
        certain = {program.path for program in self.programs if program.gains}
        if self.path and (error := self.path[2].error) and error.gains:
            certain.add(self.path[0])
        idle = {path: error for path, error in self.errors.items() if path not in certain}
        return {path: nothing if error else self._why_unknown(path) for path, error in idle.items()}

    @property
    def corrects_computed(self) -> bool:
        """False if all corrected points were taught: then zeros and constants would move the tool off its places."""
        groups = [group.origin for program in self.programs for group in program.judged]
        return self.path is not None or not groups or any(origin.kind == "computed" for origin in groups)

    @property
    def uses_model(self) -> bool:
        """False if programs are only converted or left as they are, which the model of the arm does not affect."""
        return bool(self.path or not self.programs or any(program.judged for program in self.programs))

    def _why_unknown(self, path: Path) -> str:
        """Why the uncertainty of all targets of a path or program is unknown, with the first reason."""
        reasons = {program.path: program.unknown for program in self.programs}
        reasons |= {self.path[0]: self.path[2].unknown} if self.path else {}
        first = next(filter(None, reasons[path]), "")
        return "the uncertainty of the targets is unknown" + f": {first}" * bool(first)

    def without(self, dropped: Container[Path]) -> Corrections:
        path = None if self.path and self.path[0] in dropped else self.path
        return replace(self, path=path, programs=tuple(each for each in self.programs if each.path not in dropped))


def correct_rig(
    rig: Rig,
    path: Path | None,
    controller: MakerName | None = None,
    scale: Sequence[float] | None = None,
    *,
    entered: bool = False,
    programs: Programs = NO_PROGRAMS,
    posture: StatedPosture | None = None,
) -> Corrections:
    """Compute the corrections of a rig.

    controller: maker of the programs or, without programs, of the controller for which entries are computed: both
    together would correct twice. scale (6,): counts per degree or gear ratios of the axes. entered: the controller
    already has the entries, and the targets are computed accordingly. posture: that of a path of poses.

    Raises FileError for a rig without effects, and for a path or program that cannot be read or corrected. Raises
    UseError for options that exclude each other.
    """
    points = programs.points or computed_points(rig)
    by_model = bool(path or not programs.paths or points.uses_model)
    if by_model and not model_of(rig).effects:
        remedy = "diagnose or calibrate the arm, and give the written rig file"
        raise FileError(RigPlace.of(rig.name), "has no effects to correct", remedy, code="calibration.missing")
    arm = "an arm on a rail" if rig.robot.rail else f"{len(rig.robot.axes)} axes"
    if not rig.takes_programs and (controller or programs.paths):
        problem = f"{arm}: controller entries and programs are supported only for arms of six axes without a rail"
        raise UseError("--for, --program", problem, "give joint targets with --path", code="arm.invalid")
    if entered and programs.paths:
        problem = "applies to --path; --program is for a controller without entries"
        raise UseError("--entered", problem, "give one of them", code="usage")
    if entered and not (path and controller):
        problem = "needs --path, and a maker from --for or the feedback"
        raise UseError("--entered", problem, "give both", code="usage")
    if entered and rig.controller == "unknown":
        problem = "the constants of the controller are unknown, so no values for it were computed"
        raise FileError(RigPlace.of(rig.name), problem, how_to_state_controller(rig), code="controller.invalid")
    supported, of_model = supports(rig), tuple(supports_of_usual_size(rig))
    area = WorkArea(rig, supported)
    entries, zeros, constants = None, list[Correction](), list[Correction]()
    if (points.are_computed or not programs.paths) and rig.controller != "unknown":
        zeros, constants = joint_zeros(rig, [*supported, *of_model]), link_constants(rig, [*supported, *of_model])
        if controller and not programs.paths:
            entries = controller_entries(area, controller, scale)
    postures, targets = None, None
    if path:
        read = _read(rig, path)
        if read.joints and posture and posture.source != "rig_file" and not programs.paths:
            problem, remedy = f"{path.name} has joint angles, which determine the posture", "remove the option"
            raise UseError(posture.source, problem, remedy)
        postures = None if read.joints else find_postures(rig, read.poses(), posture)
        targets = _targets(rig, supported, path, read, postures)
        targets = (*targets[:2], as_entered(rig, targets[2], entries)) if entered and entries else targets
    paths = [program for path in programs.paths for program in programs_at(path)]
    given, maker = programs, controller or rig.maker
    for unread in () if programs.again else paths:
        points.refuse_repeated(unread)
    done = tuple(
        correct_program(points, program, given.frames, scale, whole=given.whole, postures=given.postures)
        for program in paths
    )
    points.refuse_unmatched([point for program in done for point in program.points])
    if maker and (other := next((program for program in done if program.maker != maker), None)):
        of, robot = (maker_by(name).controller.maker for name in (other.maker, maker))
        whose = "the robot of the rig file has" if maker == rig.maker else "--for gives"
        remedy = f"give a program of this robot, or --for {other.maker} if such a controller is used"
        problem = f"is a program for {of}, but {whose} {robot}"
        raise FileError(str(other.path), problem, remedy, code="robot.other")
    work, numbers = _work(area), (tuple(zeros), tuple(constants))
    return Corrections(rig, tuple(supported), *numbers, work, targets, entries, entered, done, of_model, postures)


def _work(area: WorkArea) -> WorkError:
    stays_mm = np.linalg.norm(area.left_out_mm, axis=1)
    is_at, nominal = tool_places(area.rig, area.used, area.q), forward(controller_arm(area.rig.robot), area.q)
    off_mm, taught_mm = np.linalg.norm(is_at - nominal[:, :3, 3], axis=1), rest_mm(is_at, nominal)
    return WorkError.of(np.array([off_mm, taught_mm, *area.u_mm, stays_mm]), covered(area.uncertainty, area.q))


def _read(rig: Rig, path: Path) -> TargetPath:
    """Read a path. Raises FileError for an invalid one, and for poses that do not determine joint angles."""
    axes = len(rig.robot.axes)
    read = read_path(path, axes, rail=rig.robot.rail is not None)
    if rig.robot.rail and not read.joints:
        problem = "has poses but no joint angles, so the rail position is unknown"
        raise FileError(str(path), problem, f"give q1_deg … q{axes}_deg and e1_mm", code="table.invalid")
    if axes != DRIVEN_AXES and not read.joints:
        free = f"do not determine the elbow of an arm of {axes} axes"
        few = f"an arm of {axes} axes cannot reach exactly: its tool has only {axes - 3} rotational degrees of freedom"
        problem = f"has poses, which {free if axes > DRIVEN_AXES else few}"
        raise FileError(str(path), problem, f"give joint angles q1_deg … q{axes}_deg", code="table.invalid")
    refuse_corrected_path(read, str(path))
    return read


def _targets(
    rig: Rig, supported: Sequence[Support], path: Path, read: TargetPath, postures: TablePostures | None
) -> tuple[Path, TargetPath, CorrectedTargets]:
    """Correct a path. Raises FileError if no target can be corrected."""
    if postures is None:
        targets = corrected(rig, supported, read.angles())
    else:
        poses = read.poses()
        unsolved = [*postures.unsolved, *disagreeing(rig, supported, postures, poses)]
        targets = corrected(rig, supported, postures.q, unsolved, poses)
    if not targets.done.any():
        raise target_errors(rig, path, read, targets)[0]
    return path, read, targets


def target_errors(rig: Rig, path: Path, path_read: TargetPath, targets: CorrectedTargets) -> list[FileError]:
    remedies = {"controller_unknown": how_to_state_controller(rig), "ambiguous": HOW_TO_STATE}
    return [
        FileError(
            f"{path}, line {path_read.lines[target.place]}",
            target.what,
            remedies.get(target.reason, "move the target"),
            code="program.unclear",
        )
        for target in targets.left
    ]
