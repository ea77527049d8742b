"""The answer of a movement check: sentences and blocks for screen and page."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from analysis.apps.commission.next_touch import (
    Lever,
)
from analysis.apps.commission.what_moved import MovementResult
from analysis.apps.report.blocks import Block, Sentence, Table, paragraphs
from analysis.apps.report.diagnosis_words import act_after, act_of, movement_sentence, name_of, size_of, sure
from analysis.apps.report.html_page import answer_page, write_html
from analysis.apps.report.texts import Language, Texts, capital, joined, texts_of
from analysis.movement.cause_odds import MOST_ODDS, odds_of, short_name
from analysis.movement.causes import NOTHING
from analysis.movement.inference import FEWEST_TO_CLEAR
from rigs.schema.part import Vector

_ENGLISH = texts_of("en")
_WIDE_DEG = 0.03
"""Smallest possible error of a joint zero that is reported: 0.5 mm at 1 m."""
_MOST_CAUSES = 8
"""Number of causes listed; the JSON contains all."""


def movement_answer(moved: MovementResult, texts: Texts) -> list[Block]:
    is_unmoved = moved.named is not None and moved.named.what == "nothing"
    rows = []
    for cause in moved.causes[:_MOST_CAUSES]:
        name = name_of(cause.cause, texts, of_tracker=moved.of_tracker)
        size = size_of(cause, texts, of_tracker=moved.of_tracker) or "–"
        rows.append((name, sure(cause.posterior), size, "–" if cause.point_mm is None else _at(cause.point_mm)))
    columns = tuple(texts(f"check_column_{name}") for name in ("cause", "probability", "size", "point"))
    at, scatter = ", ".join(f"{value:z.0f}" for value in moved.centre_mm), f"{moved.scatter_mm:.3f}"
    footer = texts("check_footer", new=moved.readings, old=moved.reference_readings, scatter=scatter, at=at)
    return [
        Sentence(headline(moved, texts), "pass" if is_unmoved else "watch"),
        Sentence(what_to_do(moved, texts)),
        *([Table(columns, tuple(rows), frozenset({1}), key="causes")] if rows else []),
        *paragraphs(remarks(moved, texts), "doubt"),
        Sentence(f"{texts('check_note')} {footer}", "note"),
    ]


def _at(point: Vector) -> str:
    return ", ".join(f"{value:+z.2f}" for value in point) + " mm"


def write_page(moved: MovementResult, path: Path, name: str, language: Language = "en") -> None:
    texts = texts_of(language)
    write_html(answer_page(texts("check_title", name=name), movement_answer(moved, texts), language, boxed=2), path)


def headline(moved: MovementResult, texts: Texts = _ENGLISH) -> str:
    """The movement with size, direction and odds."""
    answer = _movement(moved, texts)
    if not moved.reference_movements:
        return answer
    return texts("check_references_differ", runs=", ".join(moved.reference_names), answer=answer)


def _movement(moved: MovementResult, texts: Texts) -> str:
    if not moved.readings:
        return texts("check_no_readings", count=moved.reference_readings)
    named, of_tracker = moved.named, moved.of_tracker
    readings = texts("check_reading" if moved.readings == 1 else "check_readings", count=moved.readings)
    if named is None and [cause.cause for cause in moved.cannot_separate] == [NOTHING]:
        return texts("check_unmoved_so_far", readings=readings, fewest=FEWEST_TO_CLEAR)
    if named is None:
        rivals = [
            f"{name_of(cause.cause, texts, of_tracker=of_tracker)} ({100 * cause.posterior:.0f} %)"
            for cause in moved.cannot_separate
        ]
        listed = texts("or").join([", ".join(rivals[:-1]), rivals[-1]]) if len(rivals) > 1 else "".join(rivals)
        return texts("check_open", readings=readings, rivals=listed)
    ratio = odds_of(named.posterior)
    certain = texts("check_odds_bound" if ratio >= MOST_ODDS else "check_odds", ratio=f"{ratio:.0f}")
    if named.what == "nothing":
        return texts("check_unmoved", readings=readings, scatter=f"{moved.scatter_mm:.2f}", odds=certain)
    if named.what == "other":
        return texts("check_other", odds=certain)
    thing = capital(name_of(named.cause, texts, of_tracker=of_tracker))
    size = size_of(named, texts, of_tracker=of_tracker)
    key = "check_pair" if named.together else "check_by_size"
    return texts(key, thing=thing, size=size, odds=certain)


def what_to_do(moved: MovementResult, texts: Texts = _ENGLISH) -> str:
    named = moved.named
    if named is not None:
        causes = [member.cause for member in named.together] or [named.cause]
        acts = [act_of(cause, short_name(cause), texts, moved.alike(cause)) for cause in causes]
        if earlier := moved.reference_movements:
            acts.append(texts("check_act_earlier", run=earlier[-1].to, act=act_after(earlier, texts)))
        return joined(dict.fromkeys(acts))
    if moved.next_posture is not None:
        posture = moved.next_posture
        angles = ", ".join(f"J{k} {np.degrees(angle):z.1f}" for k, angle in enumerate(posture.angles, start=1))
        key = "check_next_touch" if posture.socket else "check_next_pose"
        return texts(key, name=posture.socket, row=posture.row + 1, angles=angles)
    if moved.hidden:
        return joined([texts("check_inseparable"), *(hidden_words(lever, texts) for lever in moved.hidden)])
    return texts("check_act_more")


def hidden_words(lever: Lever, texts: Texts = _ENGLISH) -> str:
    is_zero = lever.cause.what == "zero"
    typical = f"{np.degrees(lever.cause.scale[0]):.2f}°" if is_zero else texts("check_typical_size")
    return texts(
        "check_hidden", thing=capital(name_of(lever.cause, texts)), typical=typical, moves=f"{lever.moves_mm:.2f}",
        scatter=f"{lever.scatter_mm:.2f}",
        remedy=texts("check_mount_ball" if is_zero else "check_add_postures", axis=lever.cause.axis),
    )  # fmt: skip


def remarks(moved: MovementResult, texts: Texts = _ENGLISH) -> list[str]:
    lines = [movement_sentence(movement, texts) for movement in moved.reference_movements] + list(moved.doubts)
    named = moved.named
    if named is not None and named.what != "nothing":
        lines.append(texts("check_not_in_error"))
    if moved.wild_row is not None:
        lines.append(texts("check_wild", row=moved.wild_row))
    alike = named and moved.alike(named.cause)
    if named is not None and alike in ("base", "tool"):
        lines.append(texts(f"check_{alike}_alike", axis=named.cause.axis))
    if named is not None and named.what == "nothing":
        bounds = enumerate(moved.zero_bounds_deg, start=1)
        wide = [texts("check_up_to", axis=k, size=f"{deg:.2f}") for k, deg in bounds if deg > _WIDE_DEG]
        lines += [texts("check_not_excluded", zeros=", ".join(wide))] if wide else []
        lines += [hidden_words(lever, texts) for lever in moved.hidden]
    return lines
