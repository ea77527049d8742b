"""Two arms that measured each other, and a plan for it, on the screen."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from rich.console import Group, RenderableType
from rich.text import Text

from analysis.apps.pair.calibrations import calibrations, placed_texts
from analysis.apps.pair.fit_pair import FittedPair
from analysis.apps.pair.plan_touches import PlannedTouches
from analysis.apps.pair.result import PairConstant, PairResult
from analysis.report.diagnosis_report import extended_files
from analysis.report.plain_console import bare_table, right
from analysis.runs.written_files import holding, write_all_new
from rigs.schema.part import Vector

_CERTAIN = 2.0
"""Multiple of u above which a correction is listed; the JSON has all."""


def as_screen(result: PairResult) -> RenderableType:
    """Return the result for the screen: summary, transform between the bases, certain corrections, and what is not
    testable.
    """
    good = result.left_mm < result.before_mm
    parts: list[RenderableType] = [
        Text(headline(result), style="bold green" if good else "bold yellow"), Text(), _base_table(result)
    ]  # fmt: skip
    certain = [it for it in result.constants if it.is_shown and abs(it.value) > _CERTAIN * it.u]
    if certain:
        parts += [Text(), _constants_table(certain)]
    parts += [Text(), Text("not testable:", style="dim"), *(Text(f"  {line}") for line in not_testable_lines(result))]
    parts += [Text(f"doubt: {line}", style="yellow") for line in result.doubts]
    return Group(*parts, Text(footer(result), style="dim"))


def headline(result: PairResult) -> str:
    """Return a sentence on how well each touch is predicted from the others, before and after the calibration."""
    first, second = result.names
    state = "are calibrated" if result.left_mm < result.before_mm else "are not calibrated by these touches"
    return (
        f"{first} and {second} {state}: each touch is predicted from the others to {result.left_mm:.3f} mm rms "
        f"per coordinate, with the nominal arms to {result.before_mm:.2f} mm."
    )


def footer(result: PairResult) -> str:
    """Return a line with the number of touches, their scatter, and the unexplained error of each arm."""
    first, second = result.names
    unexplained = (
        f"unexplained {result.unexplained_mm[0]:.3f} mm ({first}), {result.unexplained_mm[1]:.3f} mm ({second})"
    )
    return f"{result.touches} touches · scatter {result.scatter_mm:.3f} mm · {unexplained}"


def _base_table(result: PairResult) -> RenderableType:
    base = result.base
    table = bare_table(f"base of {result.names[1]} in {result.names[0]}", right("value"), right("± u"), "")
    for axis, value, u in zip("xyz", base.xyz_mm, base.u_xyz_mm, strict=True):
        table.add_row(axis, f"{value:.3f}", f"{u:.3f}", "mm")
    for axis, value, u in zip(("roll", "pitch", "yaw"), base.rpy_deg, base.u_rotation_deg, strict=True):
        table.add_row(axis, f"{value:.4f}", f"{u:.4f}", "°")
    table.add_row("distance", f"{base.distance_mm:.3f}", f"{base.u_distance_mm:.3f}", "mm")
    at = ", ".join(f"{value:.0f}" for value in base.work_mm)
    table.add_row(f"frame at {at}", "", _triple(base.u_work_mm), "mm in x, y, z")
    return table


def _triple(values: Vector) -> str:
    return ", ".join(f"{value:.3f}" for value in values)


def _constants_table(constants: list[PairConstant]) -> RenderableType:
    table = bare_table("arm", "constant", right("correction"), right("± u"), "")
    for constant in sorted(constants, key=lambda constant: (constant.arm, constant.axis, constant.key)):
        digits = 3 if constant.unit == "mm" else 4
        size, u = f"{constant.value:+.{digits}f}", f"{constant.u:.{digits}f}"
        table.add_row(constant.arm, constant.symbol, size, u, constant.unit)
    return table


def not_testable_lines(result: PairResult) -> Iterator[str]:
    """Yield a line for each quantity that the touches do not determine."""
    for hidden in result.not_testable:
        whose = f"{hidden.arm}: " if hidden.arm else ""
        yield f"{whose}{hidden.name} – {hidden.reason}"


def as_plan(planned: PlannedTouches) -> RenderableType:
    """Return the expected uncertainties of planned touches."""
    result = planned.expected
    shown = sum(constant.is_shown for constant in result.constants)
    count = len(planned.table.q)
    first = (
        f"{count} touches show {shown} of {len(result.constants)} constants of both arms, and the frame of "
        f"{result.names[1]} at the work to {_triple(result.base.u_work_mm)} mm in x, y, z."
    )
    lines = [Text(f"  {line}") for line in not_testable_lines(result)]
    return Group(Text(first, style="bold"), Text("not testable:", style="dim"), *lines)


def write(fit: FittedPair, result: PairResult, texts: tuple[str, str], table: Path, directory: Path) -> list[Path]:
    """Write both calibrated rig files and the result as JSON, and return their paths, those of the rig files last.

    Raises FileError if a file already exists, or if a rig file's text cannot be changed in place.
    """
    files = {"pair.json": holding((json.dumps(result.to_dict(), indent=2) + "\n").encode())}
    placed, calibrated = placed_texts(fit, texts), calibrations(fit, result, table)
    for arm, text, model in zip(fit.pair.arms, placed, calibrated, strict=True):
        files |= extended_files(text, [], directory / f"{arm.rig.name}.yaml", model)
    return write_all_new(directory, files)
