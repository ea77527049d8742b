"""Poses measured by a tracker, as a run in memory."""

from __future__ import annotations

from pathlib import Path

from analysis.runs.loading import Measured, measured_of, rig_of
from analysis.runs.table_format import columns_of
from analysis.runs.tables import PoseTable
from daq.store import table_run
from rigs.load import load
from tests.worlds.arms.independent_arm import Array


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
        rig_text=load(rig_name)[1],
        operator="tests",
        source=name,
        source_sha256="0" * 64,
        placement=placement,
    )
    return measured_of(run, rig_of(run).model_copy(update={"effects": ()}))
