"""Simulated run directories of a robot with backlash of axis 3, at given dates."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

from analysis import save_run
from analysis.procedures.simulate import simulated_run
from rigs.effects import Backlash
from rigs.load import load
from rigs.schema.vocabulary import Direction
from tests.support.store_cases import edit_manifest

BEGAN = datetime(2026, 5, 1, 9, tzinfo=UTC)


def dated_run(directory: Path, day: int, play_deg: float, direction: Direction = "acw") -> Path:
    """Write a yaw run recorded `day` days after BEGAN; the day is also the noise seed."""
    rig, text = load("ur10e-cell")
    run = simulated_run(rig, text, "yaw", direction, day, [Backlash(axis=3, width_deg=play_deg)])
    path = save_run(run, directory / f"{day:03d}-{direction}")
    edit_manifest(path, {"started": (BEGAN + timedelta(days=day)).isoformat()})
    return path
