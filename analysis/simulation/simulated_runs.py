"""Simulated tables as runs in the store, or as CSV files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from analysis.files.write import write_csv, write_new
from analysis.simulation.simulate import simulate
from analysis.traces.csv_tables import columns_of
from analysis.traces.loading import SIMULATED
from daq.store import write_table_run
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName


def write_simulated(  # noqa: PLR0913 - what a run is made of
    rig: Rig,
    rig_text: str,
    test: TestName,
    directions: Sequence[Direction | None],
    seeds: Sequence[int],
    effects: Sequence[Effect] | None,
    directory: Path,
    *,
    csv: bool,
) -> Iterator[Path]:
    """Simulate and write a run for each seed and direction; gives their paths. Raises FileError, CellError.

    The run holds the rig file, which need not know the effects that were simulated; its source says the seed.
    """
    for seed in seeds:
        for number, direction in enumerate(directions):
            columns = columns_of(simulate(rig, test, direction, 2 * seed + number, effects))
            path = directory / "-".join(filter(None, [test, direction, f"{seed:03d}"]))
            if csv:
                path = path.with_suffix(".csv")
                directory.mkdir(parents=True, exist_ok=True)
                write_new(path, partial(write_csv, columns))
            else:
                write_table_run(
                    path,
                    columns,
                    test=test,
                    direction=direction,
                    rig_name=rig.name,
                    rig_text=rig_text,
                    operator="rig simulate",
                    source=f"{SIMULATED}seed {seed}",
                    source_sha256=hashlib.sha256(repr(effects or rig.effects).encode()).hexdigest(),
                )
            yield path
