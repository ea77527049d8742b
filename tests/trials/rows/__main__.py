"""CPU and peak memory of `rig analyse` by the number of rows, beside pandas on the same Parquet files.

Read: the run becomes a table. Analyse: the whole command. pandas: two gauges and robot into frames and a least-squares
sine, the least that anybody would do by hand. Ratios are of CPU, imports and all. Nothing heavy is imported here, for
a child's peak memory begins with its parent's.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

RUN_WRITER = Path(__file__).parents[2] / "support" / "synthetic_run.py"
LEAST = 10_000
"""A lap of fewer rows at 4 kHz is quicker than its robot."""
SIZES = (10_000, 100_000, 1_000_000, 10_000_000)
_KEEPING = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
"""A user's environment, where Python keeps what it has compiled. Without this every turn would compile rig again, a
fifth of a small run, and nothing of pandas, which pip compiled as it installed it."""
READ = "import sys, pathlib, analysis.runs.loading as it; it.load_measured(pathlib.Path(sys.argv[1]))"
PANDAS = """
import sys, pathlib
import numpy as np, pandas as pd
run = pathlib.Path(sys.argv[1])
def stream(name):
    return pd.concat([pd.read_parquet(file) for file in sorted(run.glob(f"{name}-*.parquet"))], ignore_index=True)
g1, g2, robot = stream("g1"), stream("g2"), stream("robot")
angle = np.arctan((g2["g2_mm"] - g1["g1_mm"]).to_numpy() / 50)
phi = np.linspace(0, 2 * np.pi, len(angle))
print(np.linalg.lstsq(np.column_stack([np.ones_like(phi), np.sin(phi), np.cos(phi)]), angle, rcond=None)[0])
"""
FLOOR = """
import sys, pathlib
import numpy as np, pyarrow as pa, pyarrow.parquet as pq
run = pathlib.Path(sys.argv[1])
def stream(name):
    return pa.concat_tables([pq.read_table(file) for file in sorted(run.glob(f"{name}-*.parquet"))])
g1, g2, robot = stream("g1"), stream("g2"), stream("robot")
angle = np.arctan((g2["g2_mm"].to_numpy() - g1["g1_mm"].to_numpy()) / 50)
phi = np.linspace(0, 2 * np.pi, len(angle))
print(np.linalg.lstsq(np.column_stack([np.ones_like(phi), np.sin(phi), np.cos(phi)]), angle, rcond=None)[0])
"""
"""What the work itself needs: every column read, and one sine."""

_WATCH = """
import os, subprocess, sys
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, used = os.wait4(process.pid, 0)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3)
process.returncode = os.waitstatus_to_exitcode(status)
sys.exit(process.returncode)
"""
"""A program that is small itself: a process begins as a copy of its parent, and its peak memory with it."""


@dataclass(frozen=True)
class Cost:
    """CPU of a process, its own and the system's for it, and its peak memory."""

    cpu_s: float
    peak_mb: float

    def __str__(self) -> str:
        return f"{self.cpu_s:8.2f} {self.peak_mb:7.0f}"


def cost(*command: str) -> Cost:
    """Of a command. Raises CalledProcessError where it fails."""
    watched = [sys.executable, "-I", "-c", _WATCH, *command]
    done = subprocess.run(watched, stdout=subprocess.PIPE, env=_KEEPING, check=True, text=True)
    return Cost(*map(float, done.stdout.split()))


def main(sizes: list[int]) -> None:
    """Print a line for each size."""
    print("             read             analyse          pandas           CPU ratio to pandas")
    print("rows         CPU s   MB       CPU s   MB       CPU s   MB       read  analyse")
    for rows in sizes:
        with tempfile.TemporaryDirectory() as runs:
            written = subprocess.run(
                [sys.executable, str(RUN_WRITER), runs, str(rows)], check=True, capture_output=True, text=True
            )
            run = written.stdout.strip()
            cost(sys.executable, "-c", READ, run)  # from the disk once, and everything compiled
            read, analyse = cost(sys.executable, "-c", READ, run), cost("rig", "analyse", run, "--json")
            pandas = cost(sys.executable, "-c", PANDAS, run)
        ratios = f"{read.cpu_s / pandas.cpu_s:4.1f}  {analyse.cpu_s / pandas.cpu_s:4.1f}"
        print(f"{rows:<9} {read} {analyse} {pandas}       {ratios}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="scripts/dev rows", description=__doc__)
    parser.add_argument("sizes", type=float, nargs="*", default=SIZES, help="rows of a run (1e4 1e5 1e6 1e7)")
    main([max(LEAST, int(size)) for size in parser.parse_args().sizes])
