"""`rig plan RIG`: detectable effects, further circles (--propose), poses for a tracker (--poses), the next reading."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say, say_json, say_written
from analysis.cli.options import AsJson, RigArgument, maker_option
from rigs.errors import FileError, UseError
from rigs.schema.vocabulary import MakerName
from rigs.text import as_argument, numbers_in

if TYPE_CHECKING:
    from analysis.apps.planning.pose_plan import PlannedPoses
    from analysis.apps.planning.pose_pool import Sight
    from analysis.robot.kinematics.arm import Array
    from rigs.rig import Rig


ToolAxis = Literal["x", "y", "z", "-x", "-y", "-z"]
_MINUTES = 60.0


@command(app, "rig plan cell.yaml --propose --minutes 60 -o circles")
def plan(
    rig_file: RigArgument,
    tests: Annotated[
        str | None,
        typer.Option(
            help="Tests, by commas: yaw, roll, radial, repeatability, touch; default: those set up in the rig file."
        ),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, max=1000, help="Number of runs per test, for circles per direction.")] = 3,
    level: Annotated[
        float,
        typer.Option(
            min=0.01,
            max=10,
            help="Size of all other errors of the arm, 1 is usual: the level of a diagnosis.",
        ),
    ] = 1.0,
    propose: Annotated[
        bool, typer.Option("--propose", help="Propose circles that make further effects detectable.")
    ] = False,
    minutes: Annotated[
        float | None,
        typer.Option(
            min=1,
            max=10_000,
            help=f"With --propose: time for the proposed circles, including set-up; default: {_MINUTES:g}.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="With --propose: directory for the rig files of the circles; default: none."
        ),
    ] = None,
    poses: Annotated[
        int | None,
        typer.Option(
            min=6, max=300, help="Number of poses for a tracker to plan instead; -o writes them; default: none."
        ),
    ] = None,
    next_reading: Annotated[
        bool,
        typer.Option("--next", help="Propose the next pose, touch or circle, or state that it is not worth its time."),
    ] = False,
    targets: Annotated[
        Path | None,
        typer.Option(help="With --next: CSV of targets, as for rig correct --path; default: the work area."),
    ] = None,
    maker: Annotated[
        MakerName | None,
        maker_option("With --poses: maker of the controller for the program", "none"),
    ] = None,
    tracker: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="With --poses: position of the tracker, mm in the robot's base; default: all poses are visible.",
        ),
    ] = None,
    faces: Annotated[
        ToolAxis | None,
        typer.Option(help="With --poses: viewing axis of the target in the tool; default: visible from everywhere."),
    ] = None,
    dwell_s: Annotated[float, typer.Option(min=0.5, max=600, help="With --poses: seconds at rest at each pose.")] = 5.0,
    one_axis: Annotated[
        bool,
        typer.Option("--one-axis", help="With --poses: move one axis at a time, down, up and back."),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Report which effects the tests can detect and distinguish, from which size on, and which test adds the most.

    With --poses, plan the poses for a tracker that determine the arm best over
    the workspace. All poses are visible to the tracker and clear of floor and
    column.
    """
    of_tests = tests or propose or minutes
    if targets and not next_reading:
        raise UseError("--targets", "is allowed only with --next", "add --next")
    if next_reading and (poses or of_tests):
        problem = "cannot be combined with --poses, --tests, --propose or --minutes"
        raise typer.BadParameter(problem, param_hint="--next")
    if poses and of_tests:
        raise typer.BadParameter("cannot be combined with --tests, --propose or --minutes", param_hint="--poses")
    if next_reading:
        _say_next_reading(rig_file, targets, _sight(tracker, faces), as_json=as_json)
    elif poses:
        sight = _sight(tracker, faces)
        _plan_poses(rig_file, poses, output, maker, sight, dwell_s, one_axis=one_axis, as_json=as_json)
    elif maker or tracker or faces or one_axis:
        raise typer.BadParameter("--for, --tracker, --faces and --one-axis require --poses", param_hint="--poses")
    elif propose:
        _propose(rig_file, tests, runs, minutes or _MINUTES, output, as_json=as_json)
    else:
        for option, value in (("--output", output), ("--minutes", minutes)):
            if value is not None:
                raise UseError(option, "is allowed only with --propose", "add --propose")
        _plan_tests(rig_file, tests, runs, level, as_json=as_json)


def _plan_tests(rig_file: str, tests: str | None, runs: int, level: float, *, as_json: bool) -> None:
    from analysis.apps.planning import plan_report
    from analysis.apps.planning.capability import plan, tests_named
    from analysis.apps.report.blocks import say_answer
    from analysis.cli.console import progress_of
    from rigs.load import load, named_by

    rig, _ = load(rig_file)
    with named_by(rig_file, rig), progress_of("simulating the tests"):
        planned = plan(rig, tests_named(rig, tests), runs, level)
    if as_json:
        say_json(plan_report.as_object(planned))
    else:
        say_answer(plan_report.plan_answer(planned))


def _propose(
    rig_file: str, tests: str | None, runs: int, minutes: float, output: Path | None, *, as_json: bool
) -> None:
    from analysis.apps.planning import plan_report
    from analysis.apps.planning.capability import tests_named
    from analysis.apps.planning.proposal import propose
    from analysis.apps.report.blocks import say_answer
    from analysis.cli.console import progress_of
    from rigs.load import load, named_by

    rig, text = load(rig_file)
    with named_by(rig_file, rig):
        named = tests_named(rig, tests)
        if output:
            plan_report.refuse_earlier_proposal(rig, output)
        with progress_of() as progress:
            proposal = propose(rig, named, runs, minutes, progress)
    written = plan_report.write(proposal, text, output) if output else []
    if as_json:
        say_json(plan_report.proposal_object(proposal, written))
    else:
        say_answer(plan_report.proposal_answer(proposal))
    say_written(written)
    if written:
        maker, *further = rig.makers
        others = f"  # or {', '.join(further)}" if further else ""
        file = as_argument(written[0])
        say(f"next: rig program {file} --for {maker} --test yaw -o programs{others}", err=True)
    elif proposal.circles:
        say(f"next: {shlex.join(['rig', *sys.argv[1:]])} -o circles  # a rig file for each circle", err=True)


def _plan_poses(
    rig_file: str,
    count: int,
    output: Path | None,
    maker: MakerName | None,
    sight: Sight | None,
    dwell_s: float,
    *,
    one_axis: bool,
    as_json: bool,
) -> None:
    from analysis.apps.planning.pose_plan import planned_poses
    from analysis.cli.console import progress_of
    from rigs.load import load, named_by

    if maker and not output:
        raise UseError("--for", "needs an output directory", "add -o DIR")
    rig, _ = load(rig_file)
    with named_by(rig_file, rig), progress_of("looking for poses"):
        planned = planned_poses(rig, count, sight, one_axis=one_axis)
    written = _write(rig, planned, output, maker, dwell_s) if output else []
    if as_json:
        say_json({**planned.to_dict(), "files": [str(path) for path in written]})
        return
    for line in planned.lines():
        say(line)
    say_written(written)
    if written:
        way = "run the program at reduced speed, measure a row at each pose in order, and import the rows:"
        say(f"next: {way}", err=True)
        say(f"  rig import TRACKER.csv {written[0]} --join rows --rig {rig_file} --test pose -o runs/poses", err=True)


def _say_next_reading(rig_file: str, targets: Path | None, sight: Sight | None, *, as_json: bool) -> None:
    from analysis.apps.planning.next_reading import next_step
    from analysis.cli.console import progress_of
    from analysis.correction.support import why_nothing
    from rigs.families import families
    from rigs.load import load, named_by

    rig, _ = load(rig_file)
    with named_by(rig_file, rig), progress_of("weighing the next reading"):
        step = next_step(rig, _targets_of(rig, targets) if targets else None, sight)
    if as_json:
        say_json(step.to_dict())
        return
    if why := why_nothing(rig):
        say(f"{why[0].upper()}{why[1:]}.")
    error = f"The error {'at the targets' if targets else 'over the work area'} is"
    if step.now_mm is not None and step.now_mm < step.corrected_mm:
        say(f"{error} hardly known: {step.now_mm:.3f} mm rms with u = {step.corrected_mm:.3f} mm.")
    elif step.now_mm is not None:
        after = f"{step.corrected_mm:.3f} mm after a correction by the readings so far"
        say(f"{error} {step.now_mm:.3f} mm rms now, and {after}.")
    elif rig.calibrated is None or why:
        say(f"{error} unknown; of a typical arm it is {step.corrected_mm:.3f} mm rms.")
    else:
        say(f"{error} unknown, because it lies outside the measured region.")
    say(step.words)
    if step.now_mm is not None and not step.is_validated:
        say("No left-out reading validated the calibration, so the real error may be larger.")
    if step.now_mm is not None and step.of_family >= _SHOWN_OF_FAMILY:
        family = next((one for one in families().families if one.maker == rig.maker), None)
        arms = f"{max(row.arms for row in family.constants)} arms of {family.name}" if family else "arms of its design"
        say(f"{step.of_family:.0%} of the mean square error is not known from readings: typical sizes of {arms}.")


def _targets_of(rig: Rig, path: Path) -> tuple[Array, Array]:
    """Postures (n, axes) rad and poses (n, 4, 4) of the reachable targets of a table; the others are reported."""
    import numpy as np

    from analysis.apps.programs.target_path import read_targets
    from analysis.correction.table_postures import find_postures, stated_posture

    read, poses, q = read_targets(path, rig)
    if q is not None:
        return q, poses
    postures = find_postures(rig, poses, stated_posture(rig, None, None))
    q, left = postures.q, postures.unsolved
    if len(left) == len(q):
        problem, remedy = f"none of the targets is usable: the first {left[0].what}", "give targets within reach"
        if left[0].reason == "controller_unknown":
            remedy = "give joint angles, or repeat the calibration with --calibration FILE (data_sheet if it has none)"
        raise FileError(str(path), problem, remedy, code="path.impossible")
    for target in left:
        say(f"{path}, line {read.lines[target.place]}: {target.what}; left out", err=True, mark="note: ")
    if postures.several:
        count = f"{len(postures.several)} of {len(q)} poses can be reached in several postures"
        chosen = "the one closest to the tests of the rig file is used"
        say(f"{path}: {count}, and {chosen}; joint angles would state it", err=True, mark="note: ")
    known = np.isfinite(q).all(axis=1)
    return q[known], poses[known]


_SHOWN_OF_FAMILY = 0.1
"""Share of the mean square error that the readings leave unknown from which it is mentioned."""


def _sight(tracker: str | None, faces: str | None) -> Sight | None:
    import numpy as np

    from analysis.apps.planning.pose_pool import Sight

    if tracker is None:
        if faces:
            raise UseError("--faces", "needs the position of the tracker", "add --tracker X,Y,Z")
        return None
    place = np.array(numbers_in(tracker))
    if place.shape != (3,):
        remedy = "write X,Y,Z in mm, such as 2500,0,800"
        raise UseError("--tracker", f"{tracker!r} is not a position", remedy)
    axis = None
    if faces:
        axis = np.zeros(3)
        axis["xyz".index(faces[-1])] = -1.0 if faces.startswith("-") else 1.0
    return Sight(place, axis)


def _write(rig: Rig, planned: PlannedPoses, directory: Path, maker: MakerName | None, dwell_s: float) -> list[Path]:
    from analysis.apps.makers.motion_plan import demand_of
    from analysis.apps.makers.writing import encoded_programs, programs_of
    from analysis.apps.programs.planned import poses_plan
    from analysis.runs.written_files import holding, write_all_new

    files = {"poses.csv": holding(planned.csv().encode())}
    if maker:
        plan = poses_plan(rig, planned.q, dwell_s)
        files |= encoded_programs(maker, programs_of(maker, [(plan, demand_of(plan))]))
    try:
        return write_all_new(directory, files)
    except FileError as error:
        raise FileError(error.where, error.what, "choose a different --output", code=error.code) from None
