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
from analysis.apps.pair.result import PairResult
from analysis.apps.report.diagnosis_report import extended_files
from analysis.apps.report.html_page import environment, write_html
from analysis.apps.report.texts import Language, Texts, texts_of
from analysis.cli.plain_console import bare_table, right
from analysis.runs.written_files import holding, write_all_new
from rigs.schema.part import Vector

_CERTAIN = 2.0
"""Multiple of u above which a correction is listed; the JSON has all."""


def as_screen(result: PairResult, language: Language = "en") -> RenderableType:
    """Return the first sentence, the transform of the bases, certain corrections, and what is not testable."""
    texts = texts_of(language)
    first, second = result.names
    base_headings = texts("pair_base", first=first, second=second), texts("pair_value"), "± u", ""
    style = "bold green" if _is_better(result) else "bold yellow"
    parts: list[RenderableType] = [Text(headline(result, texts), style=style), Text()]
    parts.append(_screen_table(base_headings, base_rows(result, texts)))
    if rows := constant_rows(result):
        headings = tuple(texts(f"pair_{name}") for name in ("arm", "constant", "correction"))
        parts += [Text(), _screen_table((*headings, "± u", ""), rows)]
    hidden = [Text(f"  {line}") for line in not_testable_lines(result)]
    parts += [Text(), Text(f"{texts('pair_not_testable')}:", style="dim"), *hidden]
    parts += [Text(texts("pair_doubt", line=line), style="yellow") for line in result.doubts]
    return Group(*parts, Text(footer(result, texts), style="dim"))


def _is_better(result: PairResult) -> bool:
    return result.left_mm < result.before_mm


def headline(result: PairResult, texts: Texts) -> str:
    """Return the change of the gap between ball and socket."""
    first, second = result.names
    key = "pair_calibrated" if _is_better(result) else "pair_not_calibrated"
    return texts(key, first=first, second=second, left=f"{result.left_mm:.3f}", before=f"{result.before_mm:.2f}")


def footer(result: PairResult, texts: Texts) -> str:
    """Return the number of touches and the errors that remain."""
    (first, second), (of_first, of_second) = result.names, result.unexplained_mm
    return texts(
        "pair_footer", count=result.touches, scatter=f"{result.scatter_mm:.3f}", first=first, second=second,
        unexplained_first=f"{of_first:.3f}", unexplained_second=f"{of_second:.3f}",
    )  # fmt: skip


def base_rows(result: PairResult, texts: Texts) -> list[tuple[str, ...]]:
    """Return the rows of the transform between the bases: name, value, u, unit."""
    base = result.base
    places = zip("xyz", base.xyz_mm, base.u_xyz_mm, strict=True)
    angles = zip(("roll", "pitch", "yaw"), base.rpy_deg, base.u_rotation_deg, strict=True)
    at = ", ".join(f"{value:z.0f}" for value in base.work_mm)
    return [
        *((axis, f"{value:z.3f}", f"{u:z.3f}", "mm") for axis, value, u in places),
        *((axis, f"{value:z.4f}", f"{u:z.4f}", "°") for axis, value, u in angles),
        (texts("pair_distance"), f"{base.distance_mm:.3f}", f"{base.u_distance_mm:.3f}", "mm"),
        (texts("pair_frame", at=at), "", _triple(base.u_work_mm), texts("pair_frame_unit")),
    ]


def _triple(values: Vector) -> str:
    return ", ".join(f"{value:z.3f}" for value in values)


def constant_rows(result: PairResult) -> list[tuple[str, ...]]:
    """Return the rows of certain corrections: arm, constant, correction, u, unit."""
    certain = [it for it in result.constants if it.is_shown and abs(it.value) > _CERTAIN * it.u]
    rows: list[tuple[str, ...]] = []
    for constant in sorted(certain, key=lambda constant: (constant.arm, constant.axis, constant.key)):
        digits = 3 if constant.unit == "mm" else 4
        size, u = f"{constant.value:+.{digits}f}", f"{constant.u:.{digits}f}"
        rows.append((constant.arm, constant.symbol, size, u, constant.unit))
    return rows


def _screen_table(headings: tuple[str, ...], rows: list[tuple[str, ...]]) -> RenderableType:
    """Return a table whose numbers, the columns before the unit, are aligned right."""
    numbers = len(headings) - 3, len(headings) - 2
    table = bare_table(*(right(heading) if k in numbers else heading for k, heading in enumerate(headings)))
    for row in rows:
        table.add_row(*row)
    return table


def write_page(result: PairResult, path: Path, language: Language = "en") -> None:
    """Write the page. Raises FileError if it cannot be written."""
    write_html(page_of(result, language), path)


def page_of(result: PairResult, language: Language = "en") -> str:
    """Return the page as HTML."""
    texts = texts_of(language)
    first, second = result.names
    return environment().get_template("pair.html").render(
        t=texts, lang=language, title=texts("pair_title", first=first, second=second),
        headline=headline(result, texts), standing="pass" if _is_better(result) else "watch",
        base=texts("pair_base", first=first, second=second), base_rows=base_rows(result, texts),
        constants=constant_rows(result), hidden=result.not_testable, doubts=result.doubts,
        footer=footer(result, texts),
    )  # fmt: skip


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


def write(
    fit: FittedPair, result: PairResult, texts: tuple[str, str], table: Path, directory: Path, language: Language = "en"
) -> list[Path]:
    """Write both calibrated rig files, the result as JSON and the page; return their paths, the rig files last.

    Raises FileError if one exists or a text cannot be changed in place.
    """
    files = {
        "pair.json": holding((json.dumps(result.to_dict(), indent=2) + "\n").encode()),
        "pair.html": holding(page_of(result, language).encode()),
    }
    placed, calibrated = placed_texts(fit, texts), calibrations(fit, result, table)
    for arm, text, model in zip(fit.pair.arms, placed, calibrated, strict=True):
        files |= extended_files(text, [], directory / f"{arm.rig.name}.yaml", model)
    return write_all_new(directory, files)
