"""Differences between commanded and measured joint angles, and their causes.

A difference correlated with the gravity torque comes from a compliant drive or a controller without integral action. A
difference correlated with the speed is a following error. rig uses the measured angles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from analysis.procedures.shared.finding import Finding
from analysis.robot.kinematics.arm import Array, arm_of
from analysis.robot.model.scene import load_of, pull
from analysis.runs.loading import Measured
from analysis.runs.table_rows import Rows

COMMANDS = "commands"
_LEAST_DEG = 0.01
"""Smallest reported rms difference. A joint error below it moves a tool at one metre by less than 0.2 mm."""
_FEWEST = 6
"""Minimum number of rows for a correlation."""


@dataclass(frozen=True)
class CommandError:
    """Following error of an axis: measured minus commanded angle in degrees, and its correlation with the gravity
    torque and with the speed. A correlation is None if the torque or speed hardly changes.
    """

    axis: int
    mean_deg: float
    rms_deg: float
    with_load: float | None
    with_speed: float | None

    @property
    def words(self) -> str:
        """A sentence with the figures of the axis."""
        reasons = [("load", self.with_load), ("speed", self.with_speed)]
        known = [f"{name} {value:+z.2f}" for name, value in reasons if value is not None]
        correlation = f", correlation with {', with '.join(known)}" if known else ""
        return f"axis {self.axis} mean {self.mean_deg:+z.4f}°, rms {self.rms_deg:.4f}°{correlation}"


def command_errors(run: Measured) -> tuple[CommandError, ...]:
    """Following error of each axis; empty if the run lacks commanded or measured angles."""
    source = run.run.table
    both = None if source is None else _both_angles(Rows(source))
    if both is None:
        return ()
    measured, commanded = both
    off = np.degrees(measured - commanded)
    axes = off.shape[1]
    load = (
        pull(arm_of(run.rig.robot), load_of(run.rig.robot), measured).torque
        if axes == len(run.rig.robot.axes)
        else None
    )
    t_s = Rows(source).times() if source is not None and run.table.swept else None
    speed = None if t_s is None else np.gradient(measured, t_s, axis=0)
    return tuple(
        CommandError(
            axis=k + 1,
            mean_deg=float(off[:, k].mean()),
            rms_deg=float(np.sqrt((off[:, k] ** 2).mean())),
            with_load=None if load is None else _correlation(off[:, k], load[:, k]),
            with_speed=None if speed is None else _correlation(off[:, k], speed[:, k]),
        )
        for k in range(axes)
    )


def command_findings(run: Measured) -> Iterator[Finding]:
    """A finding for the axes with a considerable following error."""
    large = [error for error in command_errors(run) if error.rms_deg > _LEAST_DEG]
    if not large:
        return
    which = "commanded" if _has_column(run, "q1_measured_deg") else "measured"
    fact = f"measured minus commanded angles: {'; '.join(error.words for error in large)}; the {which} angles are used"
    remedy = "a difference that varies with load or speed comes from the drives, not from the geometry of the arm"
    columns = tuple(f"q{error.axis}_deg" for error in large)
    yield Finding(COMMANDS, "likely", columns, "angles that were not reached", fact, remedy)


def _has_column(run: Measured, name: str) -> bool:
    return run.run.table is not None and name in run.run.table.column_names


def _both_angles(rows: Rows) -> tuple[Array, Array] | None:
    """Measured and commanded angles (n, axes) rad of a table; None if one of them is missing."""
    axes = range(1, rows.axes + 1)
    for other, is_measured in (("measured", True), ("commanded", False)):
        names = tuple(f"q{axis}_{other}_deg" for axis in axes)
        if not rows.has(names):
            continue
        try:
            angles = np.radians(np.array([rows.columns[name].to_pylist() for name in names], dtype=float).T)
        except ValueError:  # a column of text
            return None
        return (angles, rows.q) if is_measured else (rows.q, angles)
    return None


def _correlation(off: Array, cause: Array) -> float | None:
    """Correlation of a difference with a cause (n,); None if either hardly changes."""
    if len(off) < _FEWEST or np.ptp(off) < 1e-9 or np.ptp(cause) < 1e-9:
        return None
    return float(np.corrcoef(off, cause)[0, 1])
