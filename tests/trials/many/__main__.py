"""Evaluate the runs of many robots in one process, in several, and on two Dask workers of which one is killed.

Prints CPU and time of each way, and whether what it printed is the same to the byte. CPU is of all processes, with
their starts and imports; of Dask also that of the scheduler and the workers.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.support.dask_cluster import cluster

WRITER = Path(__file__).parents[1] / "plant" / "__main__.py"
RIG = (sys.executable, "-c", "from analysis.cli import main; main()")
TESTS = ("yaw acw", "yaw cw", "roll acw", "radial", "repeatability")


@dataclass(frozen=True)
class Way:
    """What a way of evaluating cost, and what it printed: lines, and their SHA-256."""

    name: str
    wall_s: float
    cpu_s: float
    lines: int
    sha256: str


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="scripts/dev many", description=__doc__)
    parser.add_argument("--robots", type=int, default=20, help="how many robots (20)")
    parser.add_argument("--visits", type=int, default=10, help=f"days of each, with {len(TESTS)} tests (10)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (2)")
    parser.add_argument("--no-dask", action="store_true", help="leave the cluster out")
    return parser.parse_args()


def main() -> None:
    given = arguments()
    with tempfile.TemporaryDirectory(prefix="rig-many-") as name:
        plant = Path(name) / "plant"
        size = ("--robots", str(given.robots), "--visits", str(given.visits))
        subprocess.run([sys.executable, str(WRITER), str(plant), *size, "--tests", *TESTS], check=True)
        runs = given.robots * given.visits * len(TESTS)
        ways = [evaluated("1 process", plant), evaluated(f"{given.jobs} processes", plant, "--jobs", str(given.jobs))]
        if not given.no_dask:
            (Path(name) / "dask").mkdir()
            ways.append(on_dask(plant, Path(name) / "dask", runs // 3))
    load = os.getloadavg()[0]
    print(
        f"{runs} runs of {given.robots} robots, `rig analyse DIR --lines`; load of the computer at the end {load:.1f}"
    )
    print("                        wall s   CPU s   CPU s/run   wall, CPU to 1 process   output")
    one = ways[0]
    for way in ways:
        ratios = f"{way.wall_s / one.wall_s:10.2f} {way.cpu_s / one.cpu_s:6.2f}"
        same = "the same" if way.sha256 == one.sha256 else f"differs: {way.lines} lines"
        each_s = way.cpu_s / runs
        print(f"{way.name:22} {way.wall_s:7.1f} {way.cpu_s:7.1f} {each_s:11.3f} {ratios:>20}        {same}")


def evaluated(name: str, plant: Path, *options: str, on_line: Callable[[int], None] = lambda line: None) -> Way:
    """Evaluate the runs of a directory; on_line: called with the number of each line as it is printed."""
    begin, cpu_s, found, lines = time.monotonic(), children_cpu_s(), hashlib.sha256(), 0
    with subprocess.Popen([*RIG, "analyse", str(plant), "--lines", *options], stdout=subprocess.PIPE) as command:
        assert command.stdout
        for lines, line in enumerate(command.stdout, 1):
            found.update(line)
            on_line(lines)
    if command.returncode:
        raise subprocess.CalledProcessError(command.returncode, command.args)
    return Way(name, time.monotonic() - begin, children_cpu_s() - cpu_s, lines, found.hexdigest())


def on_dask(plant: Path, directory: Path, killed_at: int) -> Way:
    """The same on two workers, the first of which is killed when so many runs are printed."""
    cpu_s = children_cpu_s()
    with cluster(directory) as made:

        def kill(line: int) -> None:
            if line == killed_at:
                made.workers[0].kill()

        way = evaluated("2 Dask workers, 1 dies", plant, "--scheduler", made.address, on_line=kill)
        died: Sequence[int | None] = [worker.poll() for worker in made.workers]
    if died != [-9, None]:
        raise RuntimeError(f"the workers ended with {died}")
    return Way(way.name, way.wall_s, children_cpu_s() - cpu_s, way.lines, way.sha256)


def children_cpu_s() -> float:
    """CPU of all children that have ended, and of theirs."""
    used = os.times()
    return used.children_user + used.children_system


if __name__ == "__main__":
    main()
