"""Numbers that no gauge reads: beyond the range that the rig file states, or beyond any length there is.

A number that was put together wrongly (bytes or registers in the wrong order, a wrong type or address) is most often
beyond any length. It is GARBLED; one outside the stated range is the gauge's own trouble, DEVICE_ERROR.
"""

from __future__ import annotations

from daq.protocol.conversation import FaultKind
from rigs.schema.part import LONGEST_MM
from rigs.schema.probe import Probe

_LEAST_MM = 1e-20
"""What is left where double precision takes lengths of 0.1 mm from each other is some 1e-17 or nothing at all."""


def is_length(value_mm: float) -> bool:
    """Return whether a number can be a length that was measured; nan and infinity cannot."""
    return value_mm == 0 or _LEAST_MM < abs(value_mm) <= LONGEST_MM


def refusal(value_mm: float, gauge: Probe) -> tuple[FaultKind, str] | None:
    """Return why the number is not a reading of this gauge, and what to check; None where it can be one."""
    if not is_length(value_mm):
        return FaultKind.GARBLED, f"{value_mm:.3g} mm is no length that a gauge measures; check `units`"
    if gauge.limits_mm is None or gauge.limits_mm[0] <= value_mm <= gauge.limits_mm[1]:
        return None
    lowest_mm, highest_mm = gauge.limits_mm
    where = f"a reading outside its range_mm, {lowest_mm:g} to {highest_mm:g} mm"
    return FaultKind.DEVICE_ERROR, f"{where}; move the probe into its range, or correct `range_mm` or `units`"
