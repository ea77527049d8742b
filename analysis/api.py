"""Functions of `from analysis import …`: create runs from files or by simulation, and evaluate runs.

`load_run`, `read_table` and `simulate` return a run (`Measured`). All other functions take runs and return frozen
results with curves, `to_dict()`, `to_table()` (pyarrow) and `to_frame()` (pandas). No function prints. Every expected
failure is a RigError: FileError for files and readings, CellError for disks. The commands of `rig` use only these
functions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from numbers import Integral, Real
from pathlib import Path
from textwrap import shorten
from typing import cast, get_args

from analysis.correction.calibrated_arm import ArmAngles as ArmAngles
from analysis.correction.calibrated_arm import ArmPoses as ArmPoses
from analysis.correction.calibrated_arm import CalibratedArm as CalibratedArm
from analysis.correction.diagnosed import Diagnosis as Diagnosis
from analysis.diagnosis.judge.comparison import Compared as Compared
from analysis.diagnosis.judge.comparison import Comparison as Comparison
from analysis.diagnosis.judge.named import Named as Named
from analysis.diagnosis.judge.result import Gap as Gap
from analysis.procedures import results
from analysis.procedures.results import Result as Result
from analysis.procedures.shared.joint_reversals import JointReversal as JointReversal
from analysis.procedures.shared.quantity import Quantity as Quantity
from analysis.procedures.shared.result_curves import CircleCurve as CircleCurve
from analysis.procedures.shared.result_curves import PathCurve as PathCurve
from analysis.procedures.shared.result_curves import PoseCurve as PoseCurve
from analysis.procedures.shared.result_curves import RadialCurve as RadialCurve
from analysis.procedures.shared.result_curves import RepeatabilityCurve as RepeatabilityCurve
from analysis.runs.copies import ELSEWHERE, HELD_OUT, USED, refuse_repeated
from analysis.runs.loading import Measured as Measured
from analysis.runs.loading import load_measured
from analysis.runs.tables import JointSource
from rigs.effects import Effect
from rigs.errors import CellError as CellError
from rigs.errors import FileError as FileError
from rigs.errors import RigError as RigError
from rigs.errors import UseError
from rigs.load import Hidden, load, load_hidden, named_by
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName, direction_of

RigFile = str | Path
"""Path of a rig file, name of a shipped rig such as `ur10e-cell`, or name of an arm in the library such as `ur10e`."""
AnyRun = Measured | str | Path
"""A run, or the path of a run directory."""


def load_run(path: str | Path) -> Measured:
    """Read a recorded, imported or simulated run directory, and align the streams to a common table.

    path: the run directory.

    Returns the run. In its `table`, g_mm (n, k) are the readings of k gauges in mm, and q (n, 6) the joints in rad.

    Raises FileError if the run is missing, still being recorded, not recovered after a crash, or damaged.

    Example:

        run = load_run("runs/monday-acw")
        print(run.title, run.doubts)

    Source: docs/recording.md (run directories), docs/analysis.md (alignment of times).
    """
    return load_measured(_path(path, "path"))


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
    """Read a table of measurements as a run, in memory only.

    path: CSV file or workbook with the columns of docs/tables.md. Poses and touches may have the format of the
    instrument if the meaning of the columns is unambiguous.
    rig: rig file of the measured cell, or name of a shipped rig or library arm.
    test: `yaw`, `roll`, `radial`, `repeatability`, `pose`, `touch` or `path`. If None, it is inferred from the columns,
    which are the same for yaw and roll.
    direction: `acw` or `cw`, for a circle if the table lacks the column `direction`.
    operator: name of the operator.
    placement: name of the place of instrument or ball; runs with the same placement share a set-up.
    joints: `commanded` to use the columns qN_commanded_deg as joint angles.

    Returns the run. Its `doubts` list suspicious units, gauges and certificates.

    Raises FileError if the rig file or the table cannot be read, with the line number of every bad row.

    Example:

        run = read_table("roll.csv", "ur10e-cell", test="roll", direction="acw")
        print(run.to_table().column_names)

    Source: docs/tables.md.
    """
    from analysis.intake.imports import RunLabels, read_any_table  # noqa: PLC0415 - what it needs is slow to import

    _require("operator", operator, "a text", fits=isinstance(operator, str))
    _require("placement", placement, "a text", fits=isinstance(placement, str))
    _require("joints", joints, " or ".join(get_args(JointSource)), fits=joints in get_args(JointSource))
    labels = RunLabels(_direction(direction), operator, placement, joints)
    return read_any_table(_path(path, "path"), _path(rig, "rig"), None if test is None else _test(test), labels)


def save_run(run: Measured, directory: str | Path) -> Path:
    """Write a run of `read_table` or `simulate` as a run directory for `load_run` and `rig`.

    run: result of `read_table` or `simulate`.
    directory: directory to create. The last part of the path becomes the name of the run.

    Returns the path of the directory.

    Raises FileError if the directory exists, or if the run is a recorded one, whose directory can be copied instead;
    CellError if the disk cannot be written.

    Example:

        run = simulate("ur10e-cell", "roll", "acw")
        save_run(run, "runs/monday-acw")

    Source: docs/recording.md (run directories).
    """
    from daq.store import write_table_run  # noqa: PLC0415

    run, path = _run(run), _path(directory, "directory")
    if run.run.table is None:
        raise FileError(
            str(run.path),
            "is a recorded run, but only the table was read",
            "copy the directory of the run",
            code="argument.invalid",
        )
    write_table_run(run.run, path, run.rig.companion_files)
    return path


def simulate(
    rig: RigFile,
    test: TestName,
    direction: Direction | None = None,
    *,
    seed: int | None = 0,
    effects: RigFile | Effect | Sequence[Effect] | None = None,
) -> Measured:
    """Simulate a run of a test, with the robot program of the test and noisy gauge readings.

    rig: rig file, or name of a shipped rig.
    test: `yaw`, `roll`, `radial`, `repeatability` or `touch`; `pose` and `path` are the tests of ISO 9283.
    direction: `acw` or `cw`, required for yaw and roll only.
    seed: seed of the noise, from 0; the two directions have independent noise. None disables the noise.
    effects: errors of the robot that replace the effects of the rig file, as objects of `rigs.effects` or as a YAML
    file with `effects` and `eccentricity_mm`. The rig file in the run does not contain them.

    Returns the run, in memory; `save_run` writes it.

    Raises FileError if a file cannot be read or the robot cannot drive the test, UseError for an unknown test or
    direction.

    Example:

        run = simulate("ur10e-cell", "roll", "cw", seed=7)
        print(run.table.g_mm.shape, run.table.q.shape)

    Source: docs/simulation.md.
    """
    from analysis.procedures.simulate import simulated_run  # noqa: PLC0415

    model, text = load(_path(rig, "rig"))
    if effects is not None:
        model = (load_hidden(effects) if isinstance(effects, str | Path) else _hidden(effects)).apply_to(model)
    is_seed = seed is None or (isinstance(seed, Integral) and seed >= 0)
    _require("seed", seed, "a whole number from 0, or None", fits=is_seed)
    with named_by(rig, model):
        return simulated_run(model, text, _test(test), _direction(direction), seed)


def evaluate(run: AnyRun, like: Result | None = None) -> Result:
    """Evaluate a run: the figures of the test with standard uncertainties, and the underlying curve.

    run: result of `load_run`, `read_table` or `simulate`, or the path of a run directory.
    like: result of a run with at least two laps in the same cell. Its noise is used for a run of a single lap.

    Returns the result, with the figures of docs/figures.md.

    Raises FileError if the readings are not a measurement of the labelled test.

    Example:

        result = evaluate(simulate("ur10e-cell", "roll", "acw"))
        band = result.figures["band_deg"]
        print(band.value, band.u, band.unit)

    Source: docs/figures.md (definitions), docs/analysis.md (uncertainty); Y. T. Oh, Applied Sciences 9 (2019).
    """
    _require("like", like, "a result of evaluate", fits=like is None or isinstance(like, Result))
    return results.result_of(_run(run), like.lap_noise if like else None)


def evaluate_runs(runs: AnyRun | Sequence[AnyRun]) -> list[Result]:
    """Evaluate several runs. A run of a single lap uses the noise of the first run of the same test with more laps.

    runs: runs or paths of run directories, of any tests, robots and cells.

    Returns the results in the order of the runs.

    Raises FileError as `evaluate` does.

    Example:

        runs = [simulate("ur10e-cell", "roll", way) for way in ("acw", "cw")]
        for result in evaluate_runs(runs):
            print(result.title, result.figures["band_deg"])

    Source: docs/analysis.md.
    """
    return results.evaluate_runs(_runs(runs))


def compare(
    runs: AnyRun | Sequence[AnyRun], rig: RigFile | Rig | None = None, *, unseen: AnyRun | Sequence[AnyRun] = ()
) -> Compared:
    """Simulate each run from its joint feedback, fit the set-up, and compare simulation and measurement.

    runs: at least one run, or paths of run directories, of the same robot.
    rig: the model; the rig file of the first run if None.
    unseen: runs at a different place or radius, each compared with a separately fitted set-up.

    Returns the comparison, with curves, figures and residuals of each run.

    Raises FileError if a run does not belong to the robot or circle of the model.

    Example:

        compared = compare(simulate("ur10e-cell", "roll", "acw"))
        print(compared.runs[0].rms_um)

    Source: docs/simulation.md.
    """
    from analysis.diagnosis.judge.comparison import compare as compare_with  # noqa: PLC0415
    from analysis.diagnosis.judge.staircase import located  # noqa: PLC0415

    used, elsewhere = _runs(runs), _runs(unseen)
    refuse_repeated({USED: used, ELSEWHERE: elsewhere})
    model = _model(rig, used)
    return located(compare_with(used, model, elsewhere), model, used, elsewhere)


def calibrate(
    runs: AnyRun | Sequence[AnyRun],
    effects: str | None = None,
    *,
    fix: str | None = None,
    rig: RigFile | Rig | None = None,
    hold_out: AnyRun | Sequence[AnyRun] = (),
    unseen: AnyRun | Sequence[AnyRun] = (),
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Calibrate the model of a robot. The given effects, or those found automatically, are fitted together with all
    other parameters that the runs determine.

    runs: at least one run, or paths of run directories, of the same robot.
    effects: effects to fit, separated by commas, such as `backlash:1,joint_offset`: NAME:AXIS, or NAME for all axes. If
    None, the runs determine the effects, as in `diagnose`.
    fix: those of `effects` that are not fitted, in the same notation.
    rig: the initial model; the rig file of the first run if None.
    hold_out: runs used for validation only. By default a fifth of 60 or more poses is held out, in groups of
    neighbouring postures.
    unseen: runs at a different place or radius for validation.
    progress: called with a short text at each step, which may take seconds.

    Returns the diagnosis, with the model in `calibrated`.

    Raises UseError for an unknown effect, FileError if a run belongs to a different robot or is given twice, or if the
    readings are too few.

    Example:

        runs = [simulate("ur10e-cell", "roll", way, seed=seed) for seed in (1, 2) for way in ("acw", "cw")]
        found = calibrate(runs, "backlash:1")
        print(found.train.before_um, found.train.calibrated_um)

    Source: docs/calibration.md.
    """
    from analysis.diagnosis.evidence.given import given_effects, without_fixed  # noqa: PLC0415

    if effects is None and fix is not None:
        raise UseError("--fix", "needs --fit, the effects from which it excludes some", "add --fit NAME")
    used, fixed = _runs(runs), list[Effect]()
    axes = len(_model(rig, used).robot.axes)
    given = None if effects is None else given_effects(effects, axes)
    if given is not None and fix is not None:
        given, fixed = without_fixed(given, fix, axes)
    return replace(_diagnosed(used, rig, hold_out, unseen, progress, None, given), fixed=tuple(fixed))


def diagnose(
    runs: AnyRun | Sequence[AnyRun],
    *,
    rig: RigFile | Rig | None = None,
    hold_out: AnyRun | Sequence[AnyRun] = (),
    unseen: AnyRun | Sequence[AnyRun] = (),
    tolerance_um: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Find the causes of disagreement between simulation and measurement: the effects missing in the model.

    runs: as in `calibrate`.
    rig: as in `calibrate`.
    hold_out: as in `calibrate`.
    unseen: as in `calibrate`.
    progress: as in `calibrate`.
    tolerance_um: largest accepted rms error of the readings; the limits of the rig file if None.

    Returns the diagnosis, with causes, sizes and remedies.

    Raises FileError if a run belongs to a different robot or is given twice, if the readings are too few, or if the
    constants of the controller are those of another robot.

    Example:

        runs = [simulate("ur10e-cell", "roll", way, seed=seed) for seed in (1, 2) for way in ("acw", "cw")]
        found = diagnose(runs)
        print(found.condition, [cause.effect for cause in found.standing])

    Source: docs/diagnosis.md.
    """
    is_tolerance = tolerance_um is None or (isinstance(tolerance_um, Real) and tolerance_um > 0)
    _require("tolerance_um", tolerance_um, "a number above 0, or None", fits=is_tolerance)
    return _diagnosed(runs, rig, hold_out, unseen, progress, tolerance_um, None)


def calibrated_arm(rig: RigFile | Rig) -> CalibratedArm:
    """Calibrated arm of a rig file: forward and inverse kinematics with uncertainty.

    rig: rig file next to its calibration, or name of a shipped rig or library arm.

    Returns the arm. Its poses include all effects that depend only on the posture; its uncertainties also include
    backlash and time-dependent effects.

    Raises FileError if the file cannot be read.

    Example:

        arm = calibrated_arm("ur10e")
        poses = arm.forward([0, -90, 90, 0, 90, 0])
        print(poses.T[0, :3, 3], poses.u_mm[0])

    Source: docs/calibration.md.
    """
    return CalibratedArm(rig if isinstance(rig, Rig) else load(_path(rig, "rig"))[0])


def _diagnosed(
    runs: AnyRun | Sequence[AnyRun],
    rig: RigFile | Rig | None,
    hold_out: AnyRun | Sequence[AnyRun],
    unseen: AnyRun | Sequence[AnyRun],
    progress: Callable[[str], None] | None,
    tolerance_um: float | None,
    given: Sequence[Effect] | None,
) -> Diagnosis:
    from analysis.correction.foreign_constants import with_controller_doubts  # noqa: PLC0415
    from analysis.correction.passport import passport_of  # noqa: PLC0415
    from analysis.diagnosis.diagnose import diagnose as diagnose_with  # noqa: PLC0415
    from analysis.movement.between import with_movements, without_moved  # noqa: PLC0415
    from analysis.runs.loading import as_recorded, with_controller_of  # noqa: PLC0415

    used, held_out, elsewhere = _runs(runs), _runs(hold_out), _runs(unseen)
    first_given = used
    refuse_repeated({USED: used, HELD_OUT: held_out, ELSEWHERE: elsewhere})
    model = as_recorded(_model(rig, used), used)
    used, held_out, elsewhere = (with_controller_of(model, group) for group in (used, held_out, elsewhere))
    sound, movements, doubts = without_moved(model, used)
    diagnosis = diagnose_with(model, sound, held_out, elsewhere, progress or _silent, tolerance_um, given)
    diagnosis = with_controller_doubts(with_movements(diagnosis, movements, doubts), used)
    diagnosis = replace(diagnosis, passport=passport_of(diagnosis))
    return Diagnosis.of(diagnosis, _rig_text(rig, first_given))


def _rig_text(rig: RigFile | Rig | None, runs: Sequence[Measured]) -> str:
    """Text of the initial rig file; empty for an object that no run contains."""
    if isinstance(rig, str | Path):
        return load(rig)[1]
    is_of_run = rig is None or any(run.rig == rig for run in runs)
    return runs[0].run.manifest.rig_text if is_of_run else ""


def _require(name: str, value: object, expected: str, *, fits: bool) -> None:
    """Raise UseError for an argument that does not fit."""
    if not fits:
        raise UseError(
            name, f"must be {expected}, but is {shorten(repr(value), 60)}", f"give {expected}", code="argument.invalid"
        )


def _hidden(effects: Effect | Sequence[Effect]) -> Hidden:
    """Given errors of a robot. Raises UseError for anything except effects."""
    several = tuple(effects) if isinstance(effects, Sequence) else (effects,)
    are_effects = all(isinstance(effect, Effect) for effect in several)
    _require("effects", effects, "objects of rigs.effects, or the path of a file of effects", fits=are_effects)
    return Hidden(effects=several)


def _path(path: str | Path, name: str) -> Path:
    """An argument as a path. Raises UseError for any other type."""
    if not isinstance(path, str | Path):
        raise UseError(
            name,
            f"must be a path, but has the type {type(path).__name__}",
            "give a string or a Path",
            code="argument.invalid",
        )
    return path if isinstance(path, Path) else Path(path)


def _run(run: AnyRun) -> Measured:
    """Run, read from a directory if necessary. Raises UseError for any other type."""
    if isinstance(run, str | Path):
        if Path(run).is_file():
            remedy = f'read it first: read_table("{run}", rig="cell.yaml"), and give the result'
            raise UseError(str(run), "is a file, and a run is a directory", remedy, code="argument.invalid")
        return load_run(run)
    if not isinstance(run, Measured):
        remedy = "give a run of load_run, read_table or simulate, or the path of a run directory"
        raise UseError("run", f"must be a run, but has the type {type(run).__name__}", remedy, code="argument.invalid")
    return run


def _runs(runs: AnyRun | Sequence[AnyRun]) -> list[Measured]:
    """A list of runs for a single run or several."""
    is_one = isinstance(runs, Measured | str | Path) or not hasattr(runs, "__iter__")
    several: Sequence[AnyRun] = cast("Sequence[AnyRun]", (runs,) if is_one else runs)
    return [_run(run) for run in several]


def _test(test: TestName) -> TestName:
    """Name of a test unchanged. Raises UseError for an unknown name."""
    if test not in get_args(TestName):
        raise UseError(
            "test",
            f"{test!r} is not a test",
            f"give one of {', '.join(get_args(TestName))}",
            code="argument.invalid",
        )
    return test


def _direction(direction: str | None) -> Direction | None:
    """A direction from its common spellings: ccw is acw. Raises UseError for an unknown name."""
    if direction is None:
        return None
    way = direction_of(str(direction))
    if way is None:
        raise UseError("direction", f"{direction!r} is not a direction", "give acw or cw", code="argument.invalid")
    return way


def _silent(doing: str) -> None:
    """Ignore a progress message."""


def _model(rig: RigFile | Rig | None, runs: Sequence[Measured]) -> Rig:
    """Given rig, or the rig of the first run. Raises FileError for an empty list of runs."""
    if not runs:
        raise FileError("runs", "none is given", "give one or more", code="argument.invalid")
    if rig is None:
        return runs[0].rig
    return rig if isinstance(rig, Rig) else load(_path(rig, "rig"))[0]
