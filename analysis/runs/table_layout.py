"""The columns of the tables of docs/tables.md, and what stands in them; which a test has, its kind says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


def joint_columns(axes: int) -> tuple[str, ...]:
    """Return the names of the columns of so many joints."""
    return tuple(f"q{axis}_deg" for axis in range(1, axes + 1))


JOINTS = joint_columns(6)
"""The joints of the tests with a ball link."""
COMMANDED = tuple(f"q{axis}_commanded_deg" for axis in range(1, 7))
"""Joints as they were commanded, beside those of JOINTS."""
MEASURED = tuple(f"q{axis}_measured_deg" for axis in range(1, 7))
"""Joints as they were measured, next to commanded ones that are used."""
JointSource = Literal["measured", "commanded"]
PLACE = ("x_mm", "y_mm", "z_mm")
TURN = ("rx_deg", "ry_deg", "rz_deg")
RAIL, RAIL_FROM = "e1_mm", "e1_from_mm"
"""Where the rail that carries an arm stands, and from where it came there."""
SOCKET = "socket"
"""The column of a touch with the name of the socket; any words."""
WORDS = {"direction": ("acw", "cw"), "approach": ("none", "out", "in")}
"""Columns of words, and the words they know."""
TIME_U = ("u_t_s", "u_lag_s")
"""Standard uncertainties of the gauges' time against the joints': of each row by itself, and shared by all rows."""
COUNTS = ("target", "orientation", "round")
"""Columns of positive integers. Every other known column holds numbers."""


@dataclass(frozen=True)
class Layout:
    """Columns that a table needs, and those that it may have, of which each group of those `together` is all there or
    none; any other is extra and kept as it is."""

    required: tuple[str, ...]
    optional: tuple[str, ...] = ()
    together: tuple[tuple[str, ...], ...] = ()

    @property
    def known(self) -> tuple[str, ...]:
        """All columns that mean something here."""
        return (*self.required, *self.optional)


def came_from_columns(axes: int) -> tuple[str, ...]:
    """Return the names of the columns that say from which angle each joint came to a posture, in its last move."""
    return tuple(f"q{axis}_from_deg" for axis in range(1, axes + 1))
