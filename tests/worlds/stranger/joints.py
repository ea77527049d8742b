"""Deviations of joints and links from the encoders according to measurement.md, *link side = reported + effect*; rad,
mm.

Each function takes the complete motion and returns the deviation of a joint (n,) rad, or of the tool (n, 3) mm. With
`rough` the form deviates from the page: rounded, with harmonics, or with a second decay.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.play import lagging, reversals
from tests.worlds.stranger.screws import Arm, Array, Constants, Posed, torque_nm


@dataclass(frozen=True)
class Trace:
    """Motion of the motors: t (n,) s, q (n, 6) rad, and the arm of the rig file."""

    arm: Arm
    t: Array
    q: Array

    @cached_property
    def torque(self) -> Array:
        return torque_nm(self.arm, self.q)

    @cached_property
    def per_kg(self) -> Array:
        """Torques (n, 6) Nm per additional kilogram at the flange."""
        return torque_nm(self.arm, self.q, 1.0) - self.torque

    @cached_property
    def rate(self) -> Array:
        """Speeds of the motors (n, 6) rad/s."""
        return np.gradient(self.q, self.t, axis=0)

    @cached_property
    def turns(self) -> list[list[tuple[float, float]]]:
        return [reversals(self.t, column) for column in self.q.T]


Form = Callable[[Fault, Trace], Array]


def joint_offset(fault: Fault, trace: Trace) -> Array:
    """A constant."""
    return np.full(len(trace.t), np.radians(fault.size))


def joint_scale(fault: Fault, trace: Trace) -> Array:
    """A share of the joint angle."""
    return fault.size * trace.q[:, fault.joint()]


def backlash(fault: Fault, trace: Trace) -> Array:
    """A rounded backlash, reduced in proportion to the gravity load that holds the flank."""
    axis = fault.joint()
    half = np.radians(fault.size) / 2
    lag = lagging(trace.q[:, axis], half, fault.rough, fault.begin)
    held = fault.shape.get("preload", 0.0) * np.tanh(trace.torque[:, axis])
    return np.asarray((1 - np.abs(held)) * lag + held * half)


def transmission_error(fault: Fault, trace: Trace) -> Array:
    """A sine of the joint angle; rough: with second and third harmonics."""
    at = fault.shape["order"] * trace.q[:, fault.joint()] + np.radians(fault.shape["phase_deg"])
    third, second = 0.3 * fault.rough, 0.1 * fault.rough
    wave = np.sin(at) + third * np.sin(3 * at + fault.begin) + second * np.sin(2 * at + 2.0)
    return np.radians(fault.size) * wave


def compliance(fault: Fault, trace: Trace) -> Array:
    """Twist by the gravity torque of links and an unrecorded payload; rough: with increasing stiffness."""
    axis = fault.joint()
    torque = trace.torque[:, axis] + fault.shape.get("payload_kg", 0.0) * trace.per_kg[:, axis]
    if fault.rough:
        scale = np.abs(torque).max() + 1e-9
        torque = torque * (1 - 0.3 * fault.rough * (torque / scale) ** 2)
    return np.radians(fault.size) * torque


def strain_wave(fault: Fault, trace: Trace) -> Array:
    """A twist with three stiffness regions of the torque, after a hysteresis loss."""
    torque, knee = trace.torque[:, fault.joint()], fault.shape["knee_Nm"]
    if loss := fault.shape.get("loss", 0.0):
        torque = torque + lagging(torque, loss * knee, 0.0, fault.begin)
    corners = np.array([0.0, knee, 3.5 * knee, 1e6])
    twist = np.concatenate([[0.0], np.cumsum(np.diff(corners) / [1.0, 1.55, 1.75])])
    return np.radians(fault.size) * np.sign(torque) * np.interp(np.abs(torque), corners, twist)


def reversal_spike(fault: Fault, trace: Trace) -> Array:
    """A deflection against the new direction after each reversal; rough: with two decays and a finite rise
    time.
    """
    decay, share = fault.shape["decay_s"], 0.4 * fault.rough
    wound = np.zeros(len(trace.t))
    for when, direction in trace.turns[fault.joint()]:
        since = np.maximum(trace.t - when, 0.0)
        relaxing = (1 - share) * np.exp(-since / decay) + share * np.exp(-since / (4 * decay))
        if fault.rough:
            relaxing = relaxing * -np.expm1(-since / (0.1 * fault.rough * decay))
        wound -= np.where(trace.t >= when, direction * relaxing, 0.0)
    return np.radians(fault.size) * wound


def wrist_coupling(fault: Fault, trace: Trace) -> Array:
    """A share of another axis; rough: with a slightly eccentric shared gear."""
    q = trace.q[:, fault.joint("from_axis")]
    return fault.size * (q + 0.1 * fault.rough * np.sin(q + fault.begin))


def servo_lag(fault: Fault, trace: Trace) -> Array:
    """Difference to an earlier angle of the joint; rough: averaged over a time interval."""
    t, q = trace.t, trace.q[:, fault.joint()]
    ago = [np.interp(t - fault.size * (1 + share), t, q) for share in (-fault.rough, 0.0, fault.rough)]
    return np.mean(ago, axis=0) - q


ON_JOINT: Mapping[str, Form] = {
    form.__name__: form
    for form in (
        joint_offset, joint_scale, backlash, transmission_error, compliance, strain_wave, reversal_spike,
        wrist_coupling, servo_lag,
    )
}  # fmt: skip


def joint_of(fault: Fault) -> int:
    return fault.joint("to_axis" if "to_axis" in fault.keys else "axis")


def thermal_growth(fault: Fault, trace: Trace, at: Posed, base: Array) -> Array:
    """Growth of all lengths away from the base; rough: with a second, faster time constant."""
    tau = fault.shape["time_constant_s"]
    quick = 0.3 * fault.rough
    grown = -(1 - quick) * np.expm1(-trace.t / tau) - quick * np.expm1(-trace.t / (tau / 5))
    return 1e-6 * fault.size * grown[:, None] * (at.p - base)


def link_bending(fault: Fault, trace: Trace, at: Posed, base: Array) -> Array:
    """Bending of the link end across the link, about the joint axis; rough: also sideways."""
    axis = fault.joint()
    along = (at.end[:, axis + 1] if axis < 5 else at.p) - at.end[:, axis]
    across = np.cross(at.axis[:, axis], along)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(length > 1e-6, across / np.maximum(length, 1e-6), 0.0)
    across = across + 0.15 * fault.rough * at.axis[:, axis]
    return fault.size * trace.torque[:, axis, None] * across


ON_TOOL = {"thermal_growth": thermal_growth, "link_bending": link_bending}


def wrong_constants(constants: Constants, faults: list[Fault]) -> Constants:
    for fault in faults:
        if fault.effect == "link_geometry":
            field = str(fault.keys["field"])
            column = getattr(constants, field).copy()
            column[fault.joint()] += fault.size if field in ("a", "d") else np.radians(fault.size)
            constants = replace(constants, **{field: column})
    return constants
