"""Comparison of two arms on the screen: distance of the tools, and the arm that fits the runs."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.apps.plant.arms_apart import ArmsApart
from analysis.apps.plant.fitting_arm import FittingArm
from analysis.apps.report.diagnosis_words import micrometres
from analysis.cli.plain_console import right
from rigs.text import plain

_SHOWN = 5e-5
"""Smallest difference between two constants, in degrees or mm, that is shown; it is below the last digit shown."""


def arms_apart_tables(apart: ArmsApart) -> RenderableType:
    """Return a sentence with the distance of the tools, and a table of the constants and plays that differ, by axis."""
    seen = apart.to_dict()
    first, second = map(plain, apart.names)
    u = "" if seen["u_rms_mm"] is None else f", known to {seen['u_rms_mm']:.3f} mm (u)"
    head = (
        f"The tool of {second} is {seen['rms_mm']:.3f} mm rms from that of {first} at the same joint angles, at most "
        f"{seen['max_mm']:.3f} mm{u}. With frame and tool taught on each arm, {seen['taught_rms_mm']:.3f} mm rms "
        "are left."
    )
    worst = int(np.argmax(apart.distance_mm))
    place = ", ".join(f"{angle:z.0f}" for angle in apart.q_deg[worst])
    where = Text(f"Farthest apart at joint angles {place} °.")
    headings = ("axis", "zero °", "a mm", "d mm", "alpha °", "beta °", f"play {first} °", f"play {second} °")
    table = Table(*map(right, headings), header_style="bold", title=f"{second} less {first}", title_style="bold")
    for axis, constants in enumerate(apart.constants, start=1):
        differences = [f"{value:+z.4f}" if abs(value) > _SHOWN else "" for value in constants.values()]
        plays = [f"{width[axis]:z.4f}" if axis in width else "" for width in apart.play_deg]
        table.add_row(str(axis), *differences, *plays)
    return Group(Text(head), where, table, *(Text(doubt, style="yellow") for doubt in apart.doubts))


def fitting_arm_table(fitting: FittingArm) -> RenderableType:
    """Return a sentence about the better arm, and a table of the residuals of both arms."""
    better = fitting.better
    head = "These runs do not distinguish the two arms."
    if better is not None:
        (worse,) = (fit for fit in fitting.fits if fit is not better)
        head = (
            f"{better.file} fits: it leaves {micrometres(better.rms_um)} rms of the readings, and {worse.file} "
            f"{micrometres(worse.rms_um)} rms, {fitting.times:.3g} times as much."
        )
    table = Table("arm", right("µm rms left"), right("at most"), header_style="bold")
    for fit in fitting.fits:
        table.add_row(fit.file, f"{fit.rms_um:.1f}", f"{fit.largest_um:.1f}")
    return Group(Text(head), table, *(Text(doubt, style="yellow") for doubt in fitting.doubts))
