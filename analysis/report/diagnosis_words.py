"""Parts of a diagnosis in plain words: effects, sizes, odds, places. What they answer together is in answer_words."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from analysis.diagnosis.judge.remains import Remains
from analysis.diagnosis.judge.residuals import Curve, Place, ResidualBand
from analysis.diagnosis.judge.result import Gap, Member, Named, Rival, likely_rivals
from analysis.procedures.shared.quantity import Quantity, parameters_of, quantity_of
from analysis.report.texts import Texts
from rigs.effects import Effect, size_field
from rigs.rig import Rig
from rigs.schema.effect import name_of
from rigs.schema.vocabulary import CIRCLES, WITHOUT_GAUGES

_WHOLE_LAP_DEG = 350.0
LEAST_ODDS = 0.01
"""Odds below which a cause is "< 1 %", and not said among the likeliest."""
_BY_FAR = 1 / 3
"""Share of its standard uncertainty below which a figure says nothing beyond that uncertainty."""


def plain(rig: Rig, effect: Effect) -> str:
    """An effect as a person says it: `play of axis 1 (Theta)`."""
    axis = getattr(effect, "axis", None)
    return effect.plain("" if axis is None else rig.robot.axis_words(axis))


def with_uncertainty(effect: Effect, field: str, sd: Mapping[str, float], times: float = 1.0) -> str:
    """A parameter ± `times` its standard uncertainty, to sensible digits; alone where no uncertainty is known."""
    quantity = quantity_of(effect, field, sd)
    if not 0 < quantity.u < math.inf:
        return f"{quantity.value:.4g} {quantity.sign}".rstrip()
    return str(Quantity(quantity.value, times * quantity.u, quantity.unit))


def size(named: Named | Rival | Member, times: float = 1.0) -> str:
    """The size of a named effect, a rival or a member of a group, ± `times` its standard uncertainty."""
    return with_uncertainty(named.effect, size_field(named.effect), named.sd, times)


def beside_size(named: Named) -> list[str]:
    """The parameters that say how it looks: those fitted, and those that each such effect has (the order of a gear)."""
    fields = type(named.effect).model_fields
    return [
        field
        for field in parameters_of(named.effect)
        if field != size_field(named.effect) and (field in named.sd or fields[field].is_required())
    ]


def rival_names(named: Named) -> list[str]:
    """The names of the rivals of a name that cannot be dismissed."""
    return [name_of(rival.effect) for rival in likely_rivals(named)]


def sure(posterior: float) -> str:
    """A share of the evidence in percent, never more than is known."""
    if posterior > 0.999:
        return "> 99.9 %"
    if posterior < LEAST_ODDS:
        return "< 1 %"
    return f"{100 * posterior:.1f} %" if posterior > 0.99 else f"{100 * posterior:.0f} %"


def percent(share: float) -> str:
    """A share in percent, as many digits as a reader needs."""
    value = 100 * share
    return f"{value:.0f} %" if abs(value) >= 0.95 else f"{value:z.1f} %"


def micrometres(um: float) -> str:
    """A size in µm as a person can use it: two digits below ten, whole numbers above."""
    if not math.isfinite(um):
        return "–"
    return f"{um:.0f} µm" if um >= 9.95 else f"{um:.1f} µm"


def beside_u(um: float, u_um: float) -> str:
    """The figure of a column in µm ± its standard uncertainty, to a tenth; "< u" where it is far smaller than that."""
    if not math.isfinite(um):
        return "–"
    if um < _BY_FAR * u_um:
        return f"< {u_um:.1f}"
    return f"{um:.1f} ± {u_um:.1f}" if u_um > 0 else f"{um:.1f}"


def within(um: float, u_um: float) -> str:
    """A size in µm ± its standard uncertainty; one that is smaller than that by far as less than it."""
    if not math.isfinite(um):
        return "–"
    if um < _BY_FAR * u_um:
        return f"< {micrometres(u_um)}"
    return f"{micrometres(um).removesuffix(' µm')} ± {micrometres(u_um)}" if u_um > 0 else micrometres(um)


def runs_of(place: Place | Curve | ResidualBand) -> str:
    """`yaw acw`, `radial`."""
    return f"{place.test} {place.direction}" if place.direction else place.test


def stretch(place: Place) -> str:
    """Where on the circle, or at which targets: `231–243°`, `targets 3–7`."""
    low, high = place.from_deg, place.to_deg
    if place.test not in CIRCLES:
        row = "row" if place.test in WITHOUT_GAUGES else "target"
        return f"{row} {low:.0f}" if low == high else f"{row}s {low:.0f}–{high:.0f}"
    is_whole = high - low >= 360 or (high - low) % 360 >= _WHOLE_LAP_DEG
    return "whole lap" if is_whole else f"{low:.0f}–{high:.0f}°"


def closed(gap: Gap) -> float:
    """Share of the gap's energy that the names and a healthy arm's share of everything remove; nan without a gap."""
    return 1 - (gap.calibrated_um / gap.before_um) ** 2 if gap.before_um > 0 else math.nan


def shortened(names: Iterable[str]) -> str:
    """Names of effects, those of one kind together, as an effect and all the seats that it has."""
    seats: dict[str, list[str]] = {}
    for name in names:
        kind, _, seat = name.partition(" ")
        seats.setdefault(kind, []).append(seat)
    return ", ".join(" ".join([kind, *sorted(filter(None, axes))]) for kind, axes in seats.items())


_FOUND = 0.02
"""Share from which something counts as found: the strength is chosen by what is left out, which flatters a little."""


def remains_lines(remains: Remains, texts: Texts) -> list[str]:
    """Return what stays at places left out, and what it goes with or does not."""
    shares = {texts(f"remains_{looked.subject}"): looked.share for looked in remains.looked if looked.share is not None}
    shown = [f"{subject} {percent(share)}" for subject, share in shares.items() if share >= _FOUND]
    none = [subject for subject, share in shares.items() if share < _FOUND]
    goes_with = texts("remains_found", shares=", ".join(shown)) if shown else ""
    against = texts("remains_none", subjects=", ".join(none)) if none else ""
    whole = texts("remains", um=micrometres(remains.um), noise=micrometres(remains.noise_um))
    return [whole, " ".join(filter(None, (goes_with, against)))]


def remains_rows(remains: Remains, texts: Texts) -> list[tuple[str, str]]:
    """Return a row for each thing that it was held against: what, and the share that it explains, or why it has
    none."""

    def words(share: float | None) -> str:
        if share is None:
            return texts("remains_unknown")
        return percent(share) if share >= _FOUND else texts("remains_undetected")

    return [(texts(f"remains_{looked.subject}"), words(looked.share)) for looked in remains.looked]
