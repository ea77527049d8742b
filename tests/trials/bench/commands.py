"""The rows of whole measurements: simulated circles, and the command line beside pandas."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tests.support.benchmarks import Line
from tests.support.command_cost import cost
from tests.trials.blind.trial import Job, make_case, runs_of

CIRCLE = Path(__file__).with_name("circle.py")
RUN_WRITER = Path(__file__).parents[2] / "support" / "synthetic_run.py"
_SINE = """
angle = np.arctan((g2 - g1) / 50)
phi = np.linspace(0, 2 * np.pi, len(angle))
print(np.linalg.lstsq(np.column_stack([np.ones_like(phi), np.sin(phi), np.cos(phi)]), angle, rcond=None)[0])
"""
PANDAS = (
    """
import sys, pathlib
import numpy as np, pandas as pd
run = pathlib.Path(sys.argv[1])
def stream(name):
    return pd.concat([pd.read_parquet(file) for file in sorted(run.glob(f"{name}-*.parquet"))], ignore_index=True)
robot, g1, g2 = stream("robot"), *(stream(name)[f"{name}_mm"].to_numpy() for name in ("g1", "g2"))
"""
    + _SINE
)
"""The least that anybody would do by hand: gauges and robot into frames, and a least-squares sine."""
FLOOR = (
    """
import sys, pathlib
import numpy as np, pyarrow as pa, pyarrow.parquet as pq
run = pathlib.Path(sys.argv[1])
def stream(name):
    return pa.concat_tables([pq.read_table(file) for file in sorted(run.glob(f"{name}-*.parquet"))])
robot, g1, g2 = stream("robot"), *(stream(name)[f"{name}_mm"].to_numpy() for name in ("g1", "g2"))
"""
    + _SINE
)
"""The work itself: every column read, and one sine."""
TURNS = 3
PANDAS_NAME = "pandas and a sine"
FLOOR_NAME = "pyarrow and a sine"
_FEW, _MANY = 10, 40
"""Runs whose peak memories are compared: what the command itself takes is in both."""
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
    """Measure `rig analyse` by number of readings per gauge, compared with the computation alone."""
    for rows, most, turns in (("1e4", 1.3, 3), ("1e5", 1.3, 3), ("1e6", 1.8, 3)):
        with tempfile.TemporaryDirectory() as runs:
            run = _written(runs, int(float(rows)))
            ours, floor = _in_turns(run, FLOOR, turns)
            if rows == "1e6":
                peak_mb = cost("rig", "analyse", run, "--json").peak_mb
                yield Line("analyse", f"{rows} readings a gauge, peak memory", "MB", 800.0, peak_mb)
        yield Line("analyse", f"{rows} readings a gauge", "CPU s", most * floor, ours, FLOOR_NAME, floor)


def many_lines() -> Iterator[Line]:
    """Measure `rig analyse` on many runs: memory per additional run, and speed-up by two jobs."""
    with tempfile.TemporaryDirectory() as root:
        written = _written(root, 10_000)
        runs = [shutil.copytree(written, f"{root}/run-{number}") for number in range(_MANY)]
        few, all_runs = (cost("rig", "analyse", *some, "--json").peak_mb for some in (runs[:_FEW], runs))
        turns = [tuple(_seconds("rig", "analyse", *runs, "--jobs", jobs) for jobs in "12") for _ in range(TURNS)]
    alone, together = (min(of) for of in zip(*turns, strict=True))
    yield Line("many", "10 000 readings a gauge, memory of each more run", "MB", 0.3, (all_runs - few) / (_MANY - _FEW))
    yield Line("many", f"{_MANY} runs, two jobs", "s", alone / 1.8, together, "one job", alone)


def _seconds(*command: str) -> float:
    begin = time.monotonic()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.monotonic() - begin


def small_lines() -> Iterator[Line]:
    """`rig analyse` of ten thousand readings, from the start of the interpreter to the end."""
    with tempfile.TemporaryDirectory() as runs:
        run = _written(runs, 10_000)
        ours, pandas = _in_turns(run, PANDAS)
    yield Line("small", "1e4 readings a gauge, start to end", "CPU s", 0.5, ours, PANDAS_NAME, pandas)


def diagnose_lines() -> Iterator[Line]:
    """`rig diagnose` of one case of the blind trial: readings at 50 Hz."""
    with tempfile.TemporaryDirectory() as root:
        job = Job(*DIAGNOSED, Path(root))
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


def _in_turns(run: str, other: str, turns: int = TURNS) -> tuple[float, float]:
    """CPU s of `rig analyse` and of another program in Python, best of alternating turns."""
    costs = [
        (cost("rig", "analyse", run, "--json").cpu_s, cost(sys.executable, "-c", other, run).cpu_s)
        for _ in range(turns)
    ]
    ours, its = zip(*costs, strict=True)
    return min(ours), min(its)
