"""Poses measured by a tracker as runs in memory, of arms that move between the runs, and what they calibrate."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from analysis import calibrate
from analysis.correction.model_files import write_model
from analysis.runs.loading import Measured, measured_of, rig_of
from analysis.runs.tables import PoseTable, columns_of
from daq.store import table_run
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.robot import Pose
from tests.support.shipped_cells import cell_name
from tests.worlds.arms.independent_arm import GEAR_RAD, HEALTHY, POSTURE_DEG, Array, constants_of, flange, none

TOOL_MM, REACH_RAD = np.array([40.0, 25.0, 130.0]), np.array([1.2, 0.5, 0.6, 1, 1, 2])
BASE_RAD = 0.5e-3
"""Turn of a base that moves."""


def pose_run(rig_name: str, q: Array, xyz_mm: Array, name: str = "poses", placement: str = "door") -> Measured:
    """A run of a shipped rig with joint angles q (n, 6) rad and positions xyz_mm (n, 3), measured at a
    placement.
    """
    run = table_run(
        Path(name),
        columns_of(PoseTable(q, xyz_mm, None)),
        test="pose",
        direction=None,
        rig_name=rig_name,
        rig_text=load(cell_name(rig_name))[1],
        operator="tests",
        source=name,
        source_sha256="0" * 64,
        placement=placement,
    )
    return measured_of(run, rig_of(run).model_copy(update={"effects": ()}))


@dataclass(frozen=True)
class Cell:
    """Runs in time order, and the zeros in degrees by axis, the base (axis 0) or the tool (axis 7) in mm, that changed
    before each."""

    runs: list[Measured]
    changes: list[dict[int, float]]


def cell_with(arm: str, changes: list[dict[int, float]], rng: np.random.Generator) -> Cell:
    """Simulate a run after each of the given changes."""
    wrong = replace(none(), **{name: rng.normal(0, sd, 6) for name, sd in HEALTHY.items()})
    wrong = replace(wrong, sine=rng.normal(0, GEAR_RAD, (6, 2)), cosine=rng.normal(0, GEAR_RAD, (6, 2)))
    place, noise_mm = rng.normal(0, 1500, 3), rng.uniform(0.01, 0.05)
    turn, tool, runs = np.eye(3), TOOL_MM, []
    for number, change in enumerate(changes, start=1):
        zero = [np.radians(change.get(axis, 0.0)) for axis in range(1, 7)]
        wrong = replace(wrong, offset=wrong.offset + zero)
        if 0 in change:
            shift = rng.normal(size=3)
            place = place + shift / np.linalg.norm(shift) * change[0]
            turn = Rotation.from_rotvec(rng.normal(0, BASE_RAD, 3)).as_matrix() @ turn
        if 7 in change:
            shift = rng.normal(size=3)
            tool = tool + shift / np.linalg.norm(shift) * change[7]
        q = np.radians(POSTURE_DEG[arm]) + rng.uniform(-1, 1, (int(rng.integers(25, 60)), 6)) * REACH_RAD
        R, p = flange(constants_of(arm), wrong, q)
        xyz = (p + R @ tool) @ turn.T + place
        runs.append(pose_run(arm, q, xyz + rng.normal(0, noise_mm, xyz.shape), f"run {number}"))
    return Cell(runs, changes)


def calibrated(runs: Sequence[Measured], text: str) -> Rig:
    """Rig file that `rig calibrate` writes for runs, as it is read again."""
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "found.yaml"
        write_model(calibrate(runs), text, path)
        return load(path)[0]


def with_tool(rig: Rig, xyz_mm: Array) -> Rig:
    """A rig with its tool at the target (3,) mm on the flange."""
    x, y, z = (float(value) for value in xyz_mm)
    return rig.model_copy(
        update={"robot": rig.robot.model_copy(update={"tool": Pose(xyz_mm=(x, y, z))})}
    ).calibrated_as(rig)
