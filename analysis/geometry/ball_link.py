"""What the gauges on the ball link read: docs/conventions.md, "Circle test".

The link's disk stays perpendicular to the line from the tool P to the ball B. A gauge at offset w along e
reads along z_T to the disk's plane: g = (s - w (l·e)) / (l·z_T), l the unit vector from P to B.
"""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array
from rigs.schema.vocabulary import CircleTest

BASELINE_AXIS: dict[str, int] = {"yaw": 1, "roll": 0}
"""Column of the tool frame along which the gauges stand apart: y_T for yaw, x_T for roll."""


def readings(
    T: Array, ball: Array, offsets_mm: Array, test: CircleTest, link_mm: float, form_mm: Array | float = 0.0
) -> Array:
    """Gauge readings (n, k) mm, before their zero setting, of k gauges at `offsets_mm` (k,) along the baseline.

    T (n, 4, 4): link-side tool poses; ball (3,) mm in the world; link_mm: the link's constant, taken from |B - P|;
    form_mm (n,): what the ball's form adds to that.
    """
    to_ball = ball - T[:, :3, 3]
    distance = np.linalg.norm(to_ball, axis=1)
    line = to_ball / distance[:, None]
    along_e = np.einsum("ni,ni->n", line, T[:, :3, BASELINE_AXIS[test]])
    along_z = np.einsum("ni,ni->n", line, T[:, :3, 2])
    return np.asarray(((distance - link_mm + form_mm)[:, None] - along_e[:, None] * offsets_mm) / along_z[:, None])


def angle(g1: Array, g2: Array, baseline_mm: float) -> Array:
    """Angle (n,) rad between disk and tool from two readings (n,) mm: atan((g2 - g1) / b)."""
    return np.arctan((g2 - g1) / baseline_mm)
