"""The functions of `from analysis import …`: from files or simulation to runs, from runs to results.

A run (`Measured`) comes from `load_run`, `read_table` or `simulate`; all the other functions take runs and return
frozen results with their curves, `to_dict()`, `to_table()` (pyarrow) and `to_frame()` (pandas). Nothing is printed.
Every expected failure is a RigError: FileError for files and readings, CellError for disks. The commands of `rig` call
these functions and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast, get_args

from analysis.correction.calibrated_arm import ArmAngles as ArmAngles
from analysis.correction.calibrated_arm import ArmPoses as ArmPoses
from analysis.correction.calibrated_arm import CalibratedArm as CalibratedArm
from analysis.diagnosis.judge.comparison import Compared as Compared
from analysis.diagnosis.judge.comparison import Comparison as Comparison
from analysis.diagnosis.judge.result import Diagnosis as Diagnosis
from analysis.diagnosis.judge.result import Gap as Gap
from analysis.diagnosis.judge.result import Named as Named
from analysis.procedures import results
from analysis.procedures.results import Result as Result
from analysis.procedures.shared.quantity import Quantity as Quantity
from analysis.procedures.shared.result_curves import CircleCurve as CircleCurve
from analysis.procedures.shared.result_curves import JointReversal as JointReversal
from analysis.procedures.shared.result_curves import PathCurve as PathCurve
from analysis.procedures.shared.result_curves import PoseCurve as PoseCurve
from analysis.procedures.shared.result_curves import RadialCurve as RadialCurve
from analysis.procedures.shared.result_curves import RepeatabilityCurve as RepeatabilityCurve
from analysis.runs.loading import Measured as Measured
from analysis.runs.loading import load_measured
from analysis.runs.table_layout import JointSource
from rigs.effects import Effect
from rigs.errors import CellError as CellError
from rigs.errors import FileError as FileError
from rigs.errors import RigError as RigError
from rigs.errors import UseError
from rigs.load import Hidden, load, load_hidden, named_by
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName, direction_of

RigFile = str | Path
"""The path of a rig file, the name of a shipped rig such as `paper-fanuc`, or that of an arm in the library."""
AnyRun = Measured | str | Path
"""A run, or the path of its directory."""


def load_run(path: str | Path) -> Measured:
    """Read a run directory that was recorded, imported or simulated, and align its streams to one table.

    path: the run directory.

    Returns the run: `table` with the readings (g_mm (n, k) mm of k gauges, q (n, 6) rad of the joints), `rig` as it was
    at the time, `doubts` in words. `to_table()` has the columns of docs/tables.md, in degrees and mm.

    Raises FileError where the run is missing, still being recorded, not recovered after a crash, or damaged.

    Source: docs/recording.md (run directories), docs/analysis.md (alignment of times).
    """
    return load_measured(Path(path))


def read_table(
    path: str | Path,
    rig: RigFile,
    test: TestName | None = None,
    direction: Direction | None = None,
    *,
    operator: str = "",
    placement: str = "",
    joints: JointSource = "measured",
) -> Measured:
    """Read a table of measurements from elsewhere as a run; nothing is written.

    path: CSV file or workbook with the columns of docs/tables.md; poses and touches also as their instrument wrote
    them, if nothing about their columns is left open.
    rig: rig file of the cell that it was measured in, or the name of a shipped rig or of an arm in the library.
    test: `yaw`, `roll`, `radial`, `repeatability`, `pose`, `touch` or `path`; by the columns where it is None.
    direction: `acw` or `cw`, of a circle whose table has no column `direction`.
    operator: who measured.
    placement: where instrument or ball stood; runs of one placement share a set-up.
    joints: `commanded` where the columns qN_commanded_deg are the robot's joints.

    Returns the run; its `doubts` say what looks wrong about units, gauges and certificates.

    Raises FileError where the rig file or the table cannot be read; every bad row is named with its line.

    Source: docs/tables.md.
    """
    from analysis.intake.any_table import read_any_table  # noqa: PLC0415 - what it needs is slow to import

    return read_any_table(
        Path(path),
        rig_file=rig,
        test=None if test is None else _test(test),
        direction=_direction(direction),
        operator=operator,
        placement=placement,
        joints=joints,
    )


def save_run(run: Measured, directory: str | Path) -> Path:
    """Write a run of `read_table` or `simulate` as a run directory, which `load_run` and `rig` read.

    run: of `read_table` or `simulate`.
    directory: to be made; the run takes its name.

    Returns the path of the directory.

    Raises FileError where it exists already, or for a recorded run, whose directory can be copied instead; CellError
    where the disk refuses.

    Source: docs/recording.md (run directories).
    """
    from daq.store import write_table_run  # noqa: PLC0415

    path = Path(directory)
    if run.run.table is None:
        raise FileError(
            str(run.path), "is a recorded run, but only the table was read", "copy the directory of the run"
        )
    write_table_run(run.run, path, run.rig.beside)
    return path


def simulate(
    rig: RigFile,
    test: TestName,
    direction: Direction | None = None,
    *,
    seed: int | None = 0,
    effects: RigFile | Sequence[Effect] | None = None,
) -> Measured:
    """Simulate a run of a test: the robot drives the test's program, the gauges read with noise.

    rig: rig file, or the name of a shipped rig.
    test: `yaw`, `roll`, `radial`, `repeatability` or `touch`; `pose` and `path` are those of ISO 9283.
    direction: `acw` or `cw`, which yaw and roll need and the others do not have.
    seed: of the noise, from 0; each direction has noise of its own; None for a run without noise.
    effects: errors that the robot has instead of those in the rig file, as objects of `rigs.effects` or as a YAML file
    with `effects` and `eccentricity_mm`. The run holds the rig file without them.

    Returns the run, in memory; `save_run` writes it.

    Raises FileError where a file cannot be read or the robot cannot do the test, UseError for a test or direction that
    does not exist.

    Source: docs/simulation.md.
    """
    from analysis.procedures.simulate import simulated_run  # noqa: PLC0415

    model, text = load(rig)
    if effects is not None:
        hidden = load_hidden(effects) if isinstance(effects, str | Path) else Hidden(effects=tuple(effects))
        model = hidden.within(model)
    with named_by(rig, model):
        return simulated_run(model, text, _test(test), _direction(direction), seed)


def evaluate(run: AnyRun, like: Result | None = None) -> Result:
    """Evaluate a run: every figure of its test with its standard uncertainty, and the curve behind them.

    run: of `load_run`, `read_table` or `simulate`, or the path of its directory.
    like: result of a run of two laps or more in the same cell, whose noise a run of one lap borrows.

    Returns the result: `figures` by the names of docs/figures.md, each with value, u and unit; `curve` over the circle
    angle or the targets, in degrees and mm; `reversals` of the joints; `doubts` in words.

    Raises FileError where the readings are not a measurement of the test that they are labelled as.

    Source: docs/figures.md (definitions), docs/analysis.md (uncertainty); Y. T. Oh, Applied Sciences 9 (2019).
    """
    return results.result_of(_run(run), like.lap_noise if like else None)


def evaluate_runs(runs: AnyRun | Sequence[AnyRun]) -> list[Result]:
    """Evaluate runs; each of a single lap borrows the noise of the first run of its test that has more laps.

    runs: of any tests, robots and cells; runs, or the paths of their directories.

    Returns a result for each run, in the same order.

    Raises FileError as `evaluate` does.

    Source: docs/analysis.md.
    """
    return results.evaluate_runs(_runs(runs))


def compare(
    runs: AnyRun | Sequence[AnyRun], rig: RigFile | Rig | None = None, *, unseen: AnyRun | Sequence[AnyRun] = ()
) -> Compared:
    """Simulate each run from its own joint feedback, fit the set-up, and lay simulated and measured side by side.

    runs: of one robot, at least one; runs, or the paths of their directories.
    rig: the model; the rig file of the first run where it is None.
    unseen: runs at another place or radius, each compared in a set-up of its own.

    Returns `runs` with the curves and figures of both and `residuals_mm` (m, k) of every reading, `poses` with what is
    left of runs without gauges, the fitted `setups`, and `doubts` in words. `disagreement` is where model and readings
    disagree, with the joints that turn back there, and what is left as the model's effects are added one by one.

    Raises FileError where a run is not of the model's robot or circle.

    Source: docs/simulation.md.
    """
    from analysis.diagnosis.judge.compare_runs import compare as compare_with  # noqa: PLC0415
    from analysis.diagnosis.judge.disagreement import located  # noqa: PLC0415

    used, elsewhere = _runs(runs), _runs(unseen)
    model = _model(rig, used)
    return located(compare_with(used, model, elsewhere), model, used, elsewhere)


def calibrate(
    runs: AnyRun | Sequence[AnyRun],
    effects: str | None = None,
    *,
    rig: RigFile | Rig | None = None,
    hold_out: AnyRun | Sequence[AnyRun] = (),
    unseen: AnyRun | Sequence[AnyRun] = (),
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Calibrate the model of a robot: find, or fit, effects beside everything else that the runs determine.

    runs: of one robot, at least one; runs, or the paths of their directories.
    effects: which to fit, with commas between, as `backlash:1,joint_offset`: NAME:AXIS, or a name alone for all axes;
    the runs decide where it is None, as in `diagnose`.
    rig: the model to begin with; the rig file of the first run where it is None.
    hold_out: runs to judge by, which are not used; a fifth of the neighbourhoods of poses where there are none.
    unseen: runs at another place or radius to judge by.
    progress: called with a few words at each step, which may take seconds.

    Returns the diagnosis, with `calibrated`, the calibrated model, the `effects` with sizes and standard uncertainties,
    and the rms gap in µm before and after on each set of runs.

    Raises UseError where an effect is not known, FileError where a run is of another robot or given twice, or where
    there are too few readings.

    Source: docs/calibration.md.
    """
    from analysis.diagnosis.evidence.given import given_effects  # noqa: PLC0415

    used = _runs(runs)
    effects_given = None if effects is None else given_effects(effects, len(_model(rig, used).robot.axes))
    return _diagnosed(used, rig, hold_out, unseen, progress, None, effects_given)


def diagnose(
    runs: AnyRun | Sequence[AnyRun],
    *,
    rig: RigFile | Rig | None = None,
    hold_out: AnyRun | Sequence[AnyRun] = (),
    unseen: AnyRun | Sequence[AnyRun] = (),
    tolerance_um: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Find where simulation and measurement disagree, and which effect is missing in the model.

    runs: of one robot, at least one; runs, or the paths of their directories.
    rig: the model to begin with; the rig file of the first run where it is None.
    hold_out: runs of the same places to judge by, which are not used to find names.
    unseen: runs at another place or radius to judge by.
    tolerance_um: the largest error of the readings that is accepted, rms; the limits of the rig file where None.
    progress: called with a few words at each step, which may take seconds.

    Returns the two verdicts, `condition` and `accuracy`, the `budget` of the error, the `effects` with their odds,
    sizes and rivals, the rms gap in µm before and after on each set of runs, the curves of residuals, `calibrated`, the
    calibrated model, and `extended_rig`, the model with the effects that the diagnosis stands by.

    Raises FileError where a run is of another robot or given twice, or where there are too few readings.

    Source: docs/diagnosis.md.
    """
    return _diagnosed(runs, rig, hold_out, unseen, progress, tolerance_um, None)


def calibrated_arm(rig: RigFile | Rig) -> CalibratedArm:
    """Return the arm of a rig file with all that was found of it: forward and inverse kinematics with uncertainty.

    rig: rig file, with the calibration beside it, or the name of a shipped rig or of an arm in the library.

    Returns the arm: `forward(q_deg)` gives the poses of its tool, T (n, 4, 4) with lengths in mm, and u_mm (n,), the
    standard uncertainty of the place; `inverse(T, near_deg)` gives q_deg (n, axes), `reached` (n,) and u_mm (n,).
    Whatever depends on the posture alone is in them; plays, and what depends on time, are in u_mm.

    Raises FileError where the file cannot be read.

    Source: docs/calibration.md.
    """
    return CalibratedArm(rig if isinstance(rig, Rig) else load(rig)[0])


def _diagnosed(
    runs: AnyRun | Sequence[AnyRun],
    rig: RigFile | Rig | None,
    hold_out: AnyRun | Sequence[AnyRun],
    unseen: AnyRun | Sequence[AnyRun],
    progress: Callable[[str], None] | None,
    tolerance_um: float | None,
    given: Sequence[Effect] | None,
) -> Diagnosis:
    from analysis.diagnosis.diagnose import diagnose as diagnose_with  # noqa: PLC0415
    from analysis.movement.between import without_moved  # noqa: PLC0415
    from analysis.runs.loading import refuse_copies  # noqa: PLC0415

    used, held_out, elsewhere = _runs(runs), _runs(hold_out), _runs(unseen)
    model = _model(rig, used)
    refuse_copies((run.path, run.run.readings_sha256) for run in (*used, *held_out, *elsewhere))
    sound, movements, doubts = without_moved(model, used)
    diagnosis = diagnose_with(model, sound, held_out, elsewhere, progress or _silent, tolerance_um, given)
    return replace(diagnosis, movements=tuple(movements), doubts=(*doubts, *diagnosis.doubts))


def _run(run: AnyRun) -> Measured:
    """The run itself, or that of a directory. Raises UseError for anything else."""
    if isinstance(run, str | Path):
        return load_run(run)
    if not isinstance(run, Measured):
        remedy = "give a run of load_run, read_table or simulate, or the path of a run directory"
        raise UseError("run", f"a {type(run).__name__} is no run", remedy)
    return run


def _runs(runs: AnyRun | Sequence[AnyRun]) -> list[Measured]:
    """The runs of one, or of several."""
    is_one = isinstance(runs, Measured | str | Path) or not hasattr(runs, "__iter__")
    several: Sequence[AnyRun] = cast("Sequence[AnyRun]", (runs,) if is_one else runs)
    return [_run(run) for run in several]


def _test(test: TestName) -> TestName:
    """A test by its name. Raises UseError for another word."""
    if test not in get_args(TestName):
        raise UseError("test", f"{test!r} is not a test", f"give one of {', '.join(get_args(TestName))}")
    return test


def _direction(direction: str | None) -> Direction | None:
    """A direction as people write it: ccw is acw. Raises UseError for another word."""
    if direction is None:
        return None
    way = direction_of(str(direction))
    if way is None:
        raise UseError("direction", f"{direction!r} is not a direction", "give acw or cw")
    return way


def _silent(doing: str) -> None:
    """What is called at each step where no progress was asked for."""


def _model(rig: RigFile | Rig | None, runs: Sequence[Measured]) -> Rig:
    """The rig that is asked for, or that of the first run. Raises FileError where there are no runs."""
    if not runs:
        raise FileError("runs", "none is given", "give one or more")
    if rig is None:
        return runs[0].rig
    return rig if isinstance(rig, Rig) else load(rig)[0]
