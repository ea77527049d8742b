"""What is missing between the stamps of a controller that was asked for a rate, and may keep to a lower one.

A controller of 125 Hz that is asked for 500 sends all it has, and nothing of it is missing. So a stamp is compared with
the step that the controller makes itself: the asked one as soon as it was seen once, else the least of the first steps.
"""

from __future__ import annotations

import math

from daq.protocol.conversation import Fault, FaultKind

_FIRST = 25
"""Steps from which the rate is taken, a fifth of a second at 125 Hz: packets are not skipped at each of them."""
_MORE = 1.5
"""Periods from which a step is longer than one."""


class SteadySteps:
    """Watches the stamps of successive packets."""

    def __init__(self, rate_hz: float) -> None:
        self._asked_s = 1 / rate_hz
        self._period_s = math.nan
        self._last_s = math.nan
        self._unjudged: list[tuple[float, float]] = []
        """Steps from a stamp to the next, while the period is not known."""

    def missing(self, clock_s: float, at_ns: int) -> list[Fault]:
        """Take the next stamp; return faults for packets missing before it, and for a rate other than the asked one."""
        before_s, self._last_s = self._last_s, clock_s
        if not clock_s > before_s:
            return []
        self._unjudged.append((before_s, clock_s))
        told = [] if math.isfinite(self._period_s) else self._found_period(at_ns)
        if math.isnan(self._period_s):
            return []
        steps, self._unjudged = self._unjudged, []
        return [*told, *(fault for step in steps for fault in self._skipped(*step, at_ns))]

    def _found_period(self, at_ns: int) -> list[Fault]:
        """Take the period from the steps so far, if they are enough."""
        least_s = min(after_s - before_s for before_s, after_s in self._unjudged)
        if least_s < _MORE * self._asked_s:
            self._period_s = self._asked_s
        elif len(self._unjudged) >= _FIRST:
            self._period_s = round(least_s / self._asked_s) * self._asked_s
            sent_hz, asked_hz = 1 / self._period_s, 1 / self._asked_s
            detail = f"the controller sends {sent_hz:g} packets a second, not {asked_hz:g}; write rate_hz: {sent_hz:g}"
            return [Fault(FaultKind.DOUBTFUL, at_ns, detail)]
        return []

    def _skipped(self, before_s: float, after_s: float, at_ns: int) -> list[Fault]:
        periods = (after_s - before_s) / self._period_s
        if not periods > _MORE:
            return []
        detail = f"controller time goes from {before_s:.3f} s to {after_s:.3f} s; lower rate_hz if this recurs"
        return [Fault(FaultKind.SKIPPED, at_ns, detail, round(periods) - 1)]
