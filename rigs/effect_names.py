"""Names of effects in words, for the English of screens: `bending of links 1, 4 and 5`.

Effects of external packages keep their identifier.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rigs.effects import VOCABULARY
from rigs.schema.effect import waves_in_words
from rigs.text import enumerated

_SEATS = {
    "x": "about x",
    "y": "about y",
    "xy": "between x and y",
    "yx": "between y and −x",
    "evenly": "in all directions",
}


_PARAMETERS = {
    "amplitude_deg": "amplitude",
    "below_mm": "depth of the tilt axis",
    "decay_s": "decay time",
    "frequency_hz": "frequency",
    "knee_Nm": "torque where the gear becomes stiffer",
    "lobes": "lobes",
    "order": "waves per turn",
    "payload_kg": "payload",
    "period_mm": "period",
    "phase_deg": "phase",
    "preload": "share of the play held by gravity",
    "rise": "rise time, share of the decay",
    "slow": "slowly decaying share",
    "transit": "gradual crossing of the play, 0 to 1",
    "time_constant_s": "time constant",
}


def parameter_in_words(field: str) -> str:
    return _PARAMETERS.get(field, field)


def kind_in_words(kind: str) -> str:
    effect, _, field = kind.partition(" ")
    return (VOCABULARY[effect].kind_name(field) or kind) if effect in VOCABULARY else kind


def name_in_words(label: str) -> str:
    label, _, order = label.partition(" order ")
    return names_in_words([label]) + (f", {waves_in_words(float(order))}" if order else "")


def names_in_words(names: Iterable[str]) -> str:
    """Names in words, each kind once and without orders: `play of axes 1 and 6; bending of links 1, 4 and 5`."""
    seats: dict[str, set[str]] = {}
    for name in names:
        kind, _, seat = name.partition(" order ")[0].partition(" ")
        axis, _, field = seat.partition(".")
        seats.setdefault(f"{kind} {field}" if field else kind, set()).add(axis if field else seat)
    return "; ".join(_with_seats(kind, sorted(filter(None, of_kind))) for kind, of_kind in seats.items())


def _with_seats(kind: str, seats: Sequence[str]) -> str:
    words, effect = kind_in_words(kind), kind.partition(" ")[0]
    if words == kind:
        return " ".join([kind, *seats])
    if not seats:
        return words
    noun = VOCABULARY[effect].SEAT_NOUN
    if not noun:
        return f"{words} ({', '.join(_SEATS.get(seat, seat.replace('>', ' to ')) for seat in seats)})"
    plural = "axes" if noun == "axis" else f"{noun}s"
    return f"{words} of {noun if len(seats) == 1 else plural} {enumerated(seats)}"
