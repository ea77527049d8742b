"""Run directories of simulated and imported tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from analysis import read_table, save_run
from analysis.procedures.simulate import simulated_run
from analysis.robot.kinematics.arm import Array
from daq.protocol.conversation import NO_TIME, Sample
from daq.store import RunWriter, new_manifest
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName


def write_simulated(
    rig: Rig,
    rig_text: str,
    test: TestName,
    directions: Sequence[Direction | None],
    seeds: Sequence[int],
    directory: Path,
    effects: Sequence[Effect] | None = None,
) -> Iterator[Path]:
    for seed in seeds:
        for direction in directions:
            run = simulated_run(rig, rig_text, test, direction, seed, effects)
            yield save_run(run, directory / run.path)


def import_table(source: Path, run: Path, *, rig_file: str, **given: Any) -> list[str]:
    """Import a table file as a run directory like `rig import`, and return the doubts."""
    measured = read_table(source, rig_file, **given)
    save_run(measured, run)
    return list(measured.doubts)


def recorded_run(
    runs: Path,
    rig_text: str,
    test: TestName,
    direction: Direction | None,
    samples: Iterable[tuple[str, Sample]],
    more: Sequence[str] = (),
) -> Path:
    """Record a run as rigd does. samples: in order, each with its stream; more: further columns of the robot."""
    joints = [f"q{axis}_deg" for axis in range(1, 7)]
    streams = {"g1": ("g1_mm",), "g2": ("g2_mm",), "robot": (*joints, *more)}
    about = {"name": "lap", "test": test, "direction": direction, "rig_name": "rig", "rig_text": rig_text}
    writer = RunWriter.create(runs, new_manifest(**about, operator="ada", streams=streams))
    for stream, sample in samples:
        writer.append(stream, [sample])
    writer.close("complete", "told to", {})
    return writer.path


def lap_samples(t_s: Array, q: Array, g_mm: Array, more: Array | None = None) -> Iterator[tuple[str, Sample]]:
    """Samples of two gauges and a robot, of one instant each; more: values (n, m) of the robot beside its joints."""
    shown = np.degrees(q) if more is None else np.column_stack([np.degrees(q), more])
    for at, joints, readings in zip((t_s * 1e9).astype(int).tolist(), shown, g_mm, strict=True):
        for gauge, reading in zip(("g1", "g2"), readings, strict=True):
            yield gauge, Sample((reading,), NO_TIME, at, at, 7, math.nan, 0)
        yield "robot", Sample(tuple(joints), NO_TIME, at, at, 60, math.nan, 0)
