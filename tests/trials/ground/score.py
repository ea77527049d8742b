"""Scoring answers: CSV files beside truths, each figure with a 95 % interval.

The interval is that of a bootstrap that draws whole neighbourhoods, because errors of neighbours go together. What is
not answered counts as what the nominal arm says.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.trials.ground.plain_arm import XYZ, Array, read_columns
from tests.trials.ground.tasks import Task, read_tasks

DRAWS = 1000
"""Of the bootstrap: an interval's ends are then known to a twentieth of its width."""


@dataclass(frozen=True)
class Figure:
    """A value with its interval from low to high, nan where there is none, of so many cases or poses."""

    value: float
    low: float
    high: float
    of: int

    def to_dict(self) -> dict[str, float | int | None]:
        """In plain types, None for what is not known."""
        values = {"value": self.value, "low": self.low, "high": self.high}
        return {key: one if math.isfinite(one) else None for key, one in values.items()} | {"of": self.of}


Scores = dict[str, dict[str, Figure]]
"""By row of the table and by name of the figure."""


def scored(directory: Path, answers: Path) -> Scores:
    """Figures of a directory of answers, beside the truth of a directory of tasks.

    The figures of a row of poses: `error_um` rms of the distance, `nominal_um` that of the nominal arm, `removed` the
    share of it that is gone, `answered` the share of poses that were, and `error_over_u` rms, `within_2u` share, `u_um`
    median where u was told.
    """
    truth = directory / "truth"
    tasks = read_tasks(truth)
    rows = dict.fromkeys(task.row for task in tasks)
    return {row: pose_figures([judged(task, truth, answers) for task in tasks if task.row == row]) for row in rows}


@dataclass(frozen=True)
class Judged:
    """Distances (n,) mm of the answered and of the nominal places, u (n,) mm or nan, whether answered (n,), and the
    neighbourhood of each (n,)."""

    error: Array
    nominal: Array
    u: Array
    answered: Array
    group: Array


def judged(task: Task, truth: Path, answers: Path) -> Judged:
    """Hold the answer of a task against its truth; a pose that is missing or no number counts as the nominal arm's."""
    true = read_columns(truth / f"{task.name}.csv")
    places = np.column_stack([true[name] for name in XYZ])
    nominal = np.column_stack([true[f"nominal_{axis}_mm"] for axis in "xyz"])
    said, u = nominal.copy(), np.full(len(places), np.nan)
    answered = np.zeros(len(places))
    where = {int(pose): k for k, pose in enumerate(true["pose"])}
    for row in rows_of(answers / f"{task.name}.csv"):
        k = where.get(int(number(row.get("pose"))) if math.isfinite(number(row.get("pose"))) else 0)
        place = [number(row.get(name)) for name in XYZ]
        if k is not None and np.isfinite(place).all():
            said[k], u[k], answered[k] = place, number(row.get("u_mm")), 1.0
    distance = np.linalg.norm(said - places, axis=1)
    return Judged(distance, np.linalg.norm(nominal - places, axis=1), np.where(u > 0, u, np.nan), answered,
                  np.array([f"{task.name} {group}" for group in true["group"]]))  # fmt: skip


def pose_figures(parts: Sequence[Judged]) -> dict[str, Figure]:
    """Figures of all poses of a row."""
    error, nominal, u, answered = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("error", "nominal", "u", "answered")
    )
    groups = np.unique(np.concatenate([part.group for part in parts]), return_inverse=True)[1]

    def of(figure: Callable[[Array], float], chosen: Array) -> Figure:
        own = np.flatnonzero(chosen)
        if not len(own):
            return Figure(math.nan, math.nan, math.nan, 0)
        members = [own[groups[own] == group] for group in np.unique(groups[own])]
        rng = np.random.default_rng(0)
        drawn = [
            figure(np.concatenate([members[k] for k in rng.integers(len(members), size=len(members))]))
            for _ in range(DRAWS)
        ]
        low, high = np.percentile(drawn, [2.5, 97.5])
        return Figure(figure(own), float(low), float(high), len(own))

    def rms(values: Array) -> float:
        return float(np.sqrt(np.mean(values**2)))

    every, told = np.ones(len(error), dtype=bool), np.isfinite(u) & (answered > 0)
    return {
        "error_um": of(lambda at: 1e3 * rms(error[at]), every),
        "nominal_um": of(lambda at: 1e3 * rms(nominal[at]), every),
        "removed": of(lambda at: 1 - rms(error[at]) / rms(nominal[at]), every),
        "answered": of(lambda at: float(answered[at].mean()), every),
        "error_over_u": of(lambda at: rms(error[at] / u[at]), told),
        "within_2u": of(lambda at: float(np.mean(error[at] <= 2 * u[at])), told),
        "u_um": of(lambda at: 1e3 * float(np.median(u[at])), told),
    }


def rows_of(path: Path) -> list[dict[str, str]]:
    """Rows of an answer; none where the file is missing or empty."""
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", errors="replace", newline="") as file:
        return [{key: value or "" for key, value in row.items() if key} for row in csv.DictReader(file)]


def number(text: str | None) -> float:
    try:
        return float(text or "")
    except ValueError:
        return math.nan
