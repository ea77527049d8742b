"""Sentences about movements: causes, sizes, and recommended actions."""

from __future__ import annotations

import math
from collections.abc import Sequence

from analysis.apps.report.texts import Texts, joined, texts_of
from analysis.diagnosis.judge.result import Movement
from analysis.movement.causes import Cause
from analysis.movement.inference import CauseOdds, short_name
from rigs.schema.part import Vector

_ENGLISH = texts_of("en")
_SMALL = 2.0
"""Multiple of u from which a component of a direction is mentioned."""


def name_of(cause: Cause, texts: Texts = _ENGLISH, *, of_tracker: bool = False) -> str:
    if cause.members:
        *others, last = (name_of(member, texts, of_tracker=of_tracker) for member in cause.members)
        return texts("cause_pair", first=", ".join(others), second=last)
    kind = _kind(cause.what, ("instrument" if of_tracker else "plate") if cause.what == "base" else None)
    return texts(f"cause_{kind}", axis=cause.axis or "", name=short_name(cause)).rstrip()


def size_of(cause: CauseOdds, texts: Texts = _ENGLISH, *, of_tracker: bool = False) -> str:
    if cause.together:
        sizes = [(name_of(part.cause, texts, of_tracker=of_tracker), size_of(part, texts)) for part in cause.together]
        return "; ".join(map(" ".join, sizes))
    if cause.size_deg is not None and cause.u is not None:
        return _angle(cause.size_deg, cause.u)
    if cause.translation_mm is None or cause.u is None:
        return ""
    return _shift(cause.translation_mm, cause.u, cause.rotation_deg, cause.u_rotation_deg, texts)


def movement_sentence(movement: Movement, texts: Texts) -> str:
    kind = _kind(movement.what, movement.alike)
    thing = texts(f"moved_{kind}", axis=movement.axis or "", name=movement.name).rstrip()
    size = ""
    if movement.size_deg is not None and movement.u_deg is not None:
        size = _angle(movement.size_deg, movement.u_deg)
    elif movement.translation_mm is not None and movement.u_mm is not None:
        size = _shift(movement.translation_mm, movement.u_mm, movement.rotation_deg, movement.u_rotation_deg, texts)
    if movement.row is None:
        return texts("moved_between", thing=thing, size=size, first=movement.from_, second=movement.to)
    return texts("moved_from_row", thing=thing, size=size, row=movement.row, run=movement.run)


def _angle(size_deg: float, u_deg: float) -> str:
    return f"{size_deg:+z.3f} ± {u_deg:.3f}°"


def _shift(shift_mm: Vector, u_mm: float, turn_deg: Vector | None, u_turn_deg: float | None, texts: Texts) -> str:
    """Length of a shift, with the components and the turn that exceed their uncertainty."""
    shown = [f"{axis} {mm:+z.2f}" for axis, mm in zip("xyz", shift_mm, strict=True) if abs(mm) > _SMALL * u_mm]
    direction = f"{', '.join(shown)} mm" if shown else texts("moved_nowhere")
    words = f"{math.hypot(*shift_mm):.2f} ± {u_mm:.2f} mm ({direction})"
    turn = math.hypot(*turn_deg) if turn_deg else 0.0
    if u_turn_deg is None or turn <= _SMALL * u_turn_deg:
        return words
    return f"{words}, {texts('moved_turned', turn=f'{turn:.3f} ± {u_turn_deg:.3f}°')}"


def act_after(movements: Sequence[Movement], texts: Texts) -> str:
    return joined(dict.fromkeys(act_of(moved, moved.name, texts, moved.alike) for moved in movements))


def act_of(moved: Cause | Movement, name: str, texts: Texts, alike: str | None) -> str:
    """alike: see `look_alike`."""
    return texts(f"check_act_{_kind(moved.what, alike)}", axis=moved.axis or "", name=name)


def _kind(cause: str, alike: str | None) -> str:
    """Key of a cause, with the part that looks the same."""
    return f"{cause}_or_{alike}" if alike else cause
