"""What a calibration found: table, JSON, and the extended rig file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.fitting.calibration import Calibration
from analysis.fitting.identifiability import parameter_label
from analysis.measures.parameters import quantity_of
from analysis.reporting.extended_rig import beside, with_origin, write_extended
from analysis.reporting.wide_tables import whole
from rigs.schema.vocabulary import CIRCLES


def as_table(found: Calibration) -> RenderableType:
    """Fitted parameters with their uncertainty, before and after, and what was held."""
    table = Table(title="value ± standard uncertainty", title_style="dim", header_style="bold")
    table.add_column("effect")
    table.add_column("value", justify="right")
    for one in found.effects:
        for field in one.sd:
            table.add_row(parameter_label(one.effect, field), str(quantity_of(one.effect, field, one.sd)))
    gap = Table(title="unexplained, rms in µm", title_style="dim", header_style="bold")
    for heading in ("", "before", "after"):
        gap.add_column(heading, justify="right" if heading else "left")
    for name, before, after in zip(
        ("readings used", "readings left out"), found.before_mm, found.after_mm, strict=True
    ):
        if not math.isnan(before):
            gap.add_row(name, f"{before * 1e3:.1f}", f"{after * 1e3:.1f}")
    determined = Text(
        f"determined by these readings: {found.identified_combinations} of {_asked(found)} combinations of parameters",
        style="dim",
    )
    weak_parameters = [Text(str(one), style="yellow") for one in found.weak_parameters]
    doubts = [Text(doubt, style="yellow") for doubt in found.doubts]
    return Group(whole(table), whole(gap), *doubts, determined, *weak_parameters, *_of_noise(found), _of_joints(found))


def _asked(found: Calibration) -> int:
    return len(found.weighting.spread)


def _of_joints(found: Calibration) -> Text:
    ranges = ", ".join(f"{axis}: {low:.0f}° to {high:.0f}°" for axis, (low, high) in enumerate(found.covered, start=1))
    return Text(f"the joints covered {ranges}; the model is valid there", style="dim")


def _of_noise(found: Calibration) -> list[Text]:
    """What was taken for the noise of readings and the scatter from run to run, and where both are from."""
    lines = []
    for setup, noise in found.noise.items():
        what = f"{setup}: readings are weighed with {1e3 * noise.sd_mm:.1f} µm, from the residuals of the fit"
        what += " and what neighbours on a lap have in common" * setup.startswith(CIRCLES)
        if noise.repeats:
            what += f"; visits of one place differ by {1e3 * noise.repeats.sd_mm:.1f} µm (standard deviation of one)"
        lines.append(Text(what, style="dim"))
    if not found.gauges:
        return lines
    size = f"joints {found.scatter.joint_deg:.2g}°, ball {1e3 * found.scatter.ball_mm:.2g} µm"
    if found.scatter.source == "measured":
        return [*lines, Text(f"scatter from run to run, from the repeated runs: {size}", style="dim")]
    text = f"scatter from run to run is assumed ({size}), since no run was repeated: repeat one"
    return [*lines, Text(text, style="yellow")]


def write_rig(found: Calibration, text: str, runs: Sequence[str], output: Path) -> None:
    """The rig file with the fitted effects added, each with where it came from: where the joints were meanwhile, to a
    hundredth of a degree, how its size goes with those of other effects, and which of those look like it. Raises
    FileError where it exists.

    Correlations keep five digits: of twins only the sum is known, by what they differ from -1.
    """
    gap_um = (found.before_mm[0] * 1e3, found.after_mm[0] * 1e3)
    joints_deg = found.covered and tuple((round(low, 2), round(high, 2)) for low, high in found.covered)
    effects = [
        beside(
            with_origin(one.effect, runs, one.sd, gap_um),
            joints_deg=joints_deg,
            correlation={name: round(value, 5) for name, value in one.correlation.items()},
            together=tuple(one.together),
        )
        for one in found.effects
    ]
    write_extended(text, effects, output)
