"""Run directories of simulated and imported tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from analysis import read_table, save_run
from analysis.procedures.simulate import simulated_run
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
