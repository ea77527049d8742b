"""Sentences about movements: the answer, the recommended action, sizes with uncertainty, and the next touch."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.evidence.movements import Movement
from analysis.movement.causes import Cause
from analysis.movement.next_touch import Lever, ReferencePosture
from analysis.movement.result import CauseOdds, MovementResult, short_name
from analysis.report.texts import Texts, texts_of
from rigs.schema.part import Vector

_MOST_ODDS = 1000
"""Odds above which only this bound is stated."""

_WIDE_DEG = 0.03
"""Smallest possible error of a joint zero that is reported: half a millimetre at a metre."""

_SMALL = 2.0
"""Smallest multiple of its uncertainty u at which a component of a direction is mentioned."""


def name_of(cause: Cause, *, of_tracker: bool = False) -> str:
    """Return the name of a cause in a sentence."""
    if cause.members:
        return " and ".join(name_of(member, of_tracker=of_tracker) for member in cause.members)
    names = {
        "base": "the base or the instrument" if of_tracker else "the base", "tool": "the tool",
        "zero": f"the zero of axis {cause.axis}", "nothing": "nothing", "other": "something else",
        "instrument": f"the instrument of {short_name(cause)}", "socket": f"socket {short_name(cause)}",
        "target": f"the target {short_name(cause)}".rstrip(),
    }  # fmt: skip
    return names[cause.what]


def size_of(cause: CauseOdds) -> str:
    """Return the size of a cause with uncertainty and direction; empty if there is none."""
    if cause.together:
        return "; ".join(f"{name_of(member.cause)} {size_of(member)}" for member in cause.together)
    if cause.size_deg is not None and cause.u is not None:
        return _angle(cause.size_deg, cause.u)
    if cause.translation_mm is None or cause.u is None:
        return ""
    return _shift(cause.translation_mm, cause.u, cause.rotation_deg, cause.u_rotation_deg, texts_of("en"))


def movement_sentence(movement: Movement, texts: Texts) -> str:
    """Return a movement found among the runs of a diagnosis as a sentence."""
    which = "base_tracker" if movement.what == "base" and movement.of_tracker else movement.what
    thing = texts(f"moved_{which}", axis=movement.axis or "", name=movement.name).rstrip()
    size = ""
    if movement.size_deg is not None and movement.u_deg is not None:
        size = _angle(movement.size_deg, movement.u_deg)
    elif movement.translation_mm is not None and movement.u_mm is not None:
        size = _shift(movement.translation_mm, movement.u_mm, movement.rotation_deg, movement.u_rotation_deg, texts)
    if movement.row is None:
        return texts("moved_between", thing=thing, size=size, first=movement.from_, second=movement.to)
    return texts("moved_from_row", thing=thing, size=size, row=movement.row, run=movement.run)


def _angle(size_deg: float, u_deg: float) -> str:
    return f"{size_deg:+.3f} ± {u_deg:.3f}°"


def _shift(shift_mm: Vector, u_mm: float, turn_deg: Vector | None, u_turn_deg: float | None, texts: Texts) -> str:
    """Return the length of a shift with the components that exceed their uncertainty, and a turn that does."""
    shown = [f"{axis} {mm:+.2f}" for axis, mm in zip("xyz", shift_mm, strict=True) if abs(mm) > _SMALL * u_mm]
    direction = f"{', '.join(shown)} mm" if shown else texts("moved_nowhere")
    words = f"{math.hypot(*shift_mm):.2f} ± {u_mm:.2f} mm ({direction})"
    turn = math.hypot(*turn_deg) if turn_deg else 0.0
    if u_turn_deg is None or turn <= _SMALL * u_turn_deg:
        return words
    return f"{words}, {texts('moved_turned', turn=f'{turn:.3f} ± {u_turn_deg:.3f}°')}"


def odds(probability: float) -> str:
    """Return a probability as odds."""
    ratio = probability / max(1 - probability, 1e-12)
    return f"more than {_MOST_ODDS} to 1" if ratio > _MOST_ODDS else f"{ratio:.0f} to 1"


def headline(moved: MovementResult) -> str:
    """Return the answer: the moved item, the size and direction of the movement, and the odds."""
    named = moved.named
    if not moved.readings:
        return f"There are no new readings yet; the reference has {moved.reference_readings}."
    if named is None:
        rivals = [
            f"{name_of(cause.cause, of_tracker=moved.of_tracker)} ({100 * cause.posterior:.0f} %)"
            for cause in moved.cannot_separate
        ]
        return f"{moved.readings} readings cannot decide between {_listed(rivals)}."
    certain = f"odds {odds(named.posterior)}"
    if named.what == "nothing":
        agree = f"{moved.readings} readings agree with the reference within their scatter of {moved.scatter_mm:.2f} mm"
        return f"Nothing moved: {agree} ({certain})."
    if named.what == "other":
        return f"An unknown cause changed the readings ({certain})."
    name = name_of(named.cause, of_tracker=moved.of_tracker)
    by = ": " if named.together else " by "
    return f"{name[0].upper()}{name[1:]} moved{by}{size_of(named)}, {certain}."


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)


def what_to_do(moved: MovementResult) -> str:
    """Return the recommended action."""
    named = moved.named
    if named is not None:
        causes = [member.cause for member in named.together] or [named.cause]
        english = texts_of("en")
        acts = [_act(cause, short_name(cause), english, of_tracker=moved.of_tracker) for cause in causes]
        return " ".join(dict.fromkeys(acts))
    if moved.next_posture is not None:
        return next_words(moved.next_posture)
    if moved.hidden:
        return "The postures of the reference cannot separate these causes. " + " ".join(
            map(hidden_words, moved.hidden)
        )
    return "Take more readings in other postures."


def act_after(movements: Sequence[Movement], texts: Texts) -> str:
    """Return the recommended action after movements found among the runs of a diagnosis."""
    acts = [_act(movement, movement.name, texts, of_tracker=movement.of_tracker) for movement in movements]
    return " ".join(dict.fromkeys(acts))


def _act(moved: Cause | Movement, name: str, texts: Texts, *, of_tracker: bool) -> str:
    which = {"base": "base_tracker" if of_tracker else "base", "nothing": "none"}.get(moved.what, moved.what)
    return texts(f"moved_act_{which}", axis=moved.axis or "", name=name)


def next_words(posture: ReferencePosture) -> str:
    """Return the posture to touch next."""
    angles = ", ".join(f"{np.degrees(angle):.1f}" for angle in posture.angles)
    place = posture.setup.rpartition("socket ")[2] if "socket " in posture.setup else ""
    where = f"touch socket {place}" if place else "measure the pose"
    return f"Next: {where} in the posture of row {posture.row + 1} of the reference (joint angles {angles} °)."


def hidden_words(lever: Lever) -> str:
    """Return the reason why a cause is not observable, and the remedy."""
    typical = f"{np.degrees(lever.cause.scale[0]):.2f}°" if lever.cause.what == "zero" else "the typical size"
    name = name_of(lever.cause)
    scatter = f"less than they scatter ({lever.scatter_mm:.2f} mm)"
    small = f"{typical} moves the readings by at most {lever.moves_mm:.2f} mm, {scatter}"
    remedy = f"Mount the ball farther from axis {lever.cause.axis}" if lever.cause.what == "zero" else "Add postures"
    return f"{name[0].upper()}{name[1:]} cannot be detected here: {small}. {remedy}."


def remarks(moved: MovementResult) -> list[str]:
    """Return further remarks for the reader."""
    lines = list(moved.doubts)
    named = moved.named
    if moved.wild_row is not None:
        lines.append(f"New reading {moved.wild_row} does not fit any cause: repeat it.")
    if named is not None and named.what == "zero" and named.cause.axis == 1:
        lines.append("A base that only turned about axis 1 would look the same.")
    if named is not None and named.what == "nothing":
        wide = [f"{k} up to {b:.2f}°" for k, b in enumerate(moved.zero_bounds_deg, start=1) if b > _WIDE_DEG]
        lines += [f"These readings do not exclude errors of the zero of axis {', '.join(wide)}."] if wide else []
        lines += map(hidden_words, moved.hidden)
    return lines
