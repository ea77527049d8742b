"""Effects outside the vocabulary, which a diagnosis must describe but not name.

Joint effects return (n,) rad for a joint, gauge effects change the readings (n, k) mm; `size` is in degrees or mm.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.joints import Form, Trace
from tests.worlds.stranger.screws import Array


def cross_term(fault: Fault, trace: Trace) -> Array:
    """An error depending on the sum of two joint angles, as of two gears with beating meshes."""
    sum_of = trace.q[:, fault.joint()] + trace.q[:, fault.joint("other")]
    return np.radians(fault.size) * np.sin(fault.shape["order"] * sum_of + np.radians(fault.shape["phase_deg"]))


def slip(fault: Fault, trace: Trace) -> Array:
    """A jump at an angle of the joint, up in one direction and down in the other, as of a slipping coupling."""
    q = trace.q[:, fault.joint()]
    at = q.min() + fault.shape["share"] * np.ptp(q)
    return np.radians(fault.size) * 0.5 * (1 + np.tanh((q - at) / np.radians(0.02)))


def speed_error(fault: Fault, trace: Trace) -> Array:
    """An error to one side that depends on the speed of the joint in either direction, 1 at 10°/s."""
    return np.radians(fault.size) * np.abs(trace.rate[:, fault.joint()]) / np.radians(10.0)


def foreign_friction(fault: Fault, trace: Trace) -> Array:
    """An error that depends on another joint's direction of motion, as of a dragging cable."""
    return np.radians(fault.size) * np.tanh(trace.rate[:, fault.joint("other")] / np.radians(0.3))


OUT_JOINT: Mapping[str, Form] = {form.__name__: form for form in (cross_term, slip, speed_error, foreign_friction)}


def dent(fault: Fault, contact: Array) -> Array:
    """Reduced distance (n,) mm where the link crosses a dent of the ball."""
    away = np.angle(np.exp(1j * (contact - np.radians(fault.shape["at_deg"]))))
    return -fault.size * np.exp(-0.5 * (away / np.radians(fault.shape["wide_deg"])) ** 2)


def thermal_step(fault: Fault, t: Array) -> Array:
    """A step (n,) mm lasting about a second, at a time given as a share of the run."""
    return fault.size * 0.5 * (1 + np.tanh((t - fault.shape["share"] * t[-1]) / 0.5))


def rate_hysteresis(fault: Fault, t: Array, g: Array) -> Array:
    """Lag (n,) mm of a plunger with friction proportional to the root of its speed, 1 at 0.1 mm/s."""
    rate = np.gradient(g, t)
    return -fault.size * np.sign(rate) * np.sqrt(np.abs(rate) / 0.1)
