"""Answers of `rig pair`: two arms that measured each other, and a plan for it."""

from __future__ import annotations

import json
from pathlib import Path

from analysis.apps.pair.calibrations import calibrations, placed_texts
from analysis.apps.pair.fit_pair import FittedPair
from analysis.apps.pair.plan_touches import PlannedTouches
from analysis.apps.pair.result import PairResult
from analysis.apps.report.blocks import Block, Heading, Row, Sentence, Table
from analysis.apps.report.diagnosis_report import extended_files
from analysis.apps.report.html_page import answer_page
from analysis.apps.report.texts import Language, Texts, texts_of
from analysis.runs.written_files import holding, write_all_new
from rigs.schema.part import Vector

_CERTAIN = 2.0
"""Multiple of u above which a correction is listed."""


def answer_of(result: PairResult, texts: Texts) -> list[Block]:
    names = dict(zip(("first", "second"), result.names, strict=True))
    is_better = result.left_mm < result.before_mm
    head = texts(
        "pair_calibrated" if is_better else "pair_not_calibrated", **names, left=f"{result.left_mm:.3f}",
        before=f"{result.before_mm:.2f}",
    )  # fmt: skip
    of_first, of_second = (f"{mm:.3f}" for mm in result.unexplained_mm)
    footer = texts(
        "pair_footer", **names, count=result.touches, scatter=f"{result.scatter_mm:.3f}", unexplained_first=of_first,
        unexplained_second=of_second,
    )  # fmt: skip
    arm, constant, correction, reason = map(texts, ("pair_arm", "pair_constant", "pair_correction", "pair_reason"))
    base = (texts("pair_base", **names), texts("pair_value"), "± u", "")
    parts: list[Block] = [Sentence(head, "pass" if is_better else "watch"), Heading(texts("pair_frame_heading"))]
    parts.append(Table(base, base_rows(result, texts), {1, 2}))
    if rows := constant_rows(result):
        parts += [Heading(texts("pair_corrections")), Table((arm, constant, correction, "± u", ""), rows, {2, 3})]
    parts += [Heading(texts("pair_not_testable")), Table((arm, constant, reason), _hidden_rows(result))]
    parts += [Sentence(texts("pair_doubt", line=line), "doubt") for line in result.doubts]
    return [*parts, Sentence(f"{texts('pair_note')} {footer}", "note")]


def _hidden_rows(result: PairResult) -> list[Row]:
    return [(one.arm or "–", one.what, one.reason) for one in result.not_testable]


def base_rows(result: PairResult, texts: Texts) -> list[Row]:
    """Name, value, u, unit."""
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


def constant_rows(result: PairResult) -> list[Row]:
    """Certain corrections: arm, constant, correction, u, unit."""
    certain = [it for it in result.constants if it.shown and abs(it.delta) > _CERTAIN * it.u]
    rows = list[Row]()
    for constant in sorted(certain, key=lambda constant: (constant.arm, constant.axis, constant.key)):
        digits = 3 if constant.unit == "mm" else 4
        size, u = f"{constant.delta:+.{digits}f}", f"{constant.u:.{digits}f}"
        rows.append((constant.arm, constant.symbol, size, u, constant.unit))
    return rows


def page_of(result: PairResult, language: Language = "en") -> str:
    texts, (first, second) = texts_of(language), result.names
    return answer_page(texts("pair_title", first=first, second=second), answer_of(result, texts), language)


def plan_answer(planned: PlannedTouches) -> list[Block]:
    result = planned.expected
    shown = sum(constant.shown for constant in result.constants)
    count = len(planned.table.q)
    first = (
        f"{count} touches show {shown} of {len(result.constants)} constants of both arms, and the frame of "
        f"{result.names[1]} at the work to {_triple(result.base.u_work_mm)} mm in x, y, z."
    )
    table = Table(("arm", "constant", "reason"), _hidden_rows(result))
    return [Sentence(first, "strong"), Heading("not testable"), table]


def write(
    fit: FittedPair, result: PairResult, texts: tuple[str, str], table: Path, directory: Path, language: Language = "en"
) -> list[Path]:
    """Write both rig files, JSON and page; the rig files are last. Raises FileError if one exists or cannot be changed
    in place.
    """
    files = {
        "pair.json": holding((json.dumps(result.to_dict(), indent=2) + "\n").encode()),
        "pair.html": holding(page_of(result, language).encode()),
    }
    placed, calibrated = placed_texts(fit, texts), calibrations(fit, result, table)
    for arm, text, model in zip(fit.pair.arms, placed, calibrated, strict=True):
        files |= extended_files(text, [], directory / f"{arm.rig.name}.yaml", model)
    return write_all_new(directory, files)
