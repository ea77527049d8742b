"""The arm library on the screen, as JSON, and an arm as text to paste into a rig file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from rigs.arms import Arm


def as_table(arms: Sequence[Arm]) -> RenderableType:
    """Return a row for each arm: its name, what it is, and what is known of it."""
    table = Table(header_style="bold")
    table.add_column("name", no_wrap=True)
    table.add_column("arm", overflow="fold")
    table.add_column("repeatability", justify="right")
    table.add_column("masses")
    for arm in arms:
        repeatability = f"{arm.repeatability_mm:g} mm" if arm.repeatability_mm else "unknown"
        masses = "known" if arm.sources.masses else "unknown"
        table.add_row(Text(arm.name, style="bold"), f"{arm.maker} {arm.model}", repeatability, masses)
    return Group(table, Text(f"{len(arms)} arms; rig arms NAME shows the robot section of one, and its sources"))


def as_object(arm: Arm) -> dict[str, Any]:
    """Return an arm as an object of JSON."""
    return {
        "name": arm.name,
        "maker": arm.maker,
        "model": arm.model,
        "note": arm.note,
        "repeatability_mm": arm.repeatability_mm,
        "sources": arm.sources.model_dump(),
        "frames": arm.frames,
        "robot": arm.robot.model_dump(mode="json"),
    }


def section(arm: Arm) -> str:
    """Return the robot section of an arm, under comments that say where its numbers come from."""
    repeatability = f", repeatability {arm.repeatability_mm:g} mm" if arm.repeatability_mm else ""
    head = [f"{arm.maker} {arm.model}{repeatability}", *([arm.note] if arm.note else []), f"frames: {arm.frames}"]
    head += [f"{key}: {words}" for key, words in arm.sources.model_dump(exclude_defaults=True).items()]
    return "".join(f"# {line}\n" for line in head) + arm.text
