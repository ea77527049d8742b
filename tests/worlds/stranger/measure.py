"""Noise-free readings of a motion with faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tests.worlds.stranger.cell import Cell
from tests.worlds.stranger.faults import Fault
from tests.worlds.stranger.gauges import Link, own_errors, raw_readings
from tests.worlds.stranger.joints import ON_JOINT, ON_TOOL, Trace, joint_of, wrong_constants
from tests.worlds.stranger.motion import Motion
from tests.worlds.stranger.outside import OUT_JOINT
from tests.worlds.stranger.screws import Array, Posed, arm_from, pose

_STEP_RAD, _STEP_MM = 1e-6, 1e-4


def trace_of(cell: Cell, motion: Motion) -> Trace:
    """Motion in the form required by joint effects; cache it for many faults of one motion."""
    return Trace(cell.arm, motion.t, motion.q)


def measure(
    cell: Cell,
    motion: Motion,
    faults: Sequence[Fault],
    link: Link,
    scatter: Array | None = None,
    trace: Trace | None = None,
) -> Array:
    """Return readings (m, k) mm at the rows of a motion. scatter (6,) rad: joint errors of this run.

    The place of the motion is that of the rig file, so its radius is the link length.
    """
    tool = tool_of(cell, motion, faults, trace or trace_of(cell, motion), scatter)
    return read(motion, faults, link, tool)


def read(motion: Motion, faults: Sequence[Fault], link: Link, tool: tuple[Posed, Array]) -> Array:
    """Return readings like `measure` for tool positions computed by `tool_of`, which take most of the time and are
    independent of the ball.
    """
    faults = list(faults)
    g = raw_readings(*tool, link, motion.test, motion.place, faults)
    g = own_errors(g, motion.t, faults, 0.0)
    return _stamped(g, motion, faults)


def by_joint(cell: Cell, motion: Motion, link: Link, trace: Trace) -> Array:
    """Derivatives (m, k, 6) mm/rad of the readings of a perfect arm by its joints."""
    plain = measure(cell, motion, [], link, trace=trace)
    turned = [measure(cell, motion, [], link, step, trace=trace) for step in _STEP_RAD * np.eye(6)]
    return np.stack([(g - plain) / _STEP_RAD for g in turned], axis=2)


def by_ball(motion: Motion, link: Link, tool: tuple[Posed, Array]) -> Array:
    """Derivatives (m, k, 3) of the readings by the position of the ball."""
    plain = read(motion, [], link, tool)
    shifted = [read(motion, [], replace(link, ball=link.ball + step), tool) for step in _STEP_MM * np.eye(3)]
    return np.stack([(g - plain) / _STEP_MM for g in shifted], axis=2)


def tool_of(
    cell: Cell, motion: Motion, faults: Sequence[Fault], trace: Trace, scatter: Array | None = None
) -> tuple[Posed, Array]:
    """Postures and the tool positions (n, 3) mm with faults, including growth and bending."""
    joints = np.zeros_like(motion.q) if scatter is None else np.tile(scatter, (len(motion.q), 1))
    for fault in faults:
        form = ON_JOINT.get(fault.effect) or OUT_JOINT.get(fault.effect)
        if form:
            joints[:, joint_of(fault)] += form(fault, trace)
    wrong = [fault for fault in faults if fault.effect == "link_geometry"]
    arm = arm_from(wrong_constants(cell.constants, wrong)) if wrong else cell.arm
    posed = pose(arm, motion.q + joints)
    p = posed.p
    for fault in faults:
        if fault.effect in ON_TOOL:
            p = p + ON_TOOL[fault.effect](fault, trace, posed, cell.constants.base[:3, 3])
    return posed, p


def _stamped(g: Array, motion: Motion, faults: list[Fault]) -> Array:
    """Readings at the timestamps of the rows. A late or fast clock stamps the time t - lag - ppm t with
    t.
    """
    stamp = motion.t[motion.rows]
    lag = sum(fault.size for fault in faults if fault.effect == "time_lag")
    ppm = sum(fault.size for fault in faults if fault.effect == "clock_rate")
    if not lag and not ppm:
        return g[motion.rows]
    true = stamp - lag - 1e-6 * ppm * (stamp - stamp[0])
    return np.stack([np.interp(true, motion.t, column) for column in g.T], axis=1)
