"""The effects that a diagnosis considers, each as small as a healthy arm shows it.

What it does to the readings is simulate(model + effect) - simulate(model) (`response`); nothing is written by hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.diagnose.blocks import Block
from analysis.model.predict import Model
from analysis.reading.tables import CircleTable, PoseTable
from rigs.effects import VOCABULARY, Effect, healthy_size, size_field

AXES = range(1, 7)
_ORDERS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 15, 18, 20, 24, 30, 36, 40, 50, 60, 72, 80, 90, 100, 120, 141, 160, 200)
"""Cycles a turn that gears are known to show; what lies between is found by refinement."""
_LOBES = (2, 3)


@dataclass(frozen=True)
class Candidate:
    """One name that can be given. effects: at their healthy size, one for each column (two where a phase is free);
    share: of a healthy arm's size that this name has among its likes (the orders of one gear)."""

    name: str
    effects: tuple[Effect, ...]
    share: float = 1.0

    @property
    def effect(self) -> Effect:
        """The first of its columns."""
        return self.effects[0]


def _healthy(name: str, **fields: Any) -> Effect:
    effect: Any = VOCABULARY[name].model_validate(fields)
    made: Effect = effect.model_copy(update={size_field(effect): healthy_size(effect)})
    return made


def candidates_for(model: Model, blocks: Sequence[Block]) -> list[Candidate]:
    """Every effect of the vocabulary that these runs could show."""
    axes = list(AXES)
    found = [Candidate(f"joint_offset {k}", (_healthy("joint_offset", axis=k),)) for k in axes]
    found += [
        Candidate(f"link_geometry {k}.{f}", (_healthy("link_geometry", axis=k, field=f),))
        for k in axes
        for f in ("a", "alpha", "d", "beta")
        # Hayati's angle is for a joint parallel to the one before; elsewhere it only repeats the others.
        if f != "beta" or (k > 1 and abs(np.sin(model.arm.alpha[k - 1])) < 1e-3)
    ]
    timed = any(isinstance(block.one.table, CircleTable) for block in blocks)
    found += [Candidate(f"backlash {k}", (_healthy("backlash", axis=k),)) for k in axes]
    found += [Candidate(f"compliance {k}", (_healthy("compliance", axis=k, payload_kg=5),)) for k in axes]
    found += [Candidate(f"link_bending {k}", (_healthy("link_bending", axis=k),)) for k in (1, 2, 3)]
    found += _gears(model, blocks)
    pairs = ((4, 5), (4, 6), (5, 6))
    found += [
        Candidate(f"wrist_coupling {a}.{b}", (_healthy("wrist_coupling", from_axis=a, to_axis=b),)) for a, b in pairs
    ]
    if timed:
        found += [Candidate(f"reversal_spike {k}", (_healthy("reversal_spike", axis=k),)) for k in axes]
        found += [Candidate(f"servo_lag {k}", (_healthy("servo_lag", axis=k),)) for k in axes]
        found += [Candidate("time_lag", (_healthy("time_lag"),)), Candidate("clock_rate", (_healthy("clock_rate"),))]
    if any(not isinstance(block.one.table, PoseTable) for block in blocks):
        found += _instruments(timed)
    return found


def _gears(model: Model, blocks: Sequence[Block]) -> list[Candidate]:
    made = []
    for axis in AXES:
        turned = max(float(np.ptp(block.one.table.q[:, axis - 1])) for block in blocks) / (2 * np.pi)
        # An order whose wave is shorter than what the readings resolve is not to be seen.
        orders = [n for n in _ORDERS if 0.1 < n * turned < 120] or [1]
        share = 1.0 / np.sqrt(len(orders))
        for order in orders:
            waves = tuple(_healthy("transmission_error", axis=axis, order=order, phase_deg=p) for p in (0, 90))
            made.append(Candidate(f"transmission_error {axis} order {order}", waves, share))
    return made


def _instruments(timed: bool) -> list[Candidate]:
    made = [
        Candidate("thermal_growth", (_healthy("thermal_growth"),)),
        Candidate("gauge_baseline", (_healthy("gauge_baseline"),)),
    ]
    for lobes in _LOBES:
        made.append(
            Candidate(f"ball_form {lobes}", tuple(_healthy("ball_form", lobes=lobes, phase_deg=p) for p in (0, 90)))
        )
    for gauge in ("g1", "g2"):
        for name in ("gauge_scale", "gauge_inclination", "gauge_dead_band", "gauge_drift"):
            made.append(Candidate(f"{name} {gauge}", (_healthy(name, gauge=gauge),)))
    return made if timed else made[:1]
