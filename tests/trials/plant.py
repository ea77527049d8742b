"""Write small simulated runs of many robots, as a plant has them after a year, in some 20 ms a run."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tests.support.plant_runs import robot_of, write_visits
from tests.support.trial import Trial, main

TESTS = ("yaw acw", "yaw cw", "roll acw", "roll cw", "radial", "repeatability")
DAYS = 365.0


def draw(given: Namespace) -> Iterator[tuple[int, Namespace]]:
    yield from ((number, given) for number in ([1] if given.more else range(1, given.robots + 1)))


def runs_of_robot(case: tuple[int, Namespace]) -> int:
    number, given = case
    robot = robot_of(number, given.seed, DAYS)
    days = np.linspace(0, DAYS, given.visits, endpoint=False)
    if given.more:
        days = DAYS + np.arange(given.more, dtype=np.float64)
    directory = given.directory if given.flat else given.directory / robot.name
    return sum(1 for _ in write_visits(directory, robot, days.tolist(), given.tests, given.seed))


def report(done: Sequence[int]) -> str:
    return f"{sum(done)} runs of {len(done)} robots"


TRIAL = Trial(
    draw,
    runs_of_robot,
    report,
    line=lambda runs: "",
    options={
        "DIRECTORY": (Path, "directory of the plant, with a directory for each robot"),
        "robots": (20, "how many robots (20)"),
        "visits": (50, "days on which each robot is measured, over a year (50)"),
        "more": (0, "days after that year, of the first robot alone (0)"),
        "tests": (["repeatability"], "a run of each on each day (repeatability)", TESTS),
        "flat": (False, "all runs in one directory"),
        "seed": (0, "of robots and noise (0)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
