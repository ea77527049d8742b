"""Cost of `rig fleet` for many small runs: first call, second call, and after a new run; and a run of each test."""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from analysis import save_run, simulate
from analysis.apps.plant.seen import examine
from tests.support.plant_runs import CELL, robot_of, write_visits
from tests.trials.plant.__main__ import DAYS, TESTS, runs_of_robot

RIG = Path(sys.executable).parent / "rig"


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="scripts/dev fleet_cost", description=__doc__)
    parser.add_argument("--robots", type=int, default=200, help="how many robots (200)")
    parser.add_argument("--visits", type=int, default=50, help="runs of each robot (50)")
    parser.add_argument("--jobs", type=int, default=1, help="processes of rig fleet (1)")
    parser.add_argument("--where", type=Path, help="directory to work in, as /dev/shm (that of temporary files)")
    return parser.parse_args()


def main() -> None:
    given = arguments()
    with tempfile.TemporaryDirectory(dir=given.where) as directory:
        work = Path(directory)
        for title in TESTS:
            print(of_a_run(work, title), flush=True)
        plant, catalogue = work / "plant", work / "catalogue.sqlite"
        write_plant(plant, given)
        count = given.robots * given.visits
        held = sum(file.stat().st_size for file in plant.rglob("*") if file.is_file())
        print(f"{count} runs of {given.robots} robots: {held / count / 1e3:.1f} kB a run")
        words = [RIG, "fleet", plant, "--catalogue", catalogue, "--jobs", str(given.jobs)]
        print(f"first time: {cost_of(words)}")
        print(f"catalogue: {catalogue.stat().st_size / count / 1e3:.2f} kB a run")
        print(f"again: {cost_of(words)}")
        first = robot_of(1, 0, DAYS)
        for _ in write_visits(plant / first.name, first, [DAYS]):
            pass
        print(f"after one new run: {cost_of(words)}")
        figures = work / "figures.parquet"
        print(f"with --parquet: {cost_of([*words, '--parquet', figures])}")
        print(f"Parquet: {figures.stat().st_size / count:.0f} bytes a run")


def of_a_run(work: Path, title: str) -> str:
    """Bytes and seconds of a whole simulated run of a test, as a table of its full rows."""
    test, _, direction = title.partition(" ")
    path = save_run(simulate(CELL, test, direction or None, seed=1), work / title)  # type: ignore[arg-type]
    held = sum(file.stat().st_size for file in path.iterdir())
    examine(path)  # what is slow to import
    begin_s = time.process_time()
    examine(path)
    return f"{title}: {held / 1e3:.0f} kB, {time.process_time() - begin_s:.3f} s of processor time to evaluate"


def write_plant(plant: Path, given: argparse.Namespace) -> None:
    each = argparse.Namespace(directory=plant, visits=given.visits, more=0, flat=False, seed=0, tests=["repeatability"])
    with ProcessPoolExecutor(2) as pool:
        list(pool.map(partial(runs_of_robot, each), range(1, given.robots + 1)))


def cost_of(words: list[str | Path]) -> str:
    """Seconds, processor time and peak memory of a command."""
    watch = [sys.executable, "-I", Path(__file__).parents[1] / "cost_of.py", *words]
    return subprocess.run(watch, stdout=subprocess.PIPE, text=True, check=True).stdout.strip()


if __name__ == "__main__":
    main()
