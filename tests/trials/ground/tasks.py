"""Making the tasks of the proving ground: files for entrants in one directory, the truth in another.

Arms with joint curves behind a tracker are drawn by the seed. Measured series of others have fixed splits, where their
directory is given.
"""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.support.measured_series import UR5, jacobi, ur10
from tests.trials.ground.plain_arm import Array, PlainArm, Poses, framed, write_arm, write_poses, write_rows
from tests.worlds.arms import soft_arm

ARMS = 3
"""Arms with joint curves."""
MANY, FEW, ASKED = 400, 30, 200
"""Number of poses of a complete and of a short calibration, and of requested poses, for an arm with joint curves."""
GROUPS = 20
"""Neighbourhoods of poses, which the scorer draws whole."""


@dataclass(frozen=True)
class Size:
    """Number of arms with joint curves, and of poses given, few and asked of each."""

    arms: int = ARMS
    many: int = MANY
    few: int = FEW
    asked: int = ASKED


WHOLE = Size()
TINY = Size(arms=1, many=40, few=12, asked=20)


@dataclass(frozen=True)
class Task:
    """name: of the directory; row: of the table, which may pool several tasks; split: selection of the requested
    poses.
    """

    name: str
    kind: str
    row: str
    split: str = ""


@dataclass(frozen=True)
class Split:
    """Poses that are given and poses that are asked."""

    task: Task
    arm: PlainArm
    given: Poses
    asked: Poses


def make(directory: Path, seed: int, size: Size, data: Path | None) -> list[str]:
    """Write `tasks` and `truth` to a new directory; return the omitted tasks with reasons."""
    tasks, truth = directory / "tasks", directory / "truth"
    for place in (tasks, truth):
        place.mkdir(parents=True)
    made = [write_split(one, tasks, truth) for one in simulated_splits(seed, size)]
    measured, left_out = measured_splits(data)
    made += [write_split(one, tasks, truth) for one in measured]
    names = [asdict(one) for one in made]
    write_rows(tasks / "tasks.csv", list(names[0]), [list(one.values()) for one in names])
    shutil.copy(tasks / "tasks.csv", truth / "tasks.csv")
    (truth / "made.json").write_text(json.dumps({"seed": seed, "left_out": left_out}) + "\n", encoding="utf-8")
    (tasks / "README.txt").write_text(README, encoding="utf-8")
    return left_out


README = """The tasks of a proving ground for programs that correct the errors of robot arms.

tasks.csv   every task: name (its directory), kind, row (of the table), split
NAME/       the files of one task

Lengths are in mm and angles in degrees. Arms are modified Denavit-Hartenberg,
  T(i-1,i) = RotX(alpha) TransX(a) RotZ(q + offset) TransZ(d),
an axis a row in arm.csv, with mass and centre of mass of each link in its frame (0 where the maker does not tell).

kind poses   arm.csv, train.csv (pose, placement, q1_deg ..., x_mm, y_mm, z_mm: where an instrument saw its target),
             test.csv (pose, placement, q1_deg ...). Poses of one placement share the instrument's frame and the
             target on the flange, which no file tells. Answer NAME.csv: pose, x_mm, y_mm, z_mm, u_mm; u_mm is the
             standard uncertainty of the distance between your place and the instrument's, of three coordinates
             together.
"""


def write_split(split: Split, tasks: Path, truth: Path) -> Task:
    """Write the files of a pose task, and its truth: the places, those of the nominal arm, and their neighbourhood."""
    here, asked = tasks / split.task.name, split.asked
    write_arm(here / "arm.csv", split.arm)
    write_poses(here / "train.csv", split.given, asked=False)
    write_poses(here / "test.csv", asked, asked=True)
    nominal = np.zeros_like(asked.xyz_mm)
    for placement in np.unique(asked.placement):
        frame = framed(split.arm, split.given.of(split.given.placement == placement))
        there = asked.placement == placement
        nominal[there] = frame.places(split.arm, asked.q[there])
    names = ["pose", "x_mm", "y_mm", "z_mm", "nominal_x_mm", "nominal_y_mm", "nominal_z_mm", "group"]
    rows = [
        [str(k), *(f"{value:.5f}" for value in (*xyz, *own)), str(group)]
        for k, (xyz, own, group) in enumerate(zip(asked.xyz_mm, nominal, groups_of(asked.q), strict=True), start=1)
    ]
    write_rows(truth / f"{split.task.name}.csv", names, rows)
    return split.task


def groups_of(q: Array) -> NDArray[np.int64]:
    """Neighbourhood of each posture (m,) at joint angles q (m, n) rad; few postures stand for themselves."""
    from scipy.cluster.vq import kmeans2  # noqa: PLC0415 - slow to import

    if len(q) < 3 * GROUPS:
        return np.arange(len(q))
    _, group = kmeans2(q, GROUPS, minit="++", rng=np.random.default_rng(0))
    return np.asarray(group, dtype=np.int64)


def simulated_splits(seed: int, size: Size) -> Iterator[Split]:
    """Tasks of arms with joint curves, long and short calibrations of one arm and the same poses asked."""
    for number in range(1, size.arms + 1):
        rng = np.random.default_rng([seed, number])
        q, xyz = soft_arm.seen(soft_arm.wrong(soft_arm.nominal("ur10"), rng), rng, size.many + size.asked, 0)
        poses = Poses(q, xyz, np.full(len(q), "tracker"))
        arm = arm_of_rig("ur10")
        at = np.arange(len(q))
        for what, count in (("", size.many), ("-few", size.few)):
            task = Task(f"curves{what}-{number}", "poses", f"arms with joint curves, {count} poses", "drawn")
            yield Split(task, arm, poses.of(at < count), poses.of(at >= size.many))


def measured_splits(data: Path | None) -> tuple[list[Split], list[str]]:
    """Tasks of measured series, and what was left out because its files are not there."""
    found: list[Split] = []
    left_out = []
    for what, files, splits in (
        ("the UR10 of Fraunhofer IPA", ("ipa-ur10/series_b.csv", "ipa-ur10/series_d.csv"), ur10_splits),
        ("the UR5 of Jacobi", ("jacobi/ur5_grid.csv", "jacobi/ur5_random.csv"), ur5_splits),
        ("the Barrett WAM of Jacobi", ("jacobi/wam_grid.csv", "jacobi/wam_random.csv"), wam_splits),
    ):
        if data is not None and all((data / file).is_file() for file in files):
            found += splits(*(data / file for file in files))
        else:
            left_out.append(f"{what}: {' and '.join(files)} not found; give their directory with --data")
    return found, left_out


def some(poses: Poses, count: int) -> Poses:
    """Return so many of the poses, always the same."""
    chosen = np.random.default_rng(0).permutation(len(poses.q))[:count]
    return poses.of(np.isin(np.arange(len(poses.q)), chosen))


def ur10_splits(b: Path, d: Path) -> list[Split]:
    """Tasks of the UR10: a fifth of the neighbourhoods of each series left out, with all the others given
    and with 30 poses; and one series from the other, of which 30 poses tell the placement."""
    from analysis.diagnosis.evidence.setups import folds_of  # noqa: PLC0415 - the split of docs/trials.md

    arm = arm_of_rig("ur10")
    series = {name: poses_of(name, *ur10(path)) for name, path in (("B", b), ("D", d))}
    found = []
    for name, poses in series.items():
        out = folds_of(poses.q, 5) == 0
        given, asked, low = poses.of(~out), poses.of(out), name.lower()
        whole = Task(f"ur10-{low}", "poses", f"UR10 {name}, {len(given.q)} poses", "neighbourhoods left out")
        few = Task(f"ur10-{low}-few", "poses", f"UR10 {name}, {FEW} poses", "neighbourhoods left out")
        found += [Split(whole, arm, given, asked), Split(few, arm, some(given, FEW), asked)]
    for name, other in (("B", "D"), ("D", "B")):
        placed = some(series[other], FEW)
        left = np.isin(series[other].q[:, 0], placed.q[:, 0])
        given = joined(series[name], placed)
        task = Task(f"ur10-{name.lower()}-to-{other.lower()}", "poses", f"UR10 {other} from {name}", "another series")
        found.append(Split(task, arm, given, series[other].of(~left)))
    return found


def joined(one: Poses, other: Poses) -> Poses:
    parts_of = (np.concatenate([getattr(one, name), getattr(other, name)]) for name in ("q", "xyz_mm", "placement"))
    return Poses(*parts_of)


def arm_of_rig(name: str) -> PlainArm:
    """Nominal arm of a shipped rig file."""
    arm = soft_arm.nominal(name)
    return PlainArm(arm.a, arm.alpha, arm.d, arm.offset, arm.mass[:6], arm.centre[:6])


def poses_of(placement: str, q: Array, xyz_mm: Array) -> Poses:
    return Poses(q, xyz_mm, np.full(len(q), placement))


def ur5_splits(grid: Path, random: Path) -> list[Split]:
    """Tasks of the UR5: 20 random poses, from the whole grid and from 30 poses of it."""
    given, asked = (poses_of("tracker", *jacobi(path)) for path in (grid, random))
    arm = PlainArm(
        np.array(UR5["a_mm"], dtype=float),
        np.radians(UR5["alpha_deg"]),
        np.array(UR5["d_mm"]),
        np.zeros(6),
        # Universal Robots, DH parameters for calculations of kinematics and dynamics (support article)
        np.array([3.7, 8.393, 2.33, 1.219, 1.219, 0.1879]),
        np.array([
            [0, -1.93, -25.61], [-212.5, 0, 113.36], [-242.25, 0, 26.5], [0, -16.34, -1.8], [0, 16.34, -1.8],
            [0, 0, -1.159],
        ]),
    )  # fmt: skip
    whole = Task("ur5", "poses", f"UR5, {len(given.q)} poses", "random poses from a grid")
    few = Task("ur5-few", "poses", f"UR5, {FEW} poses", "random poses from a grid")
    return [Split(whole, arm, given, asked), Split(few, arm, some(given, FEW), asked)]


def wam_splits(grid: Path, random: Path) -> list[Split]:
    """Task of the WAM, seven axes driven by cables."""
    given, asked = (poses_of("tracker", *jacobi(path)) for path in (grid, random))
    arm = PlainArm(
        np.array([0.0, 0, 0, 45, -45, 0, 0]),
        np.radians([0, -90, 90, -90, 90, -90, 90]),
        np.array([0.0, 0, 550, 0, 300, 0, 60]),
        np.zeros(7),
        np.zeros(7),
        np.zeros((7, 3)),
    )
    task = Task("wam", "poses", f"WAM (seven axes), {len(given.q)} poses", "random poses from a grid")
    return [Split(task, arm, given, asked)]


def read_tasks(directory: Path) -> Sequence[Task]:
    with (directory / "tasks.csv").open(encoding="utf-8", newline="") as file:
        return [Task(row["name"], row["kind"], row["row"], row["split"]) for row in csv.DictReader(file)]
