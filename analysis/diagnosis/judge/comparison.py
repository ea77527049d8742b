"""Result of a comparison: measured and simulated values, and places with large residuals."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import pyarrow as pa

from analysis.diagnosis.judge.residuals import Curve, Map, ResidualPlace, Staircase
from analysis.procedures.results import Result
from analysis.procedures.shared.test_kind import Evaluated, labels_of
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.model.predict import SetUp
from analysis.runs.tabular import Tabular, for_json, table_of_rows
from rigs.rig import Rig


@dataclass(frozen=True)
class LocatedResidual:
    """Residual of the model of a rig by place, largest sigma first, and residuals of circles and targets
    excluding the effects of the model (before) and including them (after).

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
        """Return plain types, with the keys of a diagnosis."""
        names = [*(f"effect {k}" for k in range(1, len(self.rig.effects) + 1)), "calibration"]
        steps = self.staircase.to_dict(names) if self.staircase else None
        return {"where": [place.to_dict() for place in self.where], "staircase": steps}


@dataclass(frozen=True)
class Comparison(Tabular):
    """Comparison of simulation and measurement of a run with gauges.

    result: the evaluated measurement.
    simulated: the simulation, evaluated in the same way.
    x (n,): circle angle, target or place of the curves.
    measured_curve, simulated_curve (n,): curves in `unit`.
    rows (m,): compared rows of the table; on a circle the rows of complete laps.
    residuals_mm (m, k): measured minus simulated readings of each gauge.
    correlation: correlation of the curves.
    rms_um: rms of the residuals in µm.
    """

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
        """Return the curves side by side: phi_deg, target or place, then measured, simulated and difference in their
        unit.
        """
        where = labels_of(self.result.measured.table.test).along
        curves = {"measured": self.measured_curve, "simulated": self.simulated_curve}
        curves["difference"] = self.measured_curve - self.simulated_curve
        return pa.table({where: self.x} | {f"{name}_{self.unit}": values for name, values in curves.items()})

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain types. The correlation is None if undefined, as for an error-free model."""
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
    """Comparison of a pose run: the residual in µm, rms and maximum."""

    run: str
    poses: int
    rms_um: float
    largest_um: float


@dataclass(frozen=True)
class Compared(Tabular):
    """Comparison of simulation and measurement of several runs.

    runs: comparison of each run with gauges.
    setups: fitted set-ups by name.
    doubts: warnings as text.
    poses: comparison of each run without gauges.
    disagreement: places with large residuals; None if not requested.
    """

    runs: tuple[Comparison, ...]
    setups: dict[str, SetUp]
    doubts: tuple[str, ...]
    poses: tuple[PoseComparison, ...] = ()
    disagreement: LocatedResidual | None = None

    def to_table(self) -> pa.Table:
        """Return a row for each run and figure: run, figure, measured, u (standard uncertainty), simulated."""
        objects = [comparison.to_dict() for comparison in self.runs]
        rows = [
            {"run": entry["run"], "figure": name, **figure}
            for entry in objects
            for name, figure in entry["figures"].items()
        ]
        return table_of_rows(("run", "figure", "measured", "u", "simulated"), rows)

    def to_dict(self) -> dict[str, Any]:
        """Return runs, fitted set-ups and doubts as plain types, for `rig compare --json`."""
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
