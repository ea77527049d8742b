"""A case with given fault and noise, for predictions of the detection probability of a fault of this size."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from tests.worlds.stranger.cell import ROBOTS
from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.gauges import Link
from tests.worlds.stranger.real import arm as arms
from tests.worlds.stranger.real.cases import Day, PlannedRun, drawn_day, motion_of, placed_links, write_readings
from tests.worlds.stranger.real.noise import CellNoise, Levels
from tests.worlds.stranger.real.programs import program
from tests.worlds.stranger.sight import REPEATS

_QUIET = CellNoise(
    rate_hz=50.0, resolution_mm=1e-4, tail_df=0.0, outliers=0.0, bursts=False, uneven=0.1, jitter_s=1e-4,
    encoder_deg=2e-5,
)  # fmt: skip
"""Timing, resolution and outliers that are negligible compared with the given noise."""


@dataclass(frozen=True)
class Noise:
    """Noise of every run: white and slow noise of a gauge with its time constant, scatter of joints and ball between
    runs, and scatter of stops along the gauge.
    """

    white_mm: float
    slow_mm: float
    slow_s: float
    joints_deg: float
    ball_mm: float
    stops_mm: float


def generate_known(robot: str, fault: Fault, noise: Noise, seed: int, directory: Path) -> float:
    """Write three runs of yaw and roll in each direction and of the hemisphere (each target visited twice), for a
    healthy arm with a fault. Return the total size of the faulty parameter, including its healthy size.
    """
    rng = np.random.default_rng([seed, ROBOTS.index(robot)])
    day = drawn_day("one", rng)[0]
    while day.robot != robot:
        day = drawn_day("one", rng)[0]
    levels = {setup: _levels(noise, link, day) for setup, link in day.links.items()}
    whole, rest = arms.plant(arms.healthy_arm(1.0, rng), fault)
    faults = [whole, *rest]
    day = replace(day, noise=_QUIET, levels=levels)
    _write(directory, replace(day, links=placed_links(day, faults)), faults, rng)
    return whole.size


def _levels(noise: Noise, link: Link, day: Day) -> Levels:
    stops = {int(k): noise.stops_mm * np.sqrt(3) for k in day.targets["target"]}
    shape = (2 * REPEATS + 2, len(link.zeros))
    return Levels(
        np.full(shape, noise.white_mm), np.full(shape[0], noise.slow_mm), noise.slow_s, 0.0, noise.joints_deg,
        noise.ball_mm, np.zeros(3), stops,
    )  # fmt: skip


def _write(case: Path, day: Day, faults: Sequence[Fault], rng: np.random.Generator) -> None:
    case.mkdir(parents=True)
    (case / "rig.yaml").write_text(yaml.safe_dump(day.cell.data, sort_keys=False, allow_unicode=True), encoding="utf-8")
    lines = [["file", "test", "direction", "use", "rig"]]
    for setup, ways in (("yaw", ("acw", "cw")), ("roll", ("acw", "cw")), ("radial", ("",))):
        for way in ways:
            number = REPEATS * ways.index(way)
            made = program(
                day.cell, motion_of(day, PlannedRun(setup, way, "train", number), rng), day.links[setup], faults
            )
            for k in range(REPEATS):
                table = f"{'-'.join(filter(None, [setup, way]))}-{k}.csv"
                write_readings(case / table, day, PlannedRun(setup, way, "train", number + k), made, faults, rng)
                lines.append([table, setup, way, "train", "rig.yaml"])
    with (case / "runs.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(lines)
