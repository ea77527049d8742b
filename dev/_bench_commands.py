"""The rows of whole measurements: simulated circles, and the command line beside pandas."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from rows import PANDAS, RUN_WRITER, cost

from dev.trials.blind.trial import Job, make_case, runs_of
from tests.support.benchmarks import Line

CIRCLE = Path(__file__).with_name("_bench_circle.py")
TURNS = 3
PANDAS_NAME = "pandas and a sine"
DIAGNOSED = ("one", 0)
"""The kind of case of the blind trial, and its seed."""


def circle_lines() -> Iterator[Line]:
    """A simulated circle with twelve effects by its readings: time, and at 1e6 memory."""
    for rows in ("1e4", "1e5", "1e6"):
        done = subprocess.run([sys.executable, str(CIRCLE), rows], check=True, capture_output=True, text=True)
        said = json.loads(done.stdout)
        what = f"12 effects, {rows} readings"
        yield Line("circle", what, "µs a reading", 10 / 3, 1e6 * said["cpu_s"] / said["rows"])
    yield Line("circle", f"{what}, peak memory", "× the result", 10.0, said["peak_mb"] / said["result_mb"])


def analyse_lines() -> Iterator[Line]:
    """`rig analyse` of a million readings of each gauge."""
    with tempfile.TemporaryDirectory() as runs:
        yield _beside_pandas("analyse", "1e6 readings a gauge", 3.0, _written(runs, 1_000_000))


def small_lines() -> Iterator[Line]:
    """`rig analyse` of ten thousand readings, from the start of the interpreter to the end."""
    with tempfile.TemporaryDirectory() as runs:
        run = _written(runs, 10_000)
        ours, pandas = _in_turns(run)
    yield Line("small", "1e4 readings a gauge, start to end", "CPU s", 0.5, ours, PANDAS_NAME, pandas)


def diagnose_lines() -> Iterator[Line]:
    """`rig diagnose` of one case of the blind trial: readings at 50 Hz."""
    with tempfile.TemporaryDirectory() as root:
        job = Job(*DIAGNOSED, "limits", Path(root))
        make_case(job)
        train = [str(run) for run in runs_of(job.case)["train"]]
        best = min(cost("rig", "diagnose", *train, "--json").cpu_s for _ in range(2))
    yield Line("diagnose", f"blind trial {DIAGNOSED[0]} {DIAGNOSED[1]}, {len(train)} runs at 50 Hz", "CPU s", 3.0, best)


def _written(runs: str, rows: int) -> str:
    """A run of so many readings of each gauge."""
    done = subprocess.run(
        [sys.executable, str(RUN_WRITER), runs, str(rows)], check=True, capture_output=True, text=True
    )
    return done.stdout.strip()


def _in_turns(run: str) -> tuple[float, float]:
    """CPU s of `rig analyse` and of pandas, best of alternating turns."""
    turns = [
        (cost("rig", "analyse", run, "--json").cpu_s, cost(sys.executable, "-c", PANDAS, run).cpu_s)
        for _ in range(TURNS)
    ]
    ours, pandas = zip(*turns, strict=True)
    return min(ours), min(pandas)


def _beside_pandas(row: str, what: str, most: float, run: str) -> Line:
    """The ratio to pandas is the goal here."""
    ours, pandas = _in_turns(run)
    return Line(row, what, "CPU s", most * pandas, ours, PANDAS_NAME, pandas)
