"""Calibration with planned and with random poses on real arms: error at other poses."""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from analysis import FileError, calibrate
from analysis.apps.planning.pose_plan import pool_of
from analysis.intake.imports import propose_map
from analysis.intake.mapped import poses_of
from analysis.intake.raw_table import read_files
from analysis.robot.kinematics.arm import Array
from analysis.runs.tables import PoseTable
from rigs.load import load
from tests.support.foreign_tables import DATA, UR5
from tests.support.pose_runs import pose_run

POOL = 500
"""Poses to choose from; the others are left out."""


def read(path: Path, rig: str) -> PoseTable:
    """The places of a measured table, by the map that is proposed for it."""
    table_map = propose_map([path], rig).table_map
    raw, _ = read_files([(path, path.read_bytes())], table_map.files, "")
    found = poses_of(raw, table_map)
    return PoseTable(found.q, found.xyz_mm, None)


def left_um(rig: str, table: PoseTable, used: Array, rest: Array) -> tuple[float, float]:
    """What stays at the rest, rms in µm, of the nominal arm and of one calibrated by the used poses."""
    runs = [pose_run(rig, table.q[rows], table.xyz_mm[rows], name) for name, rows in (("used", used), ("rest", rest))]
    gap = calibrate(runs[:1], hold_out=runs[1:]).held_out
    assert gap is not None  # poses are held out
    return gap.before_um, gap.calibrated_um


def main() -> None:
    """Print a line for each draw of a pool, then the means."""
    parser = argparse.ArgumentParser(prog="scripts/dev planned_poses", description=__doc__)
    parser.add_argument("--draws", type=int, default=3, help="draws of the pool (3)")
    parser.add_argument("--data", type=Path, default=DATA, help="the folder of measured data (../shared/data)")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        ur5 = Path(folder, "ur5.yaml")
        ur5.write_text(UR5)
        sets = [
            ("UR10, B", given.data / "ipa-ur10" / "series_b.csv", "ur10"),
            ("UR10, D", given.data / "ipa-ur10" / "series_d.csv", "ur10"),
            ("UR5", given.data / "jacobi" / "ur5_grid.csv", str(ur5)),
        ]
        for name, path, rig in sets:
            if path.is_file():
                compare(name, read(path, rig), rig, given.draws)


def compare(name: str, table: PoseTable, rig: str, draws: int) -> None:
    """Print what each choice leaves."""
    found: dict[str, list[float]] = {}
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        order = rng.permutation(len(table.q))
        count = min(POOL, len(order) // 2)
        here, rest = order[:count], order[count:]
        pool = pool_of(load(rig)[0], table.q[here])
        random = rng.permutation(count)
        choices = [(f"{number} planned", pool.choose(number)) for number in (30, 100)]
        choices += [(f"{number} random", random[:number]) for number in (30, 40, 50, 60, 100, 200)]
        for choice, chosen in choices:
            began = time.process_time()
            try:
                before, after = left_um(rig, table, here[chosen], rest)
            except FileError as error:
                print(f"{name}, draw {seed}, {choice}: {error}", flush=True)
                continue
            found.setdefault("nominal", []).append(before)
            found.setdefault(choice, []).append(after)
            expected = 1e3 * pool.u_mm(np.asarray(chosen))
            took = time.process_time() - began
            print(
                f"{name}, draw {seed}, {choice}: {after:.0f} of {before:.0f} µm, expected {expected:.0f}, {took:.0f} s",
                flush=True,
            )
    print(f"{name}: " + ", ".join(f"{choice} {np.mean(left):.0f}" for choice, left in found.items()), flush=True)


if __name__ == "__main__":
    main()
