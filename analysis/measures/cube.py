"""ISO 9283 of the cube's poses: accuracy and repeatability of each pose, and of the distance from P2 to P4.

ISO 9283:1998, 7.2.1 AP and 7.2.2 RP of each of P1 … P5; 7.3.2 distance accuracy AD = mean D - D_c and 7.3.3 distance
repeatability RD = 3 S of the distances D of each cycle, S with n - 1, D_c the commanded. AD and RD do not depend on
where the instrument stands. u of AP and RP as of all poses (`analysis.measures.pose`); u of AD is the scatter's, S / √n
by Student's law, and of RD that of a standard deviation. The instrument's own errors are in neither.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from analysis.geometry.iso_cube import Cube
from analysis.kinematics.arm import Array, Integers
from analysis.kinematics.limits import wrapped
from analysis.measures.quantity import Quantity, student_factor
from analysis.measures.scatter_figures import FEWEST_CYCLES

_SAME_RAD = float(np.radians(0.5))
"""A group of poses is one of the cube whose joints it has within this, modulo a turn: what a robot reports lies beside
the command."""


def poses_of_cube(q: Array, cube: Cube | None) -> Integers:
    """The number 1 … 5 of the cube's pose that each row of joints q (n, axes) rad is, 0 for another."""
    if cube is None or q.shape[1] != cube.q.shape[1]:
        return np.zeros(len(q), dtype=np.int64)
    away = np.abs(wrapped(q[:, None] - cube.q)).max(axis=2)
    return np.where(away.min(axis=1) < _SAME_RAD, 1 + away.argmin(axis=1), 0)


def by_pose(pose: Integers, plain: Callable[[Array], dict[str, Array]]) -> Callable[[Array], dict[str, Array]]:
    """Figures of each of the cube's poses beside those of all groups: pose (g,) says which each group is."""

    def figures(x: Array) -> dict[str, Array]:
        by_name = plain(x)
        for group in np.flatnonzero(pose):
            of_group = plain(x[..., [group], :, :])
            for name in ("ap_mm", "rp_mm"):
                if name in of_group:
                    by_name[name.replace("_mm", f"_p{pose[group]}_mm")] = of_group[name]
        return by_name

    return figures


def distance_figures(pose: Integers, xyz_mm: Array, cube: Cube | None) -> dict[str, Quantity]:
    """AD and RD, from places xyz_mm (n, 3) of rows in order of time, pose (n,) of the cube; none below three cycles."""
    second, fourth = np.flatnonzero(pose == 2), np.flatnonzero(pose == 4)
    if cube is None or not len(second) or len(fourth) < FEWEST_CYCLES:
        return {}
    # Of each P4 from the P2 that was measured nearest to it in time, in its own cycle.
    nearest = second[np.abs(fourth[:, None] - second).argmin(axis=1)]
    distances, n = np.linalg.norm(xyz_mm[fourth] - xyz_mm[nearest], axis=1), len(fourth)
    s = float(distances.std(ddof=1))
    u = student_factor(n - 1) * s / float(np.sqrt(n))
    return {
        "ad_mm": Quantity(float(distances.mean()) - cube.distance_mm, u, "mm", n),
        "rd_mm": Quantity(3 * s, 3 * s / float(np.sqrt(2 * (n - 1))), "mm", n),
    }
