"""Whether a calibration file can be that of a rig: its hash proves that the file was not changed, not that it is right.

A file that somebody has rewritten, with the new hash in the rig file, is held against the arm: its name, its axes,
and the bounds that the same effects have in a rig file.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from rigs.calibration import TIMES, CalibratedModel, Parameter
from rigs.errors import FileError
from rigs.schema.effect import size_field

if TYPE_CHECKING:
    from rigs.rig import Rig

_REMEDY = "restore both files of one diagnosis, or diagnose again"
_MOST_UM = 1e6
"""A metre: no arm that moves errs by more."""
_LEAST_DEG, _MOST_DEG = -1000.0, 1000.0
"""Joint angles: no controller counts beyond three turns."""


def hold_plausible(calibrated: CalibratedModel, rig: Rig, where: str) -> None:
    """Raise FileError where a calibration cannot be that of the rig whose file names it."""
    for why in _reasons(calibrated, rig):
        raise FileError(where, why, _REMEDY)


def _reasons(calibrated: CalibratedModel, rig: Rig) -> Iterator[str]:
    """Yield why a calibration cannot be that of a rig."""
    axes = len(rig.robot.axes)
    if calibrated.rig != rig.name:
        yield f"is the calibration of {calibrated.rig}, and the rig file is that of {rig.name}"
    if len(calibrated.joints_deg) != axes:
        yield f"is of an arm of {len(calibrated.joints_deg)} axes, and that of the rig file has {axes}"
    if not all(_LEAST_DEG <= low <= high <= _MOST_DEG for low, high in calibrated.joints_deg):
        yield "joints_deg are no ranges of joint angles"
    errors_um = (calibrated.before_um, calibrated.calibrated_um, calibrated.held_out_um or 0.0)
    if not all(0 <= error <= _MOST_UM for error in errors_um):
        yield "states errors that no arm has"
    for number, term in enumerate(calibrated.terms):
        if (axis := getattr(term.effect, "axis", 1)) > axes:
            yield f"term {number} is of axis {axis}, and the arm has {axes}"
        name = size_field(term.effect)
        value, bound = abs(term.times * float(getattr(term.effect, name))), _bound(term.effect, name)
        if not value <= bound:
            yield f"term {number} has {name} {value:g} in all, and an arm at most {bound:g}"
    spread = np.sqrt((calibrated.root**2).sum(axis=1))
    for parameter, sd in zip(calibrated.parameters, spread.tolist(), strict=True):
        if not sd <= _widest(calibrated, parameter):
            yield f"the uncertainty of {parameter.field} of term {parameter.term} is {sd:.3g}, more than it can be"


def _widest(calibrated: CalibratedModel, parameter: Parameter) -> float:
    effect = calibrated.terms[parameter.term].effect
    if parameter.field != TIMES:
        return _bound(effect, parameter.field)
    name = size_field(effect)
    size = abs(float(getattr(effect, name)))
    return _bound(effect, name) / size if size else np.inf


def _bound(effect: Any, field: str) -> float:
    """Return the largest value of a parameter of an effect in a rig file, infinite where it has no bound."""
    bounds = [getattr(constraint, "le", None) for constraint in type(effect).model_fields[field].metadata]
    return next((float(bound) for bound in bounds if bound is not None), np.inf)
