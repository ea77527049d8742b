"""What every evaluation refuses, each in one line with its remedy."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array
from rigs.errors import FileError


def hold_numbers(where: str, **columns: Array) -> None:
    """Raises FileError where a column (n, …) has a value that is not a number."""
    for name, values in columns.items():
        if np.isfinite(values).all():
            continue
        bad = np.asarray(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))
        if bad.all():
            problem = f"{name} holds no valid number in any of its {len(bad)} rows"
            raise FileError(where, problem, "check that its instrument measures and sends, and measure again")
        row = int(np.argmax(bad)) + 1
        raise FileError(where, f"{name} of row {row} is not a number ({bad.sum()} such rows)", "remove such rows")


def hold_alive(where: str, **readings: Array) -> None:
    """Raises FileError where a gauge read the same all along: nothing real stands so still."""
    for name, values in readings.items():
        if len(values) > 1 and np.ptp(values) == 0:
            remedy = "check that the gauge touches and sends (a simulation needs noise), and measure again"
            raise FileError(where, f"{name} reads {values[0]:g} mm in all {len(values)} rows", remedy)


def hold_radius(where: str, radius_mm: float) -> None:
    """Raises FileError for a radius that is not a positive number."""
    if not (np.isfinite(radius_mm) and radius_mm > 0):
        raise FileError(where, f"a radius of {radius_mm:g} mm is impossible", "correct radius_mm in the rig file")
