"""How nature departs from the page: what stands beside a named effect because no gear, ball or brake is ideal.

These are not named; they are allowed for, in proportion to the effect, when it is fitted and when what is left is
judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from analysis.diagnose.linear import Linear
from analysis.diagnose.observed import ORDER_OF
from analysis.kinematics.arm import Array
from analysis.model.hysteresis import turns
from rigs.effects import Effect, JointOffset, size_field

_HARMONIC = 0.15
_LOBE = 0.25
_MOST_LOBES = 30
_JOLT = 0.4


def form_columns(linear: Linear, effects: Sequence[Effect]) -> Array:
    """What departures from the page may add, one standard deviation each: (N, f) in standard deviations."""
    forms = [form for effect in effects for form in _forms(effect)]
    begins = [_begins(linear, effect) for effect in effects if effect.effect == "backlash"]
    jolts = [_jolts(linear, effect) for effect in effects if effect.effect in ("reversal_spike", "backlash")]
    sticks = [_sticks(linear, effect) for effect in effects if effect.effect == "gauge_dead_band"]
    return np.concatenate([linear.columns(forms), *begins, *jolts, *sticks], axis=1)


def _forms(effect: Effect) -> list[Effect]:
    of: Any = effect
    match effect.effect:
        case "transmission_error":
            return [
                _share(of, _HARMONIC, order=n * of.order, phase_deg=phase, third=0.0)
                for n in (2, 3)
                for phase in (0, 90)
            ]
        case "gauge_cyclic":
            return [_share(of, _HARMONIC, period_mm=of.period_mm / 2, phase_deg=phase) for phase in (0, 90)]
        case "ball_form":
            near = {of.lobes - 1, of.lobes + 1} & set(range(2, _MOST_LOBES + 1))
            return [_share(of, _LOBE, lobes=lobes, phase_deg=phase) for lobes in sorted(near) for phase in (0, 90)]
    return []


def _share(effect: Any, share: float, **fields: Any) -> Effect:
    size = size_field(effect)
    made: Effect = effect.model_copy(update={size: share * getattr(effect, size), **fields})
    return made


def _begins(linear: Linear, effect: Any) -> Array:
    """Where in its play a joint stood before each run began nobody knows: (N, b), a column a circle."""
    turned = linear.columns([JointOffset(axis=effect.axis, offset_deg=min(effect.width_deg / 2, 5.0))])[:, 0]
    columns, begin = [], 0
    for block in linear.blocks:
        if block.sampling and block.sampling.stands:
            first = slice(begin + len(ORDER_OF), begin + len(ORDER_OF) + 2)
            column = np.zeros(len(turned))
            column[first] = turned[first]
            columns.append(column)
        begin += len(block.y_mm)
    return np.stack(columns, axis=1) if columns else np.empty((len(turned), 0))


def _jolts(linear: Linear, effect: Any) -> Array:
    """When a joint turned back is known to a sample or so, and differs by that between repeats: (N, j), columns for the
    samples about each of its turns, where a spike may begin sooner or later, or a play be crossed in its own way."""
    columns = []
    size = abs(effect.amplitude_deg) if effect.effect == "reversal_spike" else effect.width_deg / 2
    for k, block in enumerate(linear.blocks):
        if not block.sampling:
            continue
        path = block.one.path
        for when, _ in turns(path.t_s, path.q[:, effect.axis - 1]):
            after = int(np.searchsorted(path.t_s, when))
            columns += [
                linear.jolt(k, effect.axis, sample, min(_JOLT * size, 1.0))
                for sample in (after - 1, after)
                if 0 <= sample < len(path.t_s)
            ]
    return np.stack(columns, axis=1) if columns else np.empty((len(linear.y), 0))


def _sticks(linear: Linear, effect: Any) -> Array:
    """How a plunger that sticks came to a target nobody recorded: (N, t), a column for each target."""
    columns, begin = [], 0
    for block in linear.blocks:
        if not block.sampling and effect.gauge == "g1":
            for row in range(len(block.y_mm)):
                column = np.zeros(len(linear.y))
                column[begin + row] = effect.width_mm / 2 / block.sd_mm[row]
                columns.append(column)
        begin += len(block.y_mm)
    return np.stack(columns, axis=1) if columns else np.empty((len(linear.y), 0))
