"""Phrases of a diagnosis: effects, sizes, odds, places, movements."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from analysis.apps.report.texts import ENGLISH, Texts, joined
from analysis.diagnosis.judge.budget_part import GroupMember
from analysis.diagnosis.judge.named import Named, Rival
from analysis.diagnosis.judge.residuals import Curve, HeldOutResidual, ResidualBand, ResidualPlace
from analysis.diagnosis.judge.result import Diagnosis, Movement
from analysis.movement.cause_odds import CauseOdds, short_name
from analysis.movement.causes import Cause
from analysis.procedures.shared.quantity import Quantity, parameters_of, quantity_of
from rigs.effects import Effect, size_field
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, WITHOUT_GAUGES

_WHOLE_LAP_DEG = 350.0
LEAST_ODDS = 0.01
"""Odds below which a cause is shown as "< 1 %" and not listed among the likeliest."""
_UPPER_BOUND = 1 / 3
"""Ratio to u below which a figure is shown as an upper bound."""


def plain_name(rig: Rig, effect: Effect) -> str:
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
    rows = list[tuple[str, str]]()
    for subject, share in residual.looked.items():
        key = "remains_unknown" if share is None else "remains_undetected"
        rows.append((texts(f"remains_{subject}"), percent(share) if share and share >= _FOUND else texts(key)))
    return rows


_SMALL = 2.0
"""Multiple of u from which a component of a direction is mentioned."""


def name_of(cause: Cause, texts: Texts = ENGLISH, *, of_tracker: bool = False) -> str:
    if cause.members:
        *others, last = (name_of(member, texts, of_tracker=of_tracker) for member in cause.members)
        return texts("cause_pair", first=", ".join(others), second=last)
    kind = _kind(cause.what, ("instrument" if of_tracker else "plate") if cause.what == "base" else None)
    return texts(f"cause_{kind}", axis=cause.axis or "", name=short_name(cause)).rstrip()


def size_of(cause: CauseOdds, texts: Texts = ENGLISH, *, of_tracker: bool = False) -> str:
    if cause.together:
        sizes = [(name_of(part.cause, texts, of_tracker=of_tracker), size_of(part, texts)) for part in cause.together]
        return "; ".join(map(" ".join, sizes))
    return _moved_by(cause, cause.u, cause.u, texts)


def movement_sentence(movement: Movement, texts: Texts) -> str:
    kind = _kind(movement.what, movement.alike)
    thing = texts(f"moved_{kind}", axis=movement.axis or "", name=movement.name).rstrip()
    size = _moved_by(movement, movement.u_deg, movement.u_mm, texts)
    return texts("moved_between" if movement.row is None else "moved_from_row", thing=thing, size=size, moved=movement)


def _moved_by(moved: CauseOdds | Movement, u_deg: float | None, u_mm: float | None, texts: Texts) -> str:
    """An angle, or the length of a shift with the components and the turn that exceed their uncertainty."""
    if moved.size_deg is not None and u_deg is not None:
        return f"{moved.size_deg:+z.3f} ± {u_deg:.3f}°"
    if (shift_mm := moved.translation_mm) is None or u_mm is None:
        return ""
    shown = [f"{axis} {mm:+z.2f}" for axis, mm in zip("xyz", shift_mm, strict=True) if abs(mm) > _SMALL * u_mm]
    direction = f"{', '.join(shown)} mm" if shown else texts("moved_nowhere")
    words = f"{math.hypot(*shift_mm):.2f} ± {u_mm:.2f} mm ({direction})"
    turn_deg, u_turn_deg = math.hypot(*(moved.rotation_deg or ())), moved.u_rotation_deg
    if u_turn_deg is None or turn_deg <= _SMALL * u_turn_deg:
        return words
    return f"{words}, {texts('moved_turned', turn=f'{turn_deg:.3f} ± {u_turn_deg:.3f}°')}"


def act_after(movements: Sequence[Movement], texts: Texts) -> str:
    return joined(dict.fromkeys(act_of(moved, moved.name, texts, moved.alike) for moved in movements))


def act_of(moved: Cause | Movement, name: str, texts: Texts, alike: str | None) -> str:
    """alike: see `look_alike`."""
    return texts(f"check_act_{_kind(moved.what, alike)}", axis=moved.axis or "", name=name)


def _kind(cause: str, alike: str | None) -> str:
    """Key of a cause, with the part that looks the same."""
    return f"{cause}_or_{alike}" if alike else cause
