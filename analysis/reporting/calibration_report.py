"""What a calibration found: table, JSON, and the extended rig file."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.fitting.calibrate import Calibration, fitted_effects
from analysis.fitting.identify import name_of
from analysis.reporting.quantity import Quantity
from rigs.effects import Found
from rigs.errors import FileError
from rigs.extend import extended


def as_table(found: Calibration) -> RenderableType:
    """Fitted parameters with their uncertainty, before and after, and what was held."""
    table = Table(title="value ± standard uncertainty", title_style="dim", header_style="bold")
    table.add_column("effect")
    table.add_column("value", justify="right")
    for one in fitted_effects(found):
        for field, sd in one.sd.items():
            value = float(getattr(one.effect, field))
            table.add_row(name_of(one.effect, field), str(Quantity(value, sd, _unit(one.effect, field))))
    gap = Table(title="unexplained, rms in µm", title_style="dim", header_style="bold")
    for heading in ("", "before", "after"):
        gap.add_column(heading, justify="right" if heading else "left")
    for name, before, after in zip(
        ("readings used", "readings left out"), found.before_mm, found.after_mm, strict=True
    ):
        if not math.isnan(before):
            gap.add_row(name, f"{before * 1e3:.1f}", f"{after * 1e3:.1f}")
    held = [Text(f"held: {held}", style="yellow") for held in found.held]
    return Group(table, gap, *held)


def _unit(effect: object, field: str) -> str:
    if field == "delta":
        return "mm" if getattr(effect, "field", "") in ("a", "d") else "deg"
    if field.endswith("_Nm"):
        return field.replace("_per_", "/")
    return field.rsplit("_", 1)[-1] if "_" in field else {"ppm": "ppm"}.get(field, "")


def as_object(found: Calibration) -> dict[str, Any]:
    """The same for scripts; lengths in mm, angles in degrees."""
    return {
        "effects": [
            {**one.effect.model_dump(mode="json", exclude={"found"}), "sd": one.sd} for one in fitted_effects(found)
        ],
        "covariance": found.after.covariance.tolist(),
        "held": [{"what": held.what, "like": list(held.like)} for held in found.held],
        "rms_mm": {
            "used": {"before": found.before_mm[0], "after": found.after_mm[0]},
            "left_out": None
            if math.isnan(found.before_mm[1])
            else {"before": found.before_mm[1], "after": found.after_mm[1]},
        },
    }


def write_rig(found: Calibration, text: str, runs: Sequence[str], output: Path) -> None:
    """The rig file with the fitted effects added, each with where it came from. Raises FileError where it exists."""
    gap_um = (round(found.before_mm[0] * 1e3, 3), round(found.after_mm[0] * 1e3, 3))
    effects = []
    for one in fitted_effects(found):
        origin = Found(date=dt.datetime.now(dt.UTC).date(), runs=tuple(runs), sd=one.sd, gap_um=gap_um)
        rounded = {field: float(f"{getattr(one.effect, field):.9g}") for field in one.sd}
        effects.append(one.effect.model_copy(update={"found": origin, **rounded}))
    try:
        with output.open("x", encoding="utf-8") as file:
            file.write(extended(text, effects, str(output)))
    except FileExistsError:
        raise FileError(str(output), "is there already", "give another --output, or remove it first") from None
    except OSError as error:
        raise FileError(str(output), error.strerror or str(error), "give another --output") from None
