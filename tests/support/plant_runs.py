"""Run directories of many robots, created in about 20 ms each from a few simulated runs.

Readings depend almost linearly on small backlashes. Each test is therefore simulated once without backlash and once
with backlash of each axis. A run is a combination of these according to the backlashes of its robot on that day, with
scatter between runs and gauge noise. The files are written by the product's own store. Each run depends only on the
seed, its robot and its number, so a plant can be extended later.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from pathlib import Path

import numpy as np
import pyarrow as pa

from analysis.procedures.simulate import simulate
from analysis.robot.kinematics.arm import Array
from analysis.runs.tables import columns_of
from daq.store import table_run, write_table_run
from rigs.effects import Backlash
from rigs.load import load
from rigs.schema.vocabulary import CIRCLES, Direction, TestName

BEGAN = datetime(2025, 12, 1, 6, tzinfo=UTC)
CELL = "ur10e"
_AXES = 5
"""Number of axes with backlash. Axis 6 hardly turns in the tests of the hemisphere."""
_STEP_DEG = 0.02
"""Simulated backlash, similar to the combined values."""
_ROWS = 240
"""Number of rows kept of a circle: sufficient for its figures, and a tenth of a real recording."""
_LIMITS = """limits:
  data_sheet_rp_mm: 0.05
  repeatability: {reversal_mean_mm: {watch: 0.20, fail: 0.26}, rp_mean_mm: {watch: 0.04, fail: 0.06}}
"""
"""Limits that replace the shipped ones. A robot with normal backlash conforms; one with grown backlash fails."""


@dataclass(frozen=True)
class Robot:
    """A robot of a plant: backlashes (5,) of its axes; axis, amount and first day of a growth; scatter of a backlash
    between runs, and noise of the gauges.
    """

    name: str
    plays_deg: Array
    axis: int
    grown_deg: float
    grows_on_day: float
    scatter_deg: float
    noise_mm: float

    def plays_on(self, day: float) -> Array:
        """Backlashes (5,) in degrees on a day after the start of the plant."""
        grown = np.zeros(_AXES)
        grown[self.axis] = self.grown_deg * (day >= self.grows_on_day)
        return self.plays_deg + grown


@dataclass(frozen=True)
class _Simulated:
    """A test without backlash, and the change of its readings (5, n, gauges) per degree of backlash of each axis."""

    table: pa.Table
    g_mm: Array
    by_play_mm: Array


def robot_of(number: int, seed: int, days: float) -> Robot:
    """Return robot `number` of a plant measured for `days`. The backlash of every third robot grows."""
    rng = np.random.default_rng((seed, number))
    return Robot(
        name=f"robot-{number:03d}",
        plays_deg=rng.uniform(0.002, 0.008, _AXES),
        axis=int(rng.integers(1, 3)),  # shoulder or elbow, which carry the largest load
        grown_deg=float(rng.uniform(0.01, 0.03)) if number % 3 == 0 else 0.0,
        grows_on_day=float(rng.uniform(0.3, 0.8)) * days,
        scatter_deg=float(rng.uniform(0.0003, 0.001)),
        noise_mm=float(rng.uniform(0.001, 0.004)),
    )


def known_robot(number: int, days: float, grown_deg: float) -> Robot:
    """A robot with backlashes of 0.003° in all axes. The third grows by `grown_deg` after half of the days."""
    drawn = robot_of(number, 0, days)
    plays_deg = np.full(_AXES, 0.003)
    return replace(drawn, plays_deg=plays_deg, axis=2, grown_deg=grown_deg, grows_on_day=days / 2)


def write_visits(
    directory: Path,
    robot: Robot,
    days: Sequence[float],
    tests: Sequence[str] = ("repeatability",),
    seed: int = 0,
) -> Iterator[Path]:
    """Write the runs of a robot, one of each test on each of these days after BEGAN, and yield their paths."""
    _, text = load(f"{CELL}-cell")
    unlimited = re.sub(r"^limits:\n(  .*\n)+", "", text, flags=re.M)
    own = unlimited.replace(f"name: {CELL}", f"name: {robot.name}", 1) + _LIMITS
    for day in days:
        for test in tests:
            yield _write(directory, robot, day, test, own, seed)


def _write(directory: Path, robot: Robot, day: float, title: str, rig_text: str, seed: int) -> Path:
    test, direction = _words(title)
    drawn = int.from_bytes(hashlib.sha256(f"{seed} {robot.name} {day} {title}".encode()).digest()[:8])
    rng = np.random.default_rng(drawn)
    base = _simulated(test, direction)
    plays_deg = robot.plays_on(day) + robot.scatter_deg * rng.standard_normal(_AXES)
    g_mm = base.g_mm + np.tensordot(plays_deg, base.by_play_mm, axes=1)
    g_mm = g_mm + robot.noise_mm * rng.standard_normal(g_mm.shape)
    table = base.table
    for k in range(g_mm.shape[1]):
        name = f"g{k + 1}_mm"
        table = table.set_column(table.schema.get_field_index(name), table.schema.field(name), [g_mm[:, k]])
    when = BEGAN + timedelta(days=day)
    path = directory / f"{when:%Y%m%dT%H%M%S}Z_{robot.name}-{title.replace(' ', '-')}"
    run = table_run(
        path,
        table,
        test=test,
        direction=direction,
        rig_name=robot.name,
        rig_text=rig_text,
        operator="plant",
        source=f"simulated, seed {seed}",
        source_sha256=hashlib.sha256(repr(robot).encode()).hexdigest(),
    )
    # The store writes the current time; replace it by the day of the measurement.
    dated = run.manifest.model_copy(update={"started": when.isoformat(timespec="milliseconds")})
    write_table_run(replace(run, manifest=dated), path)
    return path


def _words(title: str) -> tuple[TestName, Direction | None]:
    test, _, direction = title.partition(" ")
    return test, direction or None  # type: ignore[return-value]


@lru_cache
def _simulated(test: TestName, direction: Direction | None) -> _Simulated:
    rig, _ = load(f"{CELL}-cell")
    still = columns_of(simulate(rig, test, direction, None, []))
    names = [name for name in ("g1_mm", "g2_mm") if name in still.schema.names]
    kept = np.arange(0, len(still), max(1, len(still) // _ROWS) if test in CIRCLES else 1)

    def readings(table: pa.Table) -> Array:
        return np.stack([table[name].to_numpy()[kept] for name in names], axis=1)

    g_mm = readings(still)
    moved = (
        readings(columns_of(simulate(rig, test, direction, None, [Backlash(axis=axis + 1, width_deg=_STEP_DEG)])))
        for axis in range(_AXES)
    )
    return _Simulated(still.take(kept), g_mm, np.stack([(one - g_mm) / _STEP_DEG for one in moved]))
