"""Sentences about movements: the answer, the recommended action, sizes with uncertainty, and the next touch."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from analysis.apps.report.texts import Texts, texts_of
from analysis.diagnosis.evidence.movements import Movement
from analysis.movement.causes import NOTHING, Cause, look_alike
from analysis.movement.inference import FEWEST_TO_CLEAR
from analysis.movement.next_touch import Lever, ReferencePosture
from analysis.movement.result import CauseOdds, MovementResult, short_name
from rigs.schema.part import Vector

_ENGLISH = texts_of("en")
_MOST_ODDS = 1000
"""Odds above which the text states only this bound."""

_WIDE_DEG = 0.03
"""Smallest possible error of a joint zero that is reported: half a millimetre at a metre."""

_SMALL = 2.0
"""Smallest multiple of its uncertainty u at which a component of a direction is mentioned."""


def name_of(cause: Cause, texts: Texts = _ENGLISH, *, of_tracker: bool = False) -> str:
    """Return the name of a cause in a sentence."""
    if cause.members:
        first, second = (name_of(member, texts, of_tracker=of_tracker) for member in cause.members)
        return texts("cause_pair", first=first, second=second)
    kind = "base_tracker" if cause.what == "base" and of_tracker else cause.what
    return texts(f"cause_{kind}", axis=cause.axis or "", name=short_name(cause)).rstrip()


def size_of(cause: CauseOdds, texts: Texts = _ENGLISH) -> str:
    """Return the size of a cause with uncertainty and direction; empty if there is none."""
    if cause.together:
        return "; ".join(f"{name_of(member.cause, texts)} {size_of(member, texts)}" for member in cause.together)
    if cause.size_deg is not None and cause.u is not None:
        return _angle(cause.size_deg, cause.u)
    if cause.translation_mm is None or cause.u is None:
        return ""
    return _shift(cause.translation_mm, cause.u, cause.rotation_deg, cause.u_rotation_deg, texts)


def movement_sentence(movement: Movement, texts: Texts) -> str:
    """Return a movement found among the runs of a diagnosis as a sentence."""
    kind = _kind(movement, movement.axes, of_tracker=movement.of_tracker)
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
    """Return the length of a shift with the components that exceed their uncertainty, and a turn that does."""
    shown = [f"{axis} {mm:+z.2f}" for axis, mm in zip("xyz", shift_mm, strict=True) if abs(mm) > _SMALL * u_mm]
    direction = f"{', '.join(shown)} mm" if shown else texts("moved_nowhere")
    words = f"{math.hypot(*shift_mm):.2f} ± {u_mm:.2f} mm ({direction})"
    turn = math.hypot(*turn_deg) if turn_deg else 0.0
    if u_turn_deg is None or turn <= _SMALL * u_turn_deg:
        return words
    return f"{words}, {texts('moved_turned', turn=f'{turn:.3f} ± {u_turn_deg:.3f}°')}"


def odds(probability: float, texts: Texts = _ENGLISH) -> str:
    """Return a probability as odds."""
    ratio = probability / max(1 - probability, 1e-12)
    if ratio > _MOST_ODDS:
        return texts("check_odds_bound", ratio=_MOST_ODDS)
    return texts("check_odds", ratio=f"{ratio:.0f}")


def headline(moved: MovementResult, texts: Texts = _ENGLISH) -> str:
    """Return the answer: the moved item, the size and direction of the movement, and the odds."""
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
        return texts("check_open", readings=readings, rivals=_listed(rivals, texts))
    certain = odds(named.posterior, texts)
    if named.what == "nothing":
        return texts("check_unmoved", readings=readings, scatter=f"{moved.scatter_mm:.2f}", odds=certain)
    if named.what == "other":
        return texts("check_other", odds=certain)
    thing = _capitalised(name_of(named.cause, texts, of_tracker=of_tracker))
    key = "check_pair" if named.together else "check_by_size"
    return texts(key, thing=thing, size=size_of(named, texts), odds=certain)


def _capitalised(words: str) -> str:
    return words[:1].upper() + words[1:]


def _listed(words: Sequence[str], texts: Texts) -> str:
    return texts("or").join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)


def what_to_do(moved: MovementResult, texts: Texts = _ENGLISH) -> str:
    """Return the recommended action."""
    named = moved.named
    if named is not None:
        causes = [member.cause for member in named.together] or [named.cause]
        axes = len(moved.zero_bounds_deg)
        acts = [_act(cause, short_name(cause), texts, axes, of_tracker=moved.of_tracker) for cause in causes]
        return " ".join(dict.fromkeys(acts))
    if moved.next_posture is not None:
        return next_words(moved.next_posture, texts)
    if moved.hidden:
        return " ".join([texts("check_inseparable"), *(hidden_words(lever, texts) for lever in moved.hidden)])
    return texts("check_act_more")


def act_after(movements: Sequence[Movement], texts: Texts) -> str:
    """Return the recommended action after movements found among the runs of a diagnosis."""
    acts = [_act(moved, moved.name, texts, moved.axes, of_tracker=moved.of_tracker) for moved in movements]
    return " ".join(dict.fromkeys(acts))


def _act(moved: Cause | Movement, name: str, texts: Texts, axes: int, *, of_tracker: bool) -> str:
    return texts(f"check_act_{_kind(moved, axes, of_tracker=of_tracker)}", axis=moved.axis or "", name=name)


def _kind(moved: Cause | Movement, axes: int, *, of_tracker: bool) -> str:
    """Return the key of a cause in the texts, with the part that looks the same."""
    alike = look_alike(moved.axis, axes)
    is_either = moved.what == "base" and of_tracker
    return f"{moved.what}{'_tracker' * is_either}{f'_or_{alike}' if alike else ''}"


def next_words(posture: ReferencePosture, texts: Texts = _ENGLISH) -> str:
    """Return the posture to touch next."""
    angles = ", ".join(f"J{k} {np.degrees(angle):z.1f}" for k, angle in enumerate(posture.angles, start=1))
    key = "check_next_touch" if posture.socket else "check_next_pose"
    return texts(key, name=posture.socket, row=posture.row + 1, angles=angles)


def hidden_words(lever: Lever, texts: Texts = _ENGLISH) -> str:
    """Return the reason why a cause is not observable, and the remedy."""
    is_zero = lever.cause.what == "zero"
    typical = f"{np.degrees(lever.cause.scale[0]):.2f}°" if is_zero else texts("check_typical_size")
    return texts(
        "check_hidden", thing=_capitalised(name_of(lever.cause, texts)), typical=typical, moves=f"{lever.moves_mm:.2f}",
        scatter=f"{lever.scatter_mm:.2f}",
        remedy=texts("check_mount_ball" if is_zero else "check_add_postures", axis=lever.cause.axis),
    )  # fmt: skip


def remarks(moved: MovementResult, texts: Texts = _ENGLISH) -> list[str]:
    """Return further remarks for the reader."""
    lines = list(moved.doubts)
    named = moved.named
    if moved.wild_row is not None:
        lines.append(texts("check_wild", row=moved.wild_row))
    alike = named and look_alike(named.cause.axis, len(moved.zero_bounds_deg))
    if named is not None and alike:
        lines.append(texts(f"check_{alike}_alike", axis=named.cause.axis))
    if named is not None and named.what == "nothing":
        bounds = enumerate(moved.zero_bounds_deg, start=1)
        wide = [texts("check_up_to", axis=k, size=f"{deg:.2f}") for k, deg in bounds if deg > _WIDE_DEG]
        lines += [texts("check_not_excluded", zeros=", ".join(wide))] if wide else []
        lines += [hidden_words(lever, texts) for lever in moved.hidden]
    return lines
