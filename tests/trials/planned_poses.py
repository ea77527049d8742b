"""Calibration with planned and with random poses on real arms: error at other poses."""

from __future__ import annotations

import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from analysis import FileError, calibrate
from analysis.apps.planning.pose_plan import pool_of
from analysis.robot.kinematics.arm import Array
from rigs.load import load
from tests.support.foreign_tables import UR5
from tests.support.measured_series import DATA, jacobi, ur10
from tests.support.pose_runs import pose_run
from tests.support.trial import Trial, main

POOL = 500
"""Poses to choose from; the others are left out."""


Case = tuple[str, str, tuple[Array, Array], int]
"""Name of the series, rig file, poses q (n, axes) rad and xyz (n, 3) mm, number of the draw."""


def left_um(rig: str, q: Array, xyz_mm: Array, used: Array, rest: Array) -> tuple[float, float]:
    """What stays at the rest, rms in µm, of the nominal arm and of one calibrated by the used poses."""
    runs = [pose_run(rig, q[rows], xyz_mm[rows], name) for name, rows in (("used", used), ("rest", rest))]
    gap = calibrate(runs[:1], hold_out=runs[1:]).held_out
    assert gap is not None  # poses are held out
    return gap.before_um, gap.calibrated_um


def draw(given: Namespace) -> Iterator[Case]:
    """Each draw of a pool from each series that is there."""
    with tempfile.TemporaryDirectory() as folder:
        ur5 = Path(folder, "ur5.yaml")
        ur5.write_text(UR5)
        sets = [
            ("UR10, B", given.data / "ipa-ur10" / "series_b.csv", "ur10", ur10),
            ("UR10, D", given.data / "ipa-ur10" / "series_d.csv", "ur10", ur10),
            ("UR5", given.data / "jacobi" / "ur5_grid.csv", str(ur5), jacobi),
        ]
        for name, path, rig, read in sets:
            if path.is_file():
                yield from ((name, rig, read(path), number) for number in range(given.draws))


def judged(case: Case) -> tuple[str, dict[str, float]]:
    """Error in µm at the rest by choice of the poses, and that of the nominal arm."""
    name, rig, (q, xyz_mm), number = case
    rng = np.random.default_rng(number)
    order = rng.permutation(len(q))
    count = min(POOL, len(order) // 2)
    here, rest = order[:count], order[count:]
    pool = pool_of(load(rig)[0], q[here])
    random = rng.permutation(count)
    choices = [(f"{number} planned", pool.choose(number)) for number in (30, 100)]
    choices += [(f"{number} random", random[:number]) for number in (30, 40, 50, 60, 100, 200)]
    found = {}
    for choice, chosen in choices:
        began = time.process_time()
        try:
            found["nominal"], found[choice] = left_um(rig, q, xyz_mm, here[chosen], rest)
        except FileError as error:
            print(f"{name}, draw {number}, {choice}: {error}", flush=True)
            continue
        expected, took = 1e3 * pool.u_mm(np.asarray(chosen)), time.process_time() - began
        print(
            f"{name}, draw {number}, {choice}: {found[choice]:.0f} µm, expected {expected:.0f}, {took:.0f} s",
            flush=True,
        )
    return name, found


def report(done: Sequence[tuple[str, dict[str, float]]]) -> str:
    lines = []
    for name in dict.fromkeys(name for name, _ in done):
        own = [found for other, found in done if other == name]
        means = {choice: np.mean([one[choice] for one in own if choice in one]) for choice in own[0]}
        lines.append(f"{name}: " + ", ".join(f"{choice} {mean:.0f}" for choice, mean in means.items()))
    return "\n".join(lines)


TRIAL = Trial(
    draw,
    judged,
    report,
    line=lambda one: "",
    options={
        "draws": (3, "draws of the pool (3)"),
        "data": (DATA, "the folder of measured data (../shared/data)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
