"""Pictures like the paper's: 6 and 8 (yaw), 10 and 11 (roll), 13 and 14 (sphere), 15 (repeatability).

The simulated runs are evaluated like any others, so the plots are those of `rig analyse`.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from analysis.api import evaluate
from analysis.measures.results import Result
from analysis.paper.published import gears
from analysis.paper.simulated_tests import SCATTER, repeats, typical_seed
from analysis.reporting.plots import save_pictures
from analysis.simulation.simulate import simulate
from analysis.traces.csv_tables import columns_of
from analysis.traces.loading import measured_of
from daq.store import table_run
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName

_RUNS: tuple[tuple[str, TestName, Direction | None], ...] = (
    ("figure-6-cw", "yaw", "cw"),
    ("figure-6-acw", "yaw", "acw"),
    ("figure-10-cw", "roll", "cw"),
    ("figure-10-acw", "roll", "acw"),
    ("figure-13", "radial", None),
    ("figure-14", "radial", None),
    ("figure-15", "repeatability", None),
)


def save(rig: Rig, rig_text: str, directory: Path) -> list[Path]:
    """Write the pictures; returns their paths. Raises FileError where nothing can be written."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        results = [_result(rig, rig_text, *run) for run in _RUNS]
        written = []
        for test in ("yaw", "roll", "radial", "repeatability"):
            written += save_pictures([result for result in results if result.test == test], directory)
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "give another --plot") from None
    return written


def _result(rig: Rig, rig_text: str, name: str, test: TestName, direction: Direction | None) -> Result:
    """One simulated run, free of noise but for the repeatability test, evaluated."""
    effects = gears(rig.effects) if name == "figure-14" else rig.effects
    seed, noise = (typical_seed(repeats(rig, effects)), SCATTER) if test == "repeatability" else (None, None)
    run = table_run(
        Path(name),
        columns_of(simulate(rig, test, direction, seed, effects, noise)),
        test=test,
        direction=direction,
        rig_name=rig.name,
        rig_text=rig_text,
        operator="rig paper",
        source="simulated",
        source_sha256=hashlib.sha256(repr(effects).encode()).hexdigest(),
    )
    return evaluate(measured_of(run))
