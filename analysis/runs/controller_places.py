"""Poses that the controller computed, in the table of an imported run next to the measured ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from analysis.robot.kinematics.arm import Array
from analysis.runs.table_layout import CONTROLLER_PLACE, CONTROLLER_TURN
from analysis.runs.table_rows import Rows


@dataclass(frozen=True)
class ControllerPlaces:
    """Joints q (n, axes) rad as reported, with the places and orientations R (n, 3, 3) that the controller computed, in
    its own frame. R is None if the table has only places.
    """

    q: Array
    xyz_mm: Array
    R: Array | None


def controller_places(table: pa.Table | None) -> ControllerPlaces | None:
    """Poses of the controller in a table of poses, such as `run.run.table` of an imported run; None if it has none."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    if table is None or not (rows := Rows(table)).has(CONTROLLER_PLACE):
        return None
    has_turn = rows.has(CONTROLLER_TURN)
    R = Rotation.from_euler("xyz", rows.stack(CONTROLLER_TURN), degrees=True).as_matrix() if has_turn else None
    return ControllerPlaces(rows.q, rows.stack(CONTROLLER_PLACE), None if R is None else np.asarray(R))
