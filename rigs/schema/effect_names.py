"""Names of effects in words, for the English of screens: `bending of links 1, 4 and 5` for `link_bending 1`, and so on.

The identifiers of the vocabulary (`link_bending 1`) are for files, options and JSON. Effects of external packages keep
their identifier.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rigs.schema.effect import waves_in_words


@dataclass(frozen=True)
class _KindName:
    """The everyday name of a kind of effect, and the noun of its seat: axis, link, gauge, or empty if it has none."""

    name: str
    seat: str = ""

    @property
    def seats(self) -> str:
        """The plural of the seat."""
        return "axes" if self.seat == "axis" else f"{self.seat}s"


_KINDS = {
    "backlash": _KindName("play", "axis"),
    "compliance": _KindName("deflection under load", "axis"),
    "joint_offset": _KindName("zero", "axis"),
    "joint_scale": _KindName("angle scale", "axis"),
    "link_bending": _KindName("bending", "link"),
    "link_geometry a": _KindName("length a", "axis"),
    "link_geometry alpha": _KindName("twist alpha", "axis"),
    "link_geometry beta": _KindName("twist beta", "axis"),
    "link_geometry d": _KindName("offset d", "axis"),
    "reversal_spike": _KindName("wind-up after reversals", "axis"),
    "servo_lag": _KindName("lag behind the feedback", "axis"),
    "strain_wave": _KindName("torsion of the gear", "axis"),
    "transmission_error": _KindName("gear error", "axis"),
    "base_sags": _KindName("sag of the base under load"),
    "base_yields": _KindName("tilt of the base under load"),
    "rail_line": _KindName("straightness of the rail"),
    "wrist_coupling": _KindName("coupling between wrist axes"),
    "gauge_cyclic": _KindName("interpolation error", "gauge"),
    "gauge_dead_band": _KindName("sticking", "gauge"),
    "gauge_drift": _KindName("drift", "gauge"),
    "gauge_inclination": _KindName("inclination", "gauge"),
    "gauge_scale": _KindName("scale", "gauge"),
    "ball_form": _KindName("form of the ball"),
    "clock_rate": _KindName("rate of the gauges' clock"),
    "gauge_baseline": _KindName("distance between the gauges"),
    "link_growth": _KindName("thermal growth of the ball link"),
    "thermal_growth": _KindName("thermal growth of the arm"),
    "time_lag": _KindName("delay of the gauges"),
    "vibration": _KindName("vibration"),
}
_SEATS = {
    "x": "about x",
    "y": "about y",
    "xy": "between x and y",
    "yx": "between y and −x",
    "evenly": "in all directions",
}
"""Seats that are directions of the base, in words."""


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
    """Return the everyday name of a parameter that describes the shape of an effect."""
    return _PARAMETERS.get(field, field)


def kind_in_words(kind: str) -> str:
    """Return the everyday name of a kind of effect (`link_geometry a`, `backlash`), without the seat."""
    return _KINDS[kind].name if kind in _KINDS else kind


def name_in_words(label: str) -> str:
    """Return one name or label in words: `zero of axis 5` for `joint_offset 5`, with the order of a gear error."""
    label, _, order = label.partition(" order ")
    return names_in_words([label]) + (f", {waves_in_words(float(order))}" if order else "")


def names_in_words(names: Iterable[str]) -> str:
    """Return names in words, each kind once and without orders: `play of axes 1 and 6; bending of links 1, 4 and 5`."""
    seats: dict[str, set[str]] = {}
    for name in names:
        kind, seat = _split(name.partition(" order ")[0])
        seats.setdefault(kind, set()).add(seat)
    return "; ".join(_with_seats(kind, sorted(filter(None, of_kind))) for kind, of_kind in seats.items())


def _split(name: str) -> tuple[str, str]:
    """Split a name into the kind, for a link constant with its field, and the seat."""
    kind, _, seat = name.partition(" ")
    axis, _, field = seat.partition(".")
    return (f"{kind} {field}", axis) if f"{kind} {field}" in _KINDS else (kind, seat)


def _with_seats(kind: str, seats: Sequence[str]) -> str:
    if kind not in _KINDS:
        return " ".join([kind, *seats])
    known = _KINDS[kind]
    if not seats:
        return known.name
    if not known.seat:
        return f"{known.name} ({', '.join(_SEATS.get(seat, seat.replace('>', ' to ')) for seat in seats)})"
    noun = known.seat if len(seats) == 1 else known.seats
    return f"{known.name} of {noun} {_and(seats)}"


def _and(words: Sequence[str]) -> str:
    return f"{', '.join(words[:-1])} and {words[-1]}" if len(words) > 1 else words[0]
