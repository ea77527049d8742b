"""Histories of robot figures, generated independently of the change detection.

A robot is visited over months. Each visit mounts ball and gauges once and performs all tests. The scatter of each robot
is drawn from a table of real cells. It includes heavy-tailed, non-negative scatter between runs; a contribution common
to all runs of a mounting; daily, weekly and seasonal temperature; warm-up drift of a gauge zero; coarse resolution; and
single or paired outliers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np

from analysis.apps.plant.collect import Collected
from analysis.apps.plant.records import RunRecord
from analysis.procedures.shared.quantity import Quantity
from analysis.robot.kinematics.arm import Array
from rigs.schema.limits import Limits

CIRCLES = (("yaw", "acw"), ("yaw", "cw"), ("roll", "acw"), ("roll", "cw"))
_CIRCLE_FIGURES = {
    "band_deg": (0.05, 0.3),
    "circular_deviation_mm": (0.05, 0.3),
    **{f"play_j{axis}_deg": (0.0005, 0.02) for axis in range(1, 7)},
}
GROWING = "play_j2_deg"
BEFORE_DEG, AFTER_DEG = 0.010, 0.024
_BEGAN = datetime(2026, 1, 5, 8, tzinfo=UTC)


@dataclass(frozen=True)
class Growth:
    """Growth of the backlash of axis 2 by AFTER − BEFORE, from visit `begin` over a number of visits (1: at once)."""

    begin: int
    visits: int

    def of(self, visit: Array) -> Array:
        """Backlash (n,) in degrees above BEFORE_DEG at visits (n,)."""
        grown: Array = (AFTER_DEG - BEFORE_DEG) * np.clip((visit - self.begin + 1) / self.visits, 0.0, 1.0)
        return grown


@dataclass(frozen=True)
class World:
    """Sources of scatter of a robot's figures, relative to the scatter of a run: mounting, season, weather (an
    autoregression over days), warm-up within a visit, and resolution. tails: degrees of freedom of the scatter;
    wild: share of outlier runs; season_days: length of a season.
    """

    mounting: float
    season: float
    weather: float
    warm_up: float
    step: float
    tails: float
    wild: float
    season_days: float = 365.0


def drawn_world(rng: np.random.Generator) -> World:
    """Return random scatter properties of a cell."""
    return World(
        mounting=float(rng.uniform(0.0, 1.0)),
        season=float(rng.uniform(0.0, 1.0)),
        weather=float(rng.uniform(0.0, 1.0)),
        warm_up=float(rng.uniform(0.0, 0.5)),
        step=float(rng.uniform(0.0, 0.5)),
        tails=float(rng.uniform(3.0, 12.0)),
        wild=float(rng.uniform(0.0, 0.02)),
    )


def drawn_history(
    seed: int, visits: int, tests: Sequence[tuple[str, str]] = CIRCLES, growth: Growth | None = None, **world: float
) -> list[RunRecord]:
    """Runs of a robot in order of time, with one run of each test per visit. world: fields of `World`
    with fixed values.
    """
    rng = np.random.default_rng((seed, visits, len(tests)))
    cell = replace(drawn_world(rng), **world)
    days = np.cumsum(rng.exponential(2.0, visits))
    hours = np.floor(rng.uniform(0, 9, visits))
    at = days[:, None] + (hours[:, None] + np.arange(len(tests)) * 0.25) / 24
    weather = _weather(days, rng)
    season = np.sin(2 * np.pi * (days / cell.season_days + rng.uniform()))
    grown = growth.of(np.arange(visits)) if growth else np.zeros(visits)
    figures: list[dict[str, tuple[Array, float]]] = []
    for order, _ in enumerate(tests):
        figures.append({
            name: _figure(name, limits, cell, (season, weather), order, grown, rng)
            for name, limits in _CIRCLE_FIGURES.items()
        })  # fmt: skip
    return [
        _record(visit, test, _BEGAN + timedelta(days=float(at[visit, k])), figures[k])
        for visit in range(visits)
        for k, test in enumerate(tests)
    ]


def collected(runs: Sequence[RunRecord], limits: Limits | None = None) -> Collected:
    """Return runs as read from a directory, with the limits of their rig file."""
    return Collected("ur10e", tuple(runs), (), (), limits or Limits())


def _weather(days: Array, rng: np.random.Generator) -> Array:
    """A temperature (n,) with a correlation time of some days and standard deviation 1."""
    kept = np.exp(-np.diff(days, prepend=-1e9) / rng.uniform(2.0, 10.0))
    level, found = 0.0, []
    for share in kept:
        level = share * level + math.sqrt(1 - share**2) * rng.standard_normal()
        found.append(level)
    return np.array(found)


def _figure(
    name: str,
    limits: tuple[float, float],
    cell: World,
    temperature: tuple[Array, Array],
    order: int,
    grown: Array,
    rng: np.random.Generator,
) -> tuple[Array, float]:
    """A figure over the visits (n,), and its standard uncertainty in each run."""
    visits = len(grown)
    size = math.exp(rng.uniform(*np.log(limits)))
    share = math.exp(rng.uniform(math.log(0.01), math.log(0.1)))  # 1 to 10 % of a band
    scatter = math.exp(rng.uniform(math.log(0.0003), math.log(0.003))) if "play" in name else share * size
    season, weather = temperature
    runs = rng.standard_t(cell.tails, visits) / math.sqrt(cell.tails / (cell.tails - 2))
    runs += cell.mounting * rng.standard_normal(visits)
    runs += cell.season * rng.uniform(-1, 1) * season + cell.weather * rng.uniform(-1, 1) * weather
    runs += cell.warm_up * (1 - math.exp(-order)) * np.abs(rng.standard_normal(visits))
    wild = rng.uniform(size=visits) < cell.wild
    wild |= np.roll(wild, 1) & (rng.uniform(size=visits) < 0.3)
    runs += wild * rng.choice([-1, 1]) * np.exp(rng.uniform(np.log(5), np.log(30), visits))
    if "play" in name:
        values = (BEFORE_DEG + grown if name == GROWING else size) + scatter * runs
    else:
        # As on a real robot, growing backlash also widens the bands slightly.
        values = size * np.exp(share * np.clip(runs, -20, 20)) + 0.5 * grown * (name == "band_deg")
    if cell.step:
        values = np.round(values / (cell.step * scatter)) * cell.step * scatter
    return values, scatter * rng.uniform(0.2, 1.0)


def _record(visit: int, test: tuple[str, str], when: datetime, figures: dict[str, tuple[Array, float]]) -> RunRecord:
    name = f"{visit:04d}-{test[0]}-{test[1]}"
    quantities = {
        figure: Quantity(float(values[visit]), u, figure.rsplit("_", 1)[1]) for figure, (values, u) in figures.items()
    }
    return RunRecord(name, name, "ur10e", when.isoformat(), *test, "", figures=quantities)
