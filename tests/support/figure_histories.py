"""Histories of figures of a robot, made apart from what looks for changes in them.

A robot is visited over months: a visit mounts ball and gauges once and drives its tests. What scatters, and how, is
drawn for each robot from the table of real cells: scatter from run to run with heavy tails and of the kind that ranges
have (never below zero), a share of each mounting that all its runs have in common, the temperature of the day, of the
week and of the season, a gauge's zero that drifts while it warms up, coarse gauges, wild runs alone and in pairs.
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
    """The play of axis 2 grows from visit `begin`, in so many visits (1: at once), by all of AFTER − BEFORE."""

    begin: int
    visits: int

    def of(self, visit: Array) -> Array:
        """Play (n,) in degrees above BEFORE_DEG at visits (n,)."""
        grown: Array = (AFTER_DEG - BEFORE_DEG) * np.clip((visit - self.begin + 1) / self.visits, 0.0, 1.0)
        return grown


@dataclass(frozen=True)
class World:
    """What a robot's figures scatter by, all relative to the scatter of a run: a mounting, the season, the weather
    (an autoregression over days), the warm-up of a visit, the step of the readings; tails: degrees of freedom of the
    scatter; wild: share of wild runs; season_days: length of a season."""

    mounting: float
    season: float
    weather: float
    warm_up: float
    step: float
    tails: float
    wild: float
    season_days: float = 365.0


def drawn_world(rng: np.random.Generator) -> World:
    """A cell's own."""
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
    """The runs of a robot in order of time, each visit with one run of each test. world: fields of `World` that are not
    drawn."""
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
    """Runs as they come from a directory, and the limits in their rig file."""
    return Collected("ur10e", tuple(runs), (), (), limits or Limits())


def _weather(days: Array, rng: np.random.Generator) -> Array:
    """A temperature (n,) that forgets itself in some days, of standard deviation 1."""
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
    """A figure over the visits (n,), and the u that each run states for it."""
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
        # What grows also widens the bands a little, as it does on a robot.
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
