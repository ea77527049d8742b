"""Comparison of simulation and measurement: simulated from the run's own feedback, with the set-up fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.fitting.estimate import Fit, fit
from analysis.fitting.joint_coverage import outside_effect_coverage
from analysis.fitting.placements import observe_runs, split_by_frame
from analysis.kinematics.arm import Array
from analysis.measures.evaluate import Evaluated, evaluate
from analysis.measures.link_angle import CircleResult
from analysis.measures.radial import RadialResult
from analysis.measures.reduction import PHI
from analysis.measures.repeatability import RepeatabilityResult
from analysis.measures.results import Result, result_of
from analysis.measures.rig_agreement import hold_targets
from analysis.model.predict import SetUp, model_of, path_of, predict
from analysis.simulation.simulate import with_values
from analysis.traces.loading import Measured
from analysis.traces.tables import PoseTable
from rigs.errors import FileError
from rigs.rig import Rig


@dataclass(frozen=True)
class Comparison:
    """One run. `result` and `simulated` are evaluated in the same way; the curves (n,) at x (n,) are in `unit`;
    `correlation` is that of the curves, and `rms_um` that of the unexplained readings."""

    result: Result
    simulated: Evaluated
    x: Array
    measured_curve: Array
    simulated_curve: Array
    unit: str
    correlation: float
    rms_um: float


@dataclass(frozen=True)
class Compared:
    """All runs, the fit of their set-ups, and doubts in words."""

    runs: list[Comparison]
    fitted: Fit
    doubts: list[str]


def compare(runs: Sequence[Measured], rig: Rig) -> Compared:
    """Return each run compared with the model of a rig; readings are (m, k) mm. Runs of one test and placement share
    one set-up. Raises FileError."""
    model = model_of(rig)
    poses = [run for run in runs if isinstance(run.table, PoseTable)]
    runs = [run for run in runs if not isinstance(run.table, PoseTable)]
    if not runs:
        what = "is a pose run, which has no gauges to compare"
        raise FileError(str(poses[0].path), what, "use rig calibrate for poses")
    for run in runs:
        hold_targets(run.table, rig, str(run.path))
    names = [run.run.manifest.name for run in runs]
    observations, doubts = split_by_frame(model, observe_runs(rig, runs), names)
    doubts += [f"{run.run.manifest.name} is left out: poses have no gauges to compare" for run in poses]
    for name, one in zip(names, observations, strict=True):
        doubts += outside_effect_coverage(rig.effects, one.table.q[one.rows], f"{name}, an effect of the rig file")
    found = fit(model, observations)
    comparisons = [
        _one(run, rig, found, found.setups[one.setup], residual)
        for run, one, residual in zip(runs, observations, found.residuals, strict=True)
    ]
    return Compared(comparisons, found, doubts)


def _one(run: Measured, rig: Rig, found: Fit, setup: SetUp, residual: Array) -> Comparison:
    run = replace(run, rig=rig)
    result = result_of(run)
    values = predict(found.model, run.table, path_of(found.model, run.table), setup)
    simulated = evaluate(with_values(run.table, values), rig, run.u_lag_s, f"{run.path}, simulated", u_gauge_mm=0.0)
    x, measured_curve, unit = curve(result.found)
    _, simulated_curve, _ = curve(simulated)
    correlation = float(np.corrcoef(measured_curve, simulated_curve)[0, 1]) if np.ptp(simulated_curve) else float("nan")
    rms_um = float(np.sqrt((residual**2).mean()) * 1000)
    return Comparison(result, simulated, x, measured_curve, simulated_curve, unit, correlation, rms_um)


def curve(found: Evaluated) -> tuple[Array, Array, str]:
    """Return the curve of a result that is compared: positions (n,), values (n,), and their unit."""
    match found:
        case CircleResult():
            return np.degrees(PHI), np.degrees(found.residual), "deg"
        case RadialResult():
            deviation = np.linalg.norm(found.points - found.free.centre, axis=1) - found.free.radius
            return found.cells.target.astype(float), deviation, "mm"
        case RepeatabilityResult():
            mean = np.nanmean(found.readings_mm, axis=2)
            return np.arange(mean.size, dtype=float), mean.ravel(), "mm"
    raise TypeError("poses have no gauges to compare")
