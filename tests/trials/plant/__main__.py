"""Write small simulated runs of many robots, as a plant has them after a year, in some 20 ms a run."""

from __future__ import annotations

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from tests.support.plant_runs import robot_of, write_visits

TESTS = ("yaw acw", "yaw cw", "roll acw", "roll cw", "radial", "repeatability")
DAYS = 365.0


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="scripts/dev plant", description=__doc__)
    parser.add_argument("directory", type=Path, help="directory of the plant, with a directory for each robot")
    parser.add_argument("--robots", type=int, default=20, help="how many robots (20)")
    parser.add_argument("--visits", type=int, default=50, help="days on which each robot is measured, over a year (50)")
    parser.add_argument("--more", type=int, default=0, help="days after that year, of the first robot alone (0)")
    parser.add_argument(
        "--tests", nargs="+", choices=TESTS, default=["repeatability"], help="a run of each on each day (repeatability)"
    )
    parser.add_argument("--flat", action="store_true", help="all runs in one directory")
    parser.add_argument("--seed", type=int, default=0, help="of robots and noise (0)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    return parser.parse_args()


def main() -> None:
    given = arguments()
    begin = time.monotonic()
    with ProcessPoolExecutor(given.jobs) as pool:
        numbers = [1] if given.more else range(1, given.robots + 1)
        runs = sum(pool.map(partial(runs_of_robot, given), numbers))
    sys.stdout.write(f"{runs} runs in {time.monotonic() - begin:.1f} s in {given.directory}\n")


def runs_of_robot(given: argparse.Namespace, number: int) -> int:
    """Write the runs of a robot; return their number."""
    robot = robot_of(number, given.seed, DAYS)
    days = np.linspace(0, DAYS, given.visits, endpoint=False)
    if given.more:
        days = DAYS + np.arange(given.more, dtype=np.float64)
    directory = given.directory if given.flat else given.directory / robot.name
    return sum(1 for _ in write_visits(directory, robot, days.tolist(), given.tests, given.seed))


if __name__ == "__main__":
    main()
