"""Effects that are in no vocabulary: what a diagnosis must describe and not name.

Joint forms give (n,) rad for one joint, gauge forms change the readings (n, k) mm; `size` in degrees or mm.
"""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.joints import Form, Trace
from tests.worlds.stranger.screws import Array


def cross_term(fault: Fault, trace: Trace) -> Array:
    """A joint errs with the sum of its angle and another's: two gears whose meshes beat."""
    sum_of = trace.q[:, int(fault.keys["axis"]) - 1] + trace.q[:, int(fault.keys["other"]) - 1]
    return np.radians(fault.size) * np.sin(fault.shape["order"] * sum_of + np.radians(fault.shape["phase_deg"]))


def slip(fault: Fault, trace: Trace) -> Array:
    """A joint jumps at one angle, up on the way there and down on the way back: a coupling that slips."""
    q = trace.q[:, int(fault.keys["axis"]) - 1]
    at = q.min() + fault.shape["share"] * np.ptp(q)
    return np.radians(fault.size) * 0.5 * (1 + np.tanh((q - at) / np.radians(0.02)))


def speed_error(fault: Fault, trace: Trace) -> Array:
    """A joint leans to one side by how fast it turns, whichever way: 1 at 10°/s."""
    return np.radians(fault.size) * np.abs(trace.rate[:, int(fault.keys["axis"]) - 1]) / np.radians(10.0)


def foreign_friction(fault: Fault, trace: Trace) -> Array:
    """A joint yields to another joint's direction of motion: a cable that drags."""
    return np.radians(fault.size) * np.tanh(trace.rate[:, int(fault.keys["other"]) - 1] / np.radians(0.3))


OUT_JOINT: MappingProxyType[str, Form] = MappingProxyType({
    "cross_term": cross_term,
    "slip": slip,
    "speed_error": speed_error,
    "foreign_friction": foreign_friction,
})  # fmt: skip


def dent(fault: Fault, contact: Array) -> Array:
    """(n,) mm less distance where the link crosses a dent of the ball."""
    away = np.angle(np.exp(1j * (contact - np.radians(fault.shape["at_deg"]))))
    return -fault.size * np.exp(-0.5 * (away / np.radians(fault.shape["wide_deg"])) ** 2)


def thermal_step(fault: Fault, t: Array) -> Array:
    """(n,) mm: something settles within a second, some time into the run (in shares of it)."""
    return fault.size * 0.5 * (1 + np.tanh((t - fault.shape["share"] * t[-1]) / 0.5))


def rate_hysteresis(fault: Fault, t: Array, g: Array) -> Array:
    """(n,) mm: a plunger whose friction grows with the root of its speed, 1 at 0.1 mm/s."""
    rate = np.gradient(g, t)
    return -fault.size * np.sign(rate) * np.sqrt(np.abs(rate) / 0.1)
