"""Answers of `rig pair`: two arms that measured each other, and a plan for it."""

from __future__ import annotations

import json
from pathlib import Path

from analysis.apps.pair.calibrations import calibrations, placed_texts
from analysis.apps.pair.fit_pair import FittedPair
from analysis.apps.pair.plan_touches import PlannedTouches
from analysis.apps.pair.result import PairResult
from analysis.apps.report.blocks import Block, Heading, Row, Sentence, Table
from analysis.apps.report.html_page import answer_page
from analysis.apps.report.texts import Language, Texts, texts_of
from analysis.correction.model_files import extended_files
from analysis.runs.written_files import holding, write_all_new
from rigs.schema.part import Vector

_CERTAIN = 2.0
"""Multiple of u above which a correction is listed."""


def pair_answer(result: PairResult, texts: Texts) -> list[Block]:
    is_better = result.left_mm < result.before_mm
    head = texts("pair_calibrated" if is_better else "pair_not_calibrated", pair=result)
    base = (texts("pair_base", pair=result), texts("pair_value"), "± u", "")
    arm, constant, correction, reason = map(texts, ("pair_arm", "pair_constant", "pair_correction", "pair_reason"))
    parts: list[Block] = [Sentence(head, "pass" if is_better else "watch"), Heading(texts("pair_frame_heading"))]
    parts.append(Table(base, _base_rows(result, texts), {1, 2}))
    if rows := _constant_rows(result):
        parts += [Heading(texts("pair_corrections")), Table((arm, constant, correction, "± u", ""), rows, {2, 3})]
    parts += [Heading(texts("pair_not_testable")), Table((arm, constant, reason), _hidden_rows(result))]
    parts += [Sentence(texts("pair_doubt", line=line), "doubt") for line in result.doubts]
    return [*parts, Sentence(f"{texts('pair_note')} {texts('pair_footer', pair=result)}", "note")]


def _hidden_rows(result: PairResult) -> list[Row]:
    return [(one.arm or "–", one.what, one.reason) for one in result.not_testable]


def _base_rows(result: PairResult, texts: Texts) -> list[Row]:
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


def _constant_rows(result: PairResult) -> list[Row]:
    """Certain corrections: arm, constant, correction, u, unit."""
    rows = list[Row]()
    for constant in sorted(result.constants, key=lambda constant: (constant.arm, constant.axis, constant.key)):
        if not constant.shown or abs(constant.delta) <= _CERTAIN * constant.u:
            continue
        digits = 3 if constant.unit == "mm" else 4
        size, u = f"{constant.delta:+.{digits}f}", f"{constant.u:.{digits}f}"
        rows.append((constant.arm, constant.symbol, size, u, constant.unit))
    return rows


def page_of(result: PairResult, language: Language = "en") -> str:
    texts = texts_of(language)
    return answer_page(texts("pair_title", pair=result), pair_answer(result, texts), language)


def plan_answer(planned: PlannedTouches) -> list[Block]:
    result = planned.expected
    shown = sum(constant.shown for constant in result.constants)
    first = (
        f"{len(planned.table.q)} touches show {shown} of {len(result.constants)} constants of both arms, and the frame "
        f"of {result.names[1]} at the work to {_triple(result.base.u_work_mm)} mm in x, y, z."
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
