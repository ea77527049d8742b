"""Columns of the tables in docs/tables.md. The kind of a test selects the columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


def joint_columns(axes: int) -> tuple[str, ...]:
    return tuple(f"q{axis}_deg" for axis in range(1, axes + 1))


def second_joint_columns(axes: int) -> tuple[str, ...]:
    """Column names of the joints of a second arm, which holds the socket."""
    return tuple(f"p{axis}_deg" for axis in range(1, axes + 1))


JOINTS = joint_columns(6)
"""Joint columns of the ball link tests."""
COMMANDED = tuple(f"q{axis}_commanded_deg" for axis in range(1, 7))
"""Commanded joint angles, in addition to JOINTS."""
MEASURED = tuple(f"q{axis}_measured_deg" for axis in range(1, 7))
"""Measured joint angles, next to the commanded ones that are used."""
JointSource = Literal["measured", "commanded"]
PLACE = ("x_mm", "y_mm", "z_mm")
TURN = ("rx_deg", "ry_deg", "rz_deg")
CONTROLLER_PLACE = tuple(f"controller_{name}" for name in PLACE)
CONTROLLER_TURN = tuple(f"controller_{name}" for name in TURN)
"""Pose of the tool that the controller computed from the joints, next to the measured one."""
RAIL, RAIL_FROM = "e1_mm", "e1_from_mm"
"""Position of the arm's rail, and its previous position."""
SOCKET = "socket"
"""Column with the socket name of a touch. Any text is permitted."""
WORDS = {"direction": ("acw", "cw"), "approach": ("none", "out", "in")}
"""Columns of text, with the permitted values."""
TIME_U = ("u_t_s", "u_lag_s")
"""Standard uncertainties of the gauges' time relative to the joints' time: individual, and common to all rows."""
COUNTS = ("target", "orientation", "round")
"""Columns of positive integers. All other known columns contain real numbers."""


@dataclass(frozen=True)
class Layout:
    """Required and optional columns of a table. Other columns are preserved.

    Each group of columns in `together` must be complete or absent.
    """

    required: tuple[str, ...]
    optional: tuple[str, ...] = ()
    together: tuple[tuple[str, ...], ...] = ()

    @property
    def known_columns(self) -> tuple[str, ...]:
        return (*self.required, *self.optional)


def came_from_columns(axes: int) -> tuple[str, ...]:
    return tuple(f"q{axis}_from_deg" for axis in range(1, axes + 1))
