"""`rig compare RUN…`: compare simulation and measurement, or with `--against RUN…` runs before and after a repair.

Two rig files, or names of arms of the library, in place of runs compare two arms of a model, pose by pose. Runs after
them show which of the arms fits the runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command, taking_all
from analysis.cli.console import say, say_json
from analysis.cli.options import AsJson, ModelRig, RobotRunsBelow, RunsElsewhere, location
from analysis.procedures.shared.test_kind import facts_of
from rigs.errors import FileError, UseError
from rigs.text import as_argument

if TYPE_CHECKING:
    from analysis.apps.report.blocks import Block
    from analysis.runs.loading import Measured
    from rigs.rig import Rig

    _Shown = tuple[dict[str, Any], list[Block]]
    """A comparison as JSON and as blocks."""

_ARMS = 2
_ARM_FILES = (".yaml", ".yml", ".urdf")


@command(app, "rig compare runs/after-* --against runs/before-*", cls=taking_all("--against"))
def compare(
    runs: RobotRunsBelow,
    against: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RUN…",
            parser=location,
            autocompletion=completion.runs,
            help="Runs before a repair, if RUN… are those after it; default: the simulation.",
        ),
    ] = None,
    rig_file: ModelRig = None,
    unseen: RunsElsewhere = None,
    as_json: AsJson = False,
    plot: Annotated[
        Path | None,
        typer.Option(help="Directory for a plot of each run and a plot of the disagreement; default: no plots."),
    ] = None,
) -> None:
    """Simulate each run from its own feedback, fit the set-up, and show measured and simulated side by side.

    With --against: show by how much each figure differs from runs before a repair, and whether the spread explains it.

    With two rig files or names of the library in place of runs: show how far apart two arms are, pose by pose.

    With two rig files or URDFs and then runs: show which of the two arms fits the runs, and by how much.
    """
    from analysis.apps.report.blocks import say_answer
    from analysis.cli.several import runs_below, with_tables

    has_arms = len(runs) >= _ARMS and all(map(_is_arm, runs[:_ARMS]))
    has_options = bool(rig_file or plot or unseen)
    if has_arms and (against or has_options):
        raise UseError("ARM ARM", "accepts only runs and --json", "omit the other options")
    if len(runs) == 1 and _is_arm(runs[0]):
        arm = as_argument(runs[0])
        remedy = f"give a second arm, or the runs to simulate with it: rig compare RUN… --rig {arm}"
        raise UseError(str(runs[0]), "is a single arm", remedy)
    if against and has_options:
        problem, remedy = "compares recorded runs without a simulation", "omit --rig, --unseen and --plot"
        raise UseError("--against", problem, remedy)
    if has_arms:
        arms, runs = runs[:_ARMS], runs[_ARMS:]
        plain, blocks = _which_fits(arms, runs_below(with_tables(runs, str(arms[0])))) if runs else _apart(*arms)
    elif against:
        plain, blocks = _before_and_after(runs_below(with_tables(runs, rig_file)), runs_below(against))
    else:
        plain, blocks = _simulated(runs_below(with_tables(runs, rig_file)), runs_below(unseen or ()), rig_file, plot)
    if as_json:
        say_json(plain)
    else:
        say_answer(blocks)


def _is_arm(path: Path) -> bool:
    from rigs.arms import arm_names

    return (path.suffix in _ARM_FILES and path.is_file()) or (not path.exists() and str(path) in arm_names())


def _simulated(runs: Sequence[Path], unseen: Sequence[Path], rig_file: str | None, plot: Path | None) -> _Shown:
    import analysis
    from analysis.apps.plant.comparison_report import comparison_answer, save_pictures
    from analysis.cli.console import progress_of

    with progress_of() as progress:
        measured = [analysis.load_run(path) for path in runs]
        progress(f"simulating {len(measured)} runs")
        elsewhere = [analysis.load_run(path) for path in unseen]
        compared = analysis.compare(measured, rig_file, unseen=elsewhere)
    if plot:
        with progress_of("drawing the pictures"):
            pictures = list(save_pictures(compared, plot))
        for path in pictures:
            say(path, err=True)
    return compared.to_dict(), comparison_answer(compared)


def _before_and_after(after: Sequence[Path], before: Sequence[Path]) -> _Shown:
    from analysis.apps.plant.before_after import differences, differences_answer
    from analysis.cli.console import progress_of

    with progress_of():
        changes = differences([run.resolve() for run in after], [run.resolve() for run in before])
    return {"differences": [change.to_dict() for change in changes]}, differences_answer(changes)


def _apart(first: Path, second: Path) -> _Shown:
    from analysis.apps.plant.arms_apart import arms_apart, arms_apart_answer
    from analysis.cli.console import progress_of
    from analysis.runs.batch import distinct
    from rigs.load import find, load

    distinct(map(find, (str(first), str(second))))

    with progress_of("comparing the arms"):
        apart = arms_apart(load(first)[0], load(second)[0])
    return apart.to_dict(), arms_apart_answer(apart)


def _which_fits(arms: Sequence[Path], runs: Sequence[Path]) -> _Shown:
    import analysis
    from analysis.apps.plant.fitting_arm import fitting_answer, fitting_arm
    from analysis.cli.console import progress_of

    with progress_of() as progress:
        measured = [analysis.load_run(path) for path in runs]
        progress("fitting both arms to the runs")
        fitting = fitting_arm(measured, [(str(arm), _rig_of(arm, measured)) for arm in arms])
    return fitting.to_dict(), fitting_answer(fitting)


def _rig_of(arm: Path, runs: Sequence[Measured]) -> Rig:
    """Load the rig to compare. A URDF, or a file with only `robot`, replaces the arm in the rig of the runs.

    Runs of gauges need a rig file, which states where the ball link is on the flange.
    """
    from analysis.apps.commission.rig_file_text import chosen_arm
    from analysis.apps.interchange.urdf import import_urdf
    from rigs.load import load
    from rigs.yaml_text import read_yaml

    is_of_library, is_urdf = not arm.exists(), arm.suffix == ".urdf"
    if not (is_of_library or is_urdf) and "name" in read_yaml(arm.read_text(encoding="utf-8"), str(arm))[1]:
        return load(arm)[0]
    if not all(facts_of(run.table.test).of_places for run in runs):
        problem, remedy = "has no tool, but runs with gauges need a tool", "give the rig file of this arm"
        raise FileError(str(arm), problem, remedy, code="rig_file.invalid")
    if is_of_library:
        robot = load(arm)[0].robot
    else:
        robot = import_urdf(arm).section.robot if is_urdf else chosen_arm(str(arm), "tracker").robot
    return runs[0].rig.model_copy(update={"robot": robot, "effects": ()}).with_calibration(None, None)
