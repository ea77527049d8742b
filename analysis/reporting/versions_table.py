"""The calibrations of a robot, on the screen and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from analysis.files.versions import Version
from rigs.calibration import verdict_of
from rigs.text import plain


def as_table(versions: Sequence[Version]) -> RenderableType:
    """A line for each version, the newest first."""
    if not versions:
        return Text("No calibration of this robot is here: rig diagnose RUN… -o DIRECTORY makes one.")
    table = Table(header_style="bold")
    for heading, justify in (("", "left"), ("date", "left"), ("rig file", "left"), ("runs", "right")):
        table.add_column(heading, justify=justify)  # type: ignore[arg-type]
    for heading in ("before µm", "calibrated µm", "left out µm", "to correct by"):
        table.add_column(heading, justify="right")
    for version in versions:
        model = version.calibrated
        left_out = "" if model.held_out_um is None else f"{model.held_out_um:.1f}"
        figures = (f"{model.before_um:.1f}", f"{model.calibrated_um:.1f}", left_out)
        verdict = "yes" if verdict_of(model) == "correct" else "no"
        table.add_row(
            "in use" if version.in_use else "",
            f"{model.date}",
            plain(str(version.path)),
            f"{len(model.runs)}",
            *figures,
            verdict,
        )
    return table


def as_object(version: Version) -> dict[str, Any]:
    """A version in plain types."""
    model = version.calibrated
    return {
        "path": str(version.path),
        "sha256": version.sha256,
        "in_use": version.in_use,
        "date": str(model.date),
        "version": model.version,
        "runs": [run.name for run in model.runs],
        "before_um": model.before_um,
        "calibrated_um": model.calibrated_um,
        "held_out_um": model.held_out_um,
        "verdict": verdict_of(model),
    }
