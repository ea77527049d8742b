"""The names that a diagnosis can give, each with the columns that it may show in the readings.

What an effect does to the readings is simulate(model + effect) - simulate(model) (`linear`); nothing is written by
hand. A column is such a response at a healthy size. Beside its main columns (two where a phase is free) a name has
columns for its shape: how a real play, gear or spike differs from the page.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.diagnose.blocks import Block
from analysis.diagnose.linear import Linear
from analysis.reading.tables import CircleTable, PoseTable
from rigs.effects import VOCABULARY, Effect, healthy_size, size_field

AXES = range(1, 7)
_MOST_ORDER = 200
_LOBES = (2, 3, 4, 5, 6)
_DECAYS_S = (0.1, 0.3, 1.0)
_WARMING_S = (60.0, 300.0, 1200.0)
_PERIODS_MM = (0.2, 0.5, 1.0, 2.0)
_SMALL = 0.02
_PLAY_SHAPES = ("transit", "preload")
_PLAY_SIGMAS = (15.0, 60.0, 250.0)
_WIDE_PLAY = 5.0
"""Widths of plays: at which they have so many sigmas, and so many healthy widths."""


@dataclass(frozen=True)
class Shape:
    """A column of a name's shape: the response to `more` less that to `less`; share: how much of it, beside a main
    column at 1, is plausible."""

    more: Effect
    less: Effect | None
    share: float


@dataclass(frozen=True)
class Candidate:
    """One name in one variant. effects: one for each main column, at `size` of their healthy size (a play is not twice
    itself); share: of a healthy arm's size that this variant has among its likes (the orders of one gear)."""

    name: str
    effects: tuple[Effect, ...]
    shapes: tuple[Shape, ...] = ()
    share: float = 1.0
    size: float = 1.0

    @property
    def effect(self) -> Effect:
        """The first of its columns."""
        return self.effects[0]


def name_of(effect: Effect) -> str:
    """`backlash 1`, `link_geometry 5.a`, `wrist_coupling 4>5`, `gauge_scale g1`, `time_lag`: what an answer names."""
    of: Any = effect
    match effect.effect:
        case "link_geometry":
            return f"{effect.effect} {of.axis}.{of.field}"
        case "wrist_coupling":
            return f"{effect.effect} {of.from_axis}>{of.to_axis}"
    seat = getattr(effect, "axis", getattr(effect, "gauge", None))
    return effect.effect if seat is None else f"{effect.effect} {seat}"


def craig(axis: int, field: str) -> str:
    """Craig's symbol for a constant of an axis in the rig file: a, alpha and beta belong to the link before."""
    return f"{field}{axis if field == 'd' else axis - 1}"


def label_of(effect: Effect) -> str:
    """The name of an effect; gears by order, which are many of one name."""
    order = getattr(effect, "order", None)
    return name_of(effect) if order is None else f"{name_of(effect)} order {order:g}"


def candidates_for(linear: Linear) -> list[Candidate]:
    """Every effect of the vocabulary that the runs of a linearisation could show."""
    blocks = linear.blocks
    arm = blocks[0].model.arm
    tables = [block.one.table for block in blocks]
    timed = any(isinstance(table, CircleTable) for table in tables)
    gauged = any(not isinstance(table, PoseTable) for table in tables)
    found = [_single("joint_offset", axis=k) for k in AXES]
    found += [
        _small("link_geometry", axis=k, field=f)
        for k in AXES
        for f in ("a", "alpha", "d", "beta")
        # Hayati's angle is for a joint parallel to the one before; elsewhere it only repeats the others.
        if f != "beta" or (k > 1 and abs(np.sin(arm.alpha[k - 1])) < 1e-3)
    ]
    found += [_softness(k) for k in AXES]
    found += [_single("link_bending", axis=k) for k in AXES]
    found += _gears(blocks)
    found += [_single("wrist_coupling", from_axis=a, to_axis=b) for a, b in ((4, 5), (4, 6), (5, 6))]
    if timed:
        found += [
            _variant("reversal_spike", len(_DECAYS_S), axis=k, decay_s=decay) for k in AXES for decay in _DECAYS_S
        ]
        found += [_single("servo_lag", axis=k) for k in AXES]
        found += [_single("time_lag"), _single("clock_rate")]
    if gauged:
        found += _instruments(timed)
    plays: list[tuple[Effect, tuple[str, ...]]] = [(_healthy("backlash", axis=k), _PLAY_SHAPES) for k in AXES]
    plays += [(_healthy("gauge_dead_band", gauge=g), ()) for g in _gauges(timed)] * gauged
    sigma = np.linalg.norm(linear.columns([play for play, _ in plays]), axis=0)
    return found + [one for (play, shapes), s in zip(plays, sigma, strict=True) for one in _plays(play, shapes, s)]


def _healthy(name: str, **fields: Any) -> Effect:
    effect: Any = VOCABULARY[name].model_validate(fields)
    made: Effect = effect.model_copy(update={size_field(effect): healthy_size(effect)})
    return made


def _single(name: str, **fields: Any) -> Candidate:
    effect = _healthy(name, **fields)
    return Candidate(name_of(effect), (effect,))


def _small(name: str, **fields: Any) -> Candidate:
    """At a fiftieth of a healthy size: at all of it what is not straight would already show."""
    effect: Any = _healthy(name, **fields)
    field = size_field(effect)
    return Candidate(
        name_of(effect), (effect.model_copy(update={field: _SMALL * getattr(effect, field)}),), (), 1.0, _SMALL
    )


def _variant(name: str, among: int, **fields: Any) -> Candidate:
    effect = _healthy(name, **fields)
    return Candidate(name_of(effect), (effect,), (), 1 / np.sqrt(among))


def _plays(effect: Any, shapes: Sequence[str], sigma: float) -> list[Candidate]:
    """A play in several widths, for how it is crossed depends on them."""
    field = size_field(effect)
    widths = sorted({min(1.0, size / max(sigma, 1e-9)) for size in _PLAY_SIGMAS} | {_WIDE_PLAY})
    made = []
    for width in widths:
        sharp = effect.model_copy(update={field: width * getattr(effect, field)})
        shaped = [
            Shape(sharp.model_copy(update={shape: 1.0}), sharp, share)
            for shape, share in zip(shapes, (0.5, 0.2), strict=False)
        ]
        made.append(Candidate(name_of(effect), (sharp,), tuple(shaped), 1 / np.sqrt(len(widths)), width))
    return made


def _softness(axis: int) -> Candidate:
    """The payload's share of the torque is free: nobody knows what hung there."""
    bare, loaded = (_healthy("compliance", axis=axis, payload_kg=kg) for kg in (5.0, 15.0))
    return Candidate(name_of(bare), (bare,), (Shape(loaded, bare, 0.7),))


def _waves(effect: str, **fields: Any) -> tuple[Effect, ...]:
    return tuple(_healthy(effect, phase_deg=phase, **fields) for phase in (0, 90))


def _gears(blocks: Sequence[Block]) -> list[Candidate]:
    """Waves of each joint, by order: as dense as the readings part them."""
    made = []
    for axis in AXES:
        turned = max(float(np.ptp(block.one.table.q[:, axis - 1])) for block in _swept(blocks)) / (2 * np.pi)
        orders = _orders_for(turned)
        for order in orders:
            waves = _waves("transmission_error", axis=axis, order=order)
            made.append(Candidate(name_of(waves[0]), waves, (), 1 / np.sqrt(2 * len(orders))))
    return made


def _swept(blocks: Sequence[Block]) -> list[Block]:
    """Where joints turn while they are read, if anywhere: circles."""
    return [block for block in blocks if isinstance(block.one.table, CircleTable)] or list(blocks)


def _orders_for(turned: float) -> list[int]:
    """Integers up to 12, then in steps that a joint which turns so far (in turns) parts; refinement finds the rest."""
    orders, order = [], 1.0
    while order <= _MOST_ORDER:
        # A wave shorter than what the readings resolve is not to be seen.
        if order * turned < 120:
            orders.append(round(order))
        order += 1.0 if order < 12 else max(1.0, min(0.5 / max(turned, 1e-3), 0.2 * order))
    return orders


def _gauges(timed: bool) -> tuple[str, ...]:
    """A circle has two gauges, a target one."""
    return ("g1", "g2") if timed else ("g1",)


def _instruments(timed: bool) -> list[Candidate]:
    made = [_variant("thermal_growth", len(_WARMING_S), time_constant_s=tau) for tau in _WARMING_S]
    for lobes in _LOBES:
        waves = _waves("ball_form", lobes=lobes)
        made.append(Candidate(name_of(waves[0]), waves, (), 1 / np.sqrt(2 * len(_LOBES))))
    made += [_single("gauge_baseline")] * timed
    for gauge in _gauges(timed):
        names = ("gauge_scale", "gauge_inclination", "gauge_drift")
        made += [_single(name, gauge=gauge) for name in names]
        for period in _PERIODS_MM:
            waves = _waves("gauge_cyclic", gauge=gauge, period_mm=period)
            made.append(Candidate(name_of(waves[0]), waves, (), 1 / np.sqrt(2 * len(_PERIODS_MM))))
    return made
