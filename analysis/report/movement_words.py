"""What moved, in words: the first sentence, what to do, sizes with their uncertainty, and the next touch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.movement.causes import Cause
from analysis.movement.next_touch import Lever, Posture
from analysis.movement.result import Moved, short_name
from analysis.movement.words import name_of, size_of

_MOST_ODDS = 1000
"""Odds above which only this bound is stated."""

_WIDE_DEG = 0.03
"""Possible error of a zero from which it is reported: half a millimetre at a metre."""


def odds(probability: float) -> str:
    """Return a probability as odds."""
    ratio = probability / max(1 - probability, 1e-12)
    return f"more than {_MOST_ODDS} to 1" if ratio > _MOST_ODDS else f"{ratio:.0f} to 1"


def headline(moved: Moved) -> str:
    """Return the first sentence: what moved, by how much, in which direction and how certain."""
    named = moved.named
    if not moved.readings:
        return f"No new readings yet: {moved.reference_readings} readings of the reference."
    if named is None:
        rivals = [
            f"{name_of(cause.cause, of_tracker=moved.of_tracker)} ({100 * cause.posterior:.0f} %)"
            for cause in moved.cannot_separate
        ]
        return f"Not decided by {moved.readings} readings: {_listed(rivals)}."
    certain = f"odds {odds(named.posterior)}"
    if named.what == "nothing":
        agree = f"{moved.readings} readings agree with the reference within their scatter of {moved.scatter_mm:.2f} mm"
        return f"Nothing moved: {agree} ({certain})."
    if named.what == "other":
        return f"Something changed that no cause in the list explains ({certain})."
    name = name_of(named.cause, of_tracker=moved.of_tracker)
    by = ": " if named.together else " by "
    return f"{name[0].upper()}{name[1:]} moved{by}{size_of(named)}, {certain}."


def _listed(words: Sequence[str]) -> str:
    return " or ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)


_DO = {
    "nothing": "Nothing has to be done.",
    "base": "Fasten the base and the work, then teach the frame of the work again, or shift it by these values.",
    "base_tracker": "Fasten the base and the instrument. If the instrument stood still, teach the frame of the work "
    "again.",
    "instrument": "Fasten the instrument and measure its frame again; the robot needs no change.",
    "target": "Fasten the target or ball and measure its place again; the robot needs no change.",
    "tool": "Fasten the tool and teach its centre point again, or shift it by these values in the flange's axes.",
    "other": "Check the fastening of base, sockets and tool and the seat of the ball, then repeat the readings.",
}


def what_to_do(moved: Moved) -> str:
    """Return what a person should do."""
    named = moved.named
    if named is not None:
        causes = [member.cause for member in named.together] or [named.cause]
        return " ".join(dict.fromkeys(_act(cause, of_tracker=moved.of_tracker) for cause in causes))
    if moved.next_posture is not None:
        return next_words(moved.next_posture)
    if moved.hidden:
        return "No posture of the reference separates these causes. " + " ".join(map(hidden_words, moved.hidden))
    return "Take more readings in other postures."


def _act(cause: Cause, *, of_tracker: bool) -> str:
    if cause.what == "zero":
        return f"Re-master axis {cause.axis}, then repeat these readings."
    if cause.what == "socket":
        return f"Fasten socket {short_name(cause)} and touch it again; points taught from it move with it."
    return _DO["base_tracker" if cause.what == "base" and of_tracker else cause.what]


def next_words(posture: Posture) -> str:
    """Return the posture to touch next."""
    angles = ", ".join(f"J{k} {np.degrees(angle):.1f}" for k, angle in enumerate(posture.angles, start=1))
    place = posture.setup.rpartition("socket ")[2] if "socket " in posture.setup else ""
    where = f"touch socket {place}" if place else "measure the pose"
    return f"Next: {where} as in row {posture.row + 1} of the reference ({angles} °)."


def hidden_words(lever: Lever) -> str:
    """Return why a cause cannot be seen, and what would show it."""
    typical = f"{np.degrees(lever.cause.scale[0]):.2f}°" if lever.cause.what == "zero" else "its typical size"
    name = name_of(lever.cause)
    scatter = f"their scatter is {lever.scatter_mm:.2f} mm"
    small = f"{typical} moves the readings by {lever.moves_mm:.2f} mm at most, {scatter}"
    remedy = f"Mount the ball farther from axis {lever.cause.axis}" if lever.cause.what == "zero" else "Add postures"
    return f"{name[0].upper()}{name[1:]} is not shown here: {small}. {remedy}."


def remarks(moved: Moved) -> list[str]:
    """Return what else a person should know."""
    lines = list(moved.doubts)
    named = moved.named
    if moved.wild_row is not None:
        lines.append(f"New reading {moved.wild_row} fits nothing: repeat it.")
    if named is not None and named.what == "zero" and named.cause.axis == 1:
        lines.append("A base that turned about axis 1 and nothing else looks the same.")
    if named is not None and named.what == "nothing":
        wide = [f"{k} up to {b:.2f}°" for k, b in enumerate(moved.zero_bounds_deg, start=1) if b > _WIDE_DEG]
        lines += [f"Not excluded by these readings: errors of the zero of axis {', '.join(wide)}."] if wide else []
        lines += map(hidden_words, moved.hidden)
    return lines
