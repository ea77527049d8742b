"""Comparison of simulation and measurement: simulated from the run's own feedback, with the set-up fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from analysis.diagnosis.evidence.observation import by_socket, outside_effect_coverage, residual_of
from analysis.diagnosis.evidence.placements import observe_runs, split_by_frame, split_by_target
from analysis.diagnosis.evidence.setups import fit_setups
from analysis.procedures.circle.evaluate import CircleResult
from analysis.procedures.radial.evaluate import RadialResult
from analysis.procedures.repeatability.evaluate import RepeatabilityResult
from analysis.procedures.results import Result, result_of
from analysis.procedures.shared.evaluate import Evaluated, evaluate
from analysis.procedures.shared.reduction import PHI
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.model.predict import Model, SetUp, path_of, predict
from analysis.runs.loading import Measured
from analysis.runs.noise.readings import rms
from analysis.runs.tables import Table
from analysis.runs.tabular import Tabular, for_json, table_of_rows
from rigs.rig import Rig

if TYPE_CHECKING:
    from analysis.diagnosis.judge.disagreement import Disagreement


@dataclass(frozen=True)
class Comparison(Tabular):
    """One run. `result` and `simulated` are evaluated in the same way; the curves (n,) at x (n,) are in `unit`. `rows`
    (m,) of the run's table were compared, on a circle those of whole laps; `residuals_mm` (m, k) are the measured less
    the simulated readings of each gauge there, and `rms_um` is their rms. `correlation` is that of the curves."""

    result: Result
    simulated: Evaluated
    x: Array
    measured_curve: Array
    simulated_curve: Array
    unit: str
    rows: Integers
    residuals_mm: Array
    correlation: float
    rms_um: float

    def to_table(self) -> pa.Table:
        """The curves side by side: phi_deg, target or place, then measured, simulated and difference in their unit."""
        where = self.result.measured.table.kind.along
        curves = {"measured": self.measured_curve, "simulated": self.simulated_curve}
        curves["difference"] = self.measured_curve - self.simulated_curve
        return pa.table({where: self.x} | {f"{name}_{self.unit}": values for name, values in curves.items()})

    def to_dict(self) -> dict[str, Any]:
        """The figures side by side in plain types; None where there is no correlation, as of a model without errors."""
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
    """A run of poses beside the model: what the model leaves of them in µm, root mean square and at most."""

    run: str
    poses: int
    rms_um: float
    largest_um: float


@dataclass(frozen=True)
class Compared(Tabular):
    """All runs, their fitted set-ups, and doubts in words; `poses` has the runs that have no gauges. `disagreement` is
    where model and readings disagree, None where that was not asked."""

    runs: tuple[Comparison, ...]
    setups: dict[str, SetUp]
    doubts: tuple[str, ...]
    poses: tuple[PoseComparison, ...] = ()
    disagreement: Disagreement | None = None

    def to_table(self) -> pa.Table:
        """The figures of all runs, a row each: run, figure, measured, u (standard uncertainty), simulated."""
        objects = [comparison.to_dict() for comparison in self.runs]
        rows = [
            {"run": entry["run"], "figure": name, **figure}
            for entry in objects
            for name, figure in entry["figures"].items()
        ]
        return table_of_rows(("run", "figure", "measured", "u", "simulated"), rows)

    def to_dict(self) -> dict[str, Any]:
        """Runs, fitted set-ups and doubts in plain types: what `rig compare --json` prints."""
        setups = {name: {"ball_mm": setup.ball, "zeros_mm": setup.zeros_mm} for name, setup in self.setups.items()}
        plain: dict[str, Any] = for_json(
            {
                "runs": [comparison.to_dict() for comparison in self.runs],
                "poses": [asdict(pose) for pose in self.poses],
                "setup": setups,
                "doubts": self.doubts,
                **(self.disagreement.to_dict() if self.disagreement else {}),
            }
        )
        return plain


def compare(runs: Sequence[Measured], rig: Rig, unseen: Sequence[Measured] = ()) -> Compared:
    """Return each run compared with the model of a rig; readings are (m, k) mm. Runs of one test and placement share
    one set-up; so do `unseen` runs, of another place or radius, among themselves. Raises FileError."""
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
    """Return runs compared with the model of a rig, with set-ups that are called by where they are."""
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
        if run.table.kind.of_places:
            away_um = 1e3 * np.linalg.norm(residual, axis=1)
            rms_um = float(np.sqrt(np.mean(away_um**2)))
            poses.append(PoseComparison(run.run.manifest.name, len(away_um), rms_um, float(away_um.max())))
        else:
            comparisons.append(_comparison(run, part.model, placed[part.setup], part.rows, residual))
    setups = {f"{part.setup}{where}": placed[part.setup] for part in split_up if not part.table.kind.of_places}
    return Compared(tuple(comparisons), setups, tuple(doubts), tuple(poses))


def _comparison(run: Measured, model: Model, setup: SetUp, rows: Integers, residuals_mm: Array) -> Comparison:
    run = run if run.rig == model.rig else replace(run, rig=model.rig)
    result = result_of(run)
    values = predict(model, run.table, path_of(model, run.table), setup)
    simulated_table = run.table.kind.with_readings(run.table, values)
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
    """Return the curve of a result that is compared, the readings of its table where its kind is another package's:
    positions (n,), values (n,), and their unit."""
    match result:
        case CircleResult():
            return np.degrees(PHI), np.degrees(result.residual), "deg"
        case RadialResult():
            return result.cells.target.astype(float), result.deviation_mm, "mm"
        case RepeatabilityResult():
            mean = np.nanmean(result.readings_mm, axis=2)
            return np.arange(mean.size, dtype=float), mean.ravel(), "mm"
    readings = table.kind.readings(table).ravel()
    return np.arange(readings.size, dtype=float), readings, "mm"
