"""Two arms of one model side by side, on the screen."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.correction.arms_apart import ArmsApart
from rigs.text import plain

_SHOWN = 5e-5
"""Degrees or mm below which a difference of constants is not shown: less than the last digit."""


def as_tables(apart: ArmsApart) -> RenderableType:
    """The distance in a line, then the constants and the plays that differ, axis by axis."""
    seen = apart.to_dict()
    first, second = map(plain, apart.names)
    u = "" if seen["u_rms_mm"] is None else f", known to {seen['u_rms_mm']:.3f} mm (u)"
    head = (
        f"The tool of {second} is {seen['rms_mm']:.3f} mm rms from that of {first} at the same joint angles, at most "
        f"{seen['max_mm']:.3f} mm{u}. With frame and tool taught on each arm, {seen['taught_rms_mm']:.3f} mm rms "
        "are left."
    )
    worst = int(np.argmax(apart.distance_mm))
    place = ", ".join(f"{angle:.0f}" for angle in apart.q_deg[worst])
    where = Text(f"Farthest apart at joint angles {place} °.")
    table = Table(header_style="bold", title=f"{second} less {first}", title_style="bold")
    for heading in ("axis", "zero °", "a mm", "d mm", "alpha °", "beta °", f"play {first} °", f"play {second} °"):
        table.add_column(heading, justify="right")
    for axis, constants in enumerate(apart.constants, start=1):
        differences = [f"{value:+.4f}" if abs(value) > _SHOWN else "" for value in constants.values()]
        plays = [f"{width[axis]:.4f}" if axis in width else "" for width in apart.play_deg]
        table.add_row(str(axis), *differences, *plays)
    return Group(Text(head), where, table, *(Text(doubt, style="yellow") for doubt in apart.doubts))
