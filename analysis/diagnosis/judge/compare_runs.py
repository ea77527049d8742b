"""Comparison of simulation and measurement: simulated from the run's feedback, with a fitted set-up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.evidence.observation import by_socket, outside_effect_coverage, residual_of
from analysis.diagnosis.evidence.placements import observe_runs, split_by_frame, split_by_target
from analysis.diagnosis.evidence.setups import fit_setups
from analysis.diagnosis.judge.comparison import Compared, Comparison, PoseComparison
from analysis.procedures.circle import CircleResult
from analysis.procedures.radial import RadialResult
from analysis.procedures.repeatability import RepeatabilityResult
from analysis.procedures.results import result_of
from analysis.procedures.shared.lap_curve import PHI
from analysis.procedures.shared.test_kind import Evaluated, evaluate, facts_of, path_of, predict
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.model.predict import Model, SetUp
from analysis.runs.loading import Measured
from analysis.runs.noise.readings import rms
from analysis.runs.tables import Table
from rigs.rig import Rig


def compare(runs: Sequence[Measured], rig: Rig, unseen: Sequence[Measured] = ()) -> Compared:
    """Compare each run with the model of a rig; readings are (m, k) mm.

    Runs with the same test and placement share a set-up; so do `unseen` runs, of a different place or radius. Raises
    FileError.
    """
    parts = [_compared(runs, rig, "")] if runs else []
    places: list[tuple[Rig, list[Measured]]] = []
    for run in unseen:
        model = run.rig.modelled_as(rig)
        runs_there = next((its_runs for its_model, its_runs in places if its_model == model), None)
        if runs_there is None:
            places.append((model, runs_there := []))
        runs_there.append(run)
    parts += [_compared(runs_there, model, " at the unseen place") for model, runs_there in places]
    setups: dict[str, SetUp] = {}
    for part in parts:
        setups |= part.setups
    return Compared(
        tuple(run for part in parts for run in part.runs),
        setups,
        tuple(doubt for part in parts for doubt in part.doubts),
        tuple(pose for part in parts for pose in part.poses),
    )


def _compared(runs: Sequence[Measured], rig: Rig, where: str) -> Compared:
    """Compare runs with the model of a rig, with set-ups named after their location."""
    pieces = [
        (run, part) for run, whole in zip(runs, observe_runs(rig, runs), strict=True) for part in by_socket(whole)
    ]
    names = [run.run.manifest.name for run, _ in pieces]
    split_up, doubts = split_by_frame([part for _, part in pieces], names)
    split_up, of_targets = split_by_target(split_up, names)
    doubts += of_targets
    for name, part in zip(names, split_up, strict=True):
        doubts += outside_effect_coverage(rig.effects, part.table.q[part.rows], f"{name}, an effect of the rig file")
    placed = fit_setups(split_up)
    comparisons, poses = [], []
    for (run, _), part in zip(pieces, split_up, strict=True):
        residual = residual_of(part, placed)
        if facts_of(run.table.test).of_places:
            away_um = 1e3 * np.linalg.norm(residual, axis=1)
            rms_um = float(np.sqrt(np.mean(away_um**2)))
            poses.append(PoseComparison(run.run.manifest.name, len(away_um), rms_um, float(away_um.max())))
        else:
            comparisons.append(_comparison(run, part.model, placed[part.setup], part.rows, residual))
    setups = {f"{part.setup}{where}": placed[part.setup] for part in split_up if not part.facts.of_places}
    return Compared(tuple(comparisons), setups, tuple(doubts), tuple(poses))


def _comparison(run: Measured, model: Model, setup: SetUp, rows: Integers, residuals_mm: Array) -> Comparison:
    run = run if run.rig == model.rig else replace(run, rig=model.rig)
    result = result_of(run)
    values = predict(model, run.table, path_of(model, run.table), setup)
    simulated_table = run.table.with_readings(values)
    simulated = evaluate(simulated_table, model.rig, run.u_lag_s, f"{run.path}, simulated", u_gauge_mm=0.0)
    x, measured_curve, unit = curve(result.found, run.table)
    _, simulated_curve, _ = curve(simulated, simulated_table)
    correlation = float(np.corrcoef(measured_curve, simulated_curve)[0, 1]) if np.ptp(simulated_curve) else float("nan")
    return Comparison(
        result=result,
        simulated=simulated,
        x=x,
        measured_curve=measured_curve,
        simulated_curve=simulated_curve,
        unit=unit,
        rows=rows,
        residuals_mm=residuals_mm,
        correlation=correlation,
        rms_um=1000 * rms(residuals_mm),
    )


def curve(result: Evaluated, table: Table) -> tuple[Array, Array, str]:
    """Return the compared curve of a result: positions (n,), values (n,), unit. For tests of other packages it
    consists of the readings.
    """
    match result:
        case CircleResult():
            return np.degrees(PHI), np.degrees(result.residual), "deg"
        case RadialResult():
            return result.cells.target.astype(float), result.deviation_mm, "mm"
        case RepeatabilityResult():
            mean = np.nanmean(result.readings_mm, axis=2)
            return np.arange(mean.size, dtype=float), mean.ravel(), "mm"
    readings = table.readings.ravel()
    return np.arange(readings.size, dtype=float), readings, "mm"
