"""Comparison of simulation and measurement: simulated from the run's feedback, with a fitted set-up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from analysis.diagnosis.evidence.observation import ObservedRun, by_socket, outside_effect_coverage, residual_of
from analysis.diagnosis.evidence.placements import observe_runs, split_by_frame, split_by_target
from analysis.diagnosis.evidence.setups import fit_setups
from analysis.diagnosis.judge.residuals import Curve, Map, ResidualPlace, Staircase
from analysis.procedures.circle import CircleResult
from analysis.procedures.radial import RadialResult
from analysis.procedures.repeatability import RepeatabilityResult
from analysis.procedures.results import Result, result_of
from analysis.procedures.shared.lap_curve import PHI
from analysis.procedures.shared.test_kind import Evaluated, evaluate, facts_of, labels_of, path_of, predict
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.predict import Model, SetUp, SetUps
from analysis.runs.loading import Measured
from analysis.runs.noise.readings import rms
from analysis.runs.tables import Table
from analysis.runs.tabular import Tabular, for_json, pick_fields, table_of_rows
from rigs.rig import Rig


@dataclass(frozen=True)
class LocatedResidual:
    """Residual of the model of a rig by place, largest sigma first, excluding the effects of the model (before) and
    including them (after).

    `staircase`: a step per effect of the rig file, and a final step for the calibration; None for a model with no
    effects. `floor_um`: noise of a run.
    """

    rig: Rig
    where: tuple[ResidualPlace, ...]
    curves: tuple[Curve, ...]
    maps: tuple[Map, ...]
    staircase: Staircase | None
    floor_um: float

    def to_dict(self) -> dict[str, Any]:
        names = [*(f"effect {k}" for k in range(1, len(self.rig.effects) + 1)), "calibration"]
        steps = self.staircase.to_dict(names) if self.staircase else None
        return {"where": [place.to_dict() for place in self.where], "staircase": steps}


@dataclass(frozen=True)
class Comparison(Tabular):
    """Comparison of simulation and measurement of a run with gauges."""

    result: Result
    simulated: Evaluated
    x: Array
    """Circle angle, target or place (n,) of the curves, which are in `unit`."""
    measured_curve: Array
    simulated_curve: Array
    unit: str
    rows: Integers
    """Compared rows (m,) of the table; on a circle those of complete laps."""
    residuals_mm: Array
    """Measured minus simulated readings (m, k)."""
    correlation: float
    rms_um: float

    def to_table(self) -> pa.Table:
        """The curves side by side: phi_deg, target or place, then measured, simulated and difference in their unit."""
        where = labels_of(self.result.measured.table.test).along
        curves = {"measured": self.measured_curve, "simulated": self.simulated_curve}
        curves["difference"] = self.measured_curve - self.simulated_curve
        return pa.table({where: self.x} | {f"{name}_{self.unit}": values for name, values in curves.items()})

    def to_dict(self) -> dict[str, Any]:
        """The figures as plain types. The correlation is None if undefined, as for an error-free model."""
        simulated = self.simulated.figures
        plain: dict[str, Any] = for_json(
            {
                "run": str(self.result.measured.path),
                "test": self.result.test,
                "figures": {
                    name: {"measured": figure.value, "u": figure.u, "simulated": simulated[name].value}
                    for name, figure in self.result.found.figures.items()
                    if name in simulated
                },
                "correlation": self.correlation,
                "rms_um": self.rms_um,
            }
        )
        return plain


@dataclass(frozen=True)
class PoseComparison:
    """Comparison of a pose run: the residual in µm, rms and maximum.

    A run whose instrument moved has a comparison for each part. rows (poses,): rows of its table, from 0. error_mm
    (poses, 3): measured minus simulated position, in the frame of the base.
    """

    run: str
    poses: int
    rms_um: float
    largest_um: float
    path: Path
    rows: Integers
    error_mm: Array

    def to_dict(self) -> dict[str, Any]:
        return pick_fields(self, "run", "poses", "rms_um", "largest_um")


@dataclass(frozen=True)
class Compared(Tabular):
    """Comparison of simulation and measurement of several runs, with gauges (`runs`) and without (`poses`).
    disagreement: places with large residuals, if requested.
    """

    runs: tuple[Comparison, ...]
    setups: dict[str, SetUp]
    doubts: tuple[str, ...]
    poses: tuple[PoseComparison, ...] = ()
    disagreement: LocatedResidual | None = None

    def to_table(self) -> pa.Table:
        """A row for each run and figure: run, figure, measured, u (standard uncertainty), simulated."""
        objects = [comparison.to_dict() for comparison in self.runs]
        rows = [
            {"run": entry["run"], "figure": name, **figure}
            for entry in objects
            for name, figure in entry["figures"].items()
        ]
        return table_of_rows(("run", "figure", "measured", "u", "simulated"), rows)

    def to_dict(self) -> dict[str, Any]:
        """Runs, fitted set-ups and doubts as plain types, for `rig compare --json`."""
        setups = {name: {"ball_mm": setup.ball, "zeros_mm": setup.zeros_mm} for name, setup in self.setups.items()}
        plain: dict[str, Any] = for_json(
            {
                "runs": [comparison.to_dict() for comparison in self.runs],
                "poses": [pose.to_dict() for pose in self.poses],
                "setup": setups,
                "doubts": self.doubts,
                **(self.disagreement.to_dict() if self.disagreement else {}),
            }
        )
        return plain


def compare(runs: Sequence[Measured], rig: Rig, unseen: Sequence[Measured] = ()) -> Compared:
    """Compare each run with the model of a rig. Raises FileError.

    Runs with the same test and placement share a set-up; so do `unseen` runs, of a different place or radius.
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


def residuals_mm(runs: Sequence[Measured], rig: Rig) -> Array:
    """The readings (n,) of all runs minus those of the model of a rig, with fitted set-ups. Raises FileError."""
    pieces, placed, _ = _placed(runs, rig)
    return np.concatenate([residual_of(part, placed).ravel() for _, part in pieces])


def _placed(runs: Sequence[Measured], rig: Rig) -> tuple[list[tuple[Measured, ObservedRun]], SetUps, list[str]]:
    """The parts of the runs that share a set-up, each with its run, the fitted set-ups, and doubts."""
    pieces = [
        (run, part) for run, whole in zip(runs, observe_runs(rig, runs), strict=True) for part in by_socket(whole)
    ]
    names = [run.run.manifest.name for run, _ in pieces]
    split_up, doubts = split_by_frame([part for _, part in pieces], names)
    split_up, of_targets = split_by_target(split_up, names)
    doubts += of_targets
    for name, part in zip(names, split_up, strict=True):
        doubts += outside_effect_coverage(rig.effects, part.table.q[part.rows], f"{name}, an effect of the rig file")
    return [(run, part) for (run, _), part in zip(pieces, split_up, strict=True)], fit_setups(split_up), doubts


def _compared(runs: Sequence[Measured], rig: Rig, where: str) -> Compared:
    pieces, placed, doubts = _placed(runs, rig)
    comparisons, poses = [], []
    for run, part in pieces:
        residual = residual_of(part, placed)
        if facts_of(run.table.test).of_places:
            away_um = 1e3 * np.linalg.norm(residual, axis=1)
            rms_um = float(np.sqrt(np.mean(away_um**2)))
            to_base = (placed[part.setup].T_instrument_world @ part.model.arm.T_world_base)[:3, :3]
            size = len(away_um), rms_um, float(away_um.max())
            poses.append(PoseComparison(run.run.manifest.name, *size, run.path, part.rows, residual @ to_base))
        else:
            comparisons.append(_comparison(run, part.model, placed[part.setup], part.rows, residual))
    setups = {f"{part.setup}{where}": placed[part.setup] for _, part in pieces if not part.facts.of_places}
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
    """The compared curve of a result: positions (n,), values (n,), unit. For tests of other packages it consists of the
    readings.
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
