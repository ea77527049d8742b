"""The day on which a figure that grows in a robot's history takes a feature out of its tolerance.

Backlash of a joint moves each target along the motion of that joint; `rms_mm` of poses scales all errors. The newest
ramp of the history goes on at its rate.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.apps.certify.target_errors import Work
from analysis.apps.plant.history import History
from analysis.robot.kinematics.arm import Array, arm_of, drive_angles, forward_and_jacobian
from rigs.rig import Rig

_LONGEST_DAYS = 3650.0
_ROUNDS = 30
Inside = Callable[[Array], float]
"""Probability inside the tolerance for displacements (d, m, 3) mm."""


@dataclass(frozen=True)
class Drift:
    """A growing figure.

    rate, u: growth per day, in degrees of backlash of an axis (from 0), or as a share of the present error (None).
    """

    figure: str
    axis: int | None
    rate: float
    u: float
    newest: dt.date


@dataclass(frozen=True)
class Until:
    """Expected day outside, and its 95 % interval; None beyond ten years."""

    figure: str
    date: dt.date
    earliest: dt.date
    latest: dt.date | None

    def to_dict(self) -> dict[str, Any]:
        days = {name: getattr(self, name) for name in ("date", "earliest", "latest")}
        return {"figure": self.figure} | {name: day.isoformat() if day else None for name, day in days.items()}


def drifts_of(history: History) -> list[Drift]:
    drifts = []
    for series in history.series:
        axis = int(series.figure[6]) - 1 if series.figure.startswith("play_j") else None
        if (axis is None and (series.figure, series.title) != ("rms_mm", "pose")) or series.corrected:
            continue
        for change in series.trend.changes[-1:]:
            rows = np.arange(change.first, len(series.runs))[~series.trend.wild[change.first :]]
            if not change.is_last or change.after <= change.before or len(rows) < 3:
                continue
            days = np.array([series.runs[row].when.timestamp() / 86400 for row in rows])
            (rate, _), covariance = np.polyfit(days, series.values[rows], 1, cov="unscaled")
            scatter = max(series.trend.spread, 1e-9) * np.sqrt(covariance[0, 0])
            unit = series.values[rows][-1] if axis is None else 1.0
            drifts.append(Drift(series.figure, axis, rate / unit, scatter / unit, series.runs[-1].when.date()))
    return drifts


def until(rig: Rig, drift: Drift, work: Work, moved: Array, inside: Inside) -> Until | None:
    """None if a feature is outside already, or inside for ten years.

    work: targets of the feature (m,). moved: draws (d, m, 3) mm of their displacements now.
    """
    growth = moved
    if drift.axis is not None:
        arm = arm_of(rig.robot)
        motion = forward_and_jacobian(arm.by_drives, drive_angles(arm, work.q))[1][:, :3, drift.axis]
        side = np.sign(np.nan_to_num((work.came_from - work.q)[:, drift.axis]))
        sides = np.where(side == 0, np.random.default_rng(0).choice([-1.0, 1.0], moved.shape[:2]), side)
        growth = np.radians(0.5) * sides[..., None] * motion  # half of a degree of backlash

    def day(rate: float) -> dt.date | None:
        low, high = 0.0, _LONGEST_DAYS
        if rate <= 0 or inside(moved + high * rate * growth) > 0.5:
            return None
        for _ in range(_ROUNDS):
            middle = (low + high) / 2
            low, high = (middle, high) if inside(moved + middle * rate * growth) > 0.5 else (low, middle)
        return drift.newest + dt.timedelta(days=round(low))

    expected, earliest = day(drift.rate), day(drift.rate + 2 * drift.u)
    if inside(moved) <= 0.5 or expected is None or earliest is None:
        return None
    return Until(drift.figure, expected, earliest, day(drift.rate - 2 * drift.u))
