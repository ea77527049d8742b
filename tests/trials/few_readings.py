"""Chosen against random readings of measured arms: `scripts/dev few_readings DATA 20`.

Poses of a public series are a pool of possible readings. A linear model of the arm with the prior of its family
(`Pool` of `rig plan`) is fitted to the first readings, drawn at random or chosen one at a time for 150 poses that were
left out. The table compares the error there.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.apps.planning.pose_plan import Pool, pool_of
from analysis.robot.geometry.pose_setup import fit_setup
from analysis.robot.kinematics.arm import arm_of, forward
from rigs.load import parse
from tests.support.trial import Trial, main, markdown, seeds
from tests.trials.certify import POOLS, rig_text
from tests.trials.certify import pool_of as measured_pool

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
POSSIBLE, LEFT_OUT, FIRST = 300, 150, 6
"""Possible readings, poses that are left out, and random readings at the begin of a choice."""
COUNTS = {"random 12": 12, "random 20": 20, "random 40": 40, "all": POSSIBLE}
CHOSEN = (8, 12)
NOISES = (1.0, 3.0, 10.0, 30.0, 100.0)
"""Standard deviations of a coordinate, in those of the plan, of which the likeliest is used."""
Result = tuple[str, dict[str, tuple[float, float]]]


def rows_of(poses: Integers) -> Integers:
    return np.asarray((3 * poses[:, None] + np.arange(3)).ravel(), dtype=np.int64)


def errors(pool: Pool, T: Array, xyz_mm: Array, read: Integers, out: Integers) -> tuple[float, float]:
    """Rms error in mm at the poses left out after some readings, and the share of errors within 2 u."""
    setup = fit_setup(T[read], xyz_mm[read])
    to_base = np.linalg.inv(setup.T_world_base)
    off = xyz_mm @ to_base[:3, :3].T + to_base[:3, 3] - (T @ setup.T_flange_tool)[:, :3, 3]
    sd = pool.sd_mm
    y, seen, asked = off.ravel() / sd, rows_of(read), rows_of(out)
    best = (-np.inf, 0.0, 0.0)
    for noise in NOISES:
        root = np.linalg.cholesky(pool.covariance[np.ix_(seen, seen)] + noise**2 * np.eye(len(seen)))
        white, across = np.linalg.solve(root, y[seen]), np.linalg.solve(root, pool.covariance[np.ix_(seen, asked)])
        evidence = -0.5 * float(white @ white) - float(np.log(np.diag(root)).sum())
        wrong = np.linalg.norm(((y[asked] - across.T @ white) * sd[asked]).reshape(-1, 3), axis=1)
        variance = np.diagonal(pool.covariance)[asked] - (across**2).sum(axis=0) + noise**2
        u = np.sqrt((variance * sd[asked] ** 2).reshape(-1, 3).sum(axis=1))
        best = max(best, (evidence, float(np.sqrt(np.mean(wrong**2))), float(np.mean(wrong < 2 * u))))
    return best[1:]


def draw(given: Namespace) -> Iterator[tuple[str, int, Path]]:
    for name in POOLS:
        if name.startswith(given.only):
            yield from ((name, seed, given.data) for seed in seeds(given))


def judge(case: tuple[str, int, Path]) -> Result:
    name, seed, data = case
    q, xyz_mm = measured_pool(data, name)
    order = np.random.default_rng(seed).permutation(len(q))
    possible = min(POSSIBLE, 2 * len(q) // 3)
    q, xyz_mm = (values[order[: possible + LEFT_OUT]] for values in (q, xyz_mm))
    rig = parse(rig_text(name), "cell.yaml")
    pool, T, out = pool_of(rig, q), forward(arm_of(rig.robot), q), np.arange(possible, len(q))
    chosen = pool.choose(max(CHOSEN), among=np.arange(possible), targets=out, first=np.arange(FIRST))
    found = {label: errors(pool, T, xyz_mm, np.arange(min(count, possible)), out) for label, count in COUNTS.items()}
    found |= {f"chosen {count}": errors(pool, T, xyz_mm, chosen[:count], out) for count in CHOSEN}
    return name, found


def report(done: Sequence[Result]) -> str:
    rows = []
    for name in dict.fromkeys(name for name, _ in done):
        of_name = [found for other, found in done if other == name]
        cells = [np.median([found[label] for found in of_name], axis=0) for label in of_name[0]]
        rows.append([name, str(len(of_name)), *(f"{error:.3f} ({100 * share:.0f})" for error, share in cells)])
    return markdown(("series", "draws", *done[0][1]), rows)


TRIAL = Trial(
    draw,
    judge,
    report,
    lambda result: f"{result[0]}: " + ", ".join(f"{label} {error:.3f}" for label, (error, _) in result[1].items()),
    count=20,
    options={"DATA": (Path, "directory with ipa-ur10 and jacobi"), "only": ("", "series whose name begins so (all)")},
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
