"""Phrases of a diagnosis: effects, sizes, odds, places."""

from __future__ import annotations

import math
from collections.abc import Mapping

from analysis.apps.report.texts import Texts
from analysis.diagnosis.judge.residuals import Curve, HeldOutResidual, ResidualBand, ResidualPlace
from analysis.diagnosis.judge.result import Diagnosis, GroupMember, Named, Rival
from analysis.procedures.shared.quantity import Quantity, parameters_of, quantity_of
from rigs.effects import Effect, size_field
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, WITHOUT_GAUGES

_WHOLE_LAP_DEG = 350.0
LEAST_ODDS = 0.01
"""Odds below which a cause is shown as "< 1 %" and not listed among the likeliest."""
_UPPER_BOUND = 1 / 3
"""Ratio to u below which a figure is shown as an upper bound."""


def plain(rig: Rig, effect: Effect) -> str:
    """`play of axis 1 (Theta)`."""
    axis = getattr(effect, "axis", None)
    return effect.plain("" if axis is None else rig.robot.axis_words(axis))


def with_uncertainty(effect: Effect, field: str, sd: Mapping[str, float], times: float = 1.0) -> str:
    """A parameter ± `times` its standard uncertainty, if that is known."""
    quantity = quantity_of(effect, field, sd)
    if not 0 < quantity.u < math.inf:
        return f"{quantity.value:z.4g} {quantity.sign}".rstrip()
    return str(Quantity(quantity.value, times * quantity.u, quantity.unit))


def size(named: Named | Rival | GroupMember, times: float = 1.0) -> str:
    return with_uncertainty(named.effect, size_field(named.effect), named.sd, times)


def other_parameters(named: Named) -> list[str]:
    """Parameters other than the size, if fitted, or required such as a gear's order."""
    fields = type(named.effect).model_fields
    return [
        field
        for field in parameters_of(named.effect)
        if field != size_field(named.effect) and (field in named.sd or fields[field].is_required())
    ]


def sure(posterior: float) -> str:
    """Percent, bounded at "> 99.9 %" and "< 1 %"."""
    if posterior > 0.999:
        return "> 99.9 %"
    if posterior < LEAST_ODDS:
        return "< 1 %"
    return f"{100 * posterior:.1f} %" if posterior > 0.99 else f"{100 * posterior:.0f} %"


def percent(share: float) -> str:
    value = 100 * share
    return f"{value:.0f} %" if abs(value) >= 0.95 else f"{value:z.1f} %"


def micrometres(um: float, u_um: float = 0.0) -> str:
    return f"{error_size(um, u_um)} µm" if math.isfinite(um) else "–"


def has_measured_noise(diagnosis: Diagnosis) -> bool:
    """True if repeats or residuals show the noise; an assumed noise gives no uncertainty."""
    return diagnosis.shows_noise or diagnosis.repeated


def measured_u(diagnosis: Diagnosis, u_um: float | None) -> float:
    """Standard uncertainty; 0 if it is unknown or would come from an assumed noise."""
    return (u_um or 0.0) if has_measured_noise(diagnosis) else 0.0


def error_size(um: float, u_um: float) -> str:
    """Both with the same decimals; "< u" if the error is much smaller than u."""
    if not math.isfinite(um):
        return "–"
    if um < _UPPER_BOUND * u_um:
        return f"< {error_size(u_um, 0.0)}"
    decimals = 1 if min(um, u_um or um) < 9.95 else 0
    return f"{um:.{decimals}f} ± {u_um:.{decimals}f}" if u_um > 0 else f"{um:.{decimals}f}"


def runs_of(place: ResidualPlace | Curve | ResidualBand) -> str:
    """`yaw acw`, `radial`."""
    return f"{place.test} {place.direction}" if place.direction else place.test


def stretch(place: ResidualPlace) -> str:
    """`231–243°`, `targets 3–7`."""
    low, high = place.from_deg, place.to_deg
    if place.test not in CIRCLES:
        row = "row" if place.test in WITHOUT_GAUGES else "target"
        return f"{row} {low:.0f}" if low == high else f"{row}s {low:.0f}–{high:.0f}"
    is_whole = high - low >= 360 or (high - low) % 360 >= _WHOLE_LAP_DEG
    return "whole lap" if is_whole else f"{low:.0f}–{high:.0f}°"


_FOUND = 0.02
"""Share from which a quantity explains the residual. The fit is tuned on the validation places, so shares are
optimistic.
"""


def remains_rows(residual: HeldOutResidual, texts: Texts) -> list[tuple[str, str]]:
    """Each tested quantity with its share of the residual, or the reason for a missing share."""

    def words(share: float | None) -> str:
        if share is None:
            return texts("remains_unknown")
        return percent(share) if share >= _FOUND else texts("remains_undetected")

    return [(texts(f"remains_{subject}"), words(share)) for subject, share in residual.looked.items()]
