"""A real arm: every effect of the vocabulary at its healthy size, all at once; and faults of 5 to 100 times that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tests.worlds.stranger.draw import candidate, foreign
from tests.worlds.stranger.faults import SIGNED, SIZE, Fault
from tests.worlds.stranger.names import drawn_shape, everything
from tests.worlds.stranger.real.noise import log_uniform

TIMES = (5.0, 100.0)
TIMES_LARGE = (8.0, 100.0)
LARGEST = {"gauge_inclination": 25.0}
"""Degrees: beyond, a gauge is not mounted in its holder any more."""
OFF_GRID = ("backlash", "transmission_error", "compliance", "reversal_spike", "thermal_growth", "gauge_cyclic")
"""Effects whose shape can lie off any grid."""
WAVES = ("transmission_error", "ball_form", "gauge_cyclic", "vibration")
"""Of these a healthy arm may have others of the same name, with orders, lobes or periods of their own."""


def healthy_arm(level: float, rng: np.random.Generator) -> list[Fault]:
    """Every effect on everything it can sit on, zero-centred normal with `level` times its healthy size as width.

    One-sided sizes are the normal's magnitude. A joint's gear has two or three orders, the ball two or
    three lobes, which share their width.
    """
    found = []
    for effect, keys in everything():
        parts = int(rng.integers(2, 4)) if effect in ("transmission_error", "ball_form") else 1
        shapes = _apart(effect, parts, rng)
        for shape in shapes:
            fault = Fault(effect, keys, 0.0, shape, float(rng.uniform(0, 0.3)), float(rng.uniform(-1, 1)))
            found.append(fault.sized(float(_drawn(effect, rng) * level * fault.healthy / np.sqrt(parts))))
    return found


def _drawn(effect: str, rng: np.random.Generator) -> float:
    x = float(rng.standard_normal())
    return x if effect in SIGNED else abs(x)


def _apart(effect: str, parts: int, rng: np.random.Generator) -> list[dict[str, float]]:
    """Shapes whose orders or lobes differ."""
    found: dict[float, dict[str, float]] = {}
    while len(found) < parts:
        shape = drawn_shape(effect, rng)
        found.setdefault(shape.get("order", shape.get("lobes", 0.0)), shape)
    return list(found.values())


def plant(healthy: Sequence[Fault], fault: Fault) -> tuple[Fault, list[Fault]]:
    """The fault with the healthy share of its parameter in it, and the rest of the arm.

    Two waves of one order are one wave: no reading can part them. Of any other order they stay in the rest.
    """
    own = [other for other in healthy if other.name == fault.name and _without_phase(other) == _without_phase(fault)]
    rest = [other for other in healthy if other not in own]
    if fault.effect not in WAVES:
        return fault.sized(fault.size + sum(other.size for other in own)), rest
    if not own:
        return fault, rest
    whole = sum(one.size * np.exp(1j * np.radians(one.shape["phase_deg"])) for one in (fault, *own))
    shape = {**fault.shape, "phase_deg": float(np.degrees(np.angle(whole))) % 360}
    return replace(fault.sized(float(np.abs(whole))), shape=shape), rest


def _without_phase(fault: Fault) -> dict[str, float]:
    """The order, lobes, period or frequency of a wave; nothing of any other effect, which has one size."""
    return {key: x for key, x in fault.shape.items() if key != "phase_deg"} if fault.effect in WAVES else {}


def drawn_fault(rng: np.random.Generator, kind: str) -> Fault | None:
    """A fault by itself, of a size that its kind allows; None where no such cell exists. An effect is a kind too."""
    off_grid = kind == "off_grid"
    effects = OFF_GRID if off_grid else (kind,) if kind in SIZE else None
    fault = candidate(rng, effects, (0.3, 0.9) if off_grid else (0.0, 0.25))
    if off_grid:
        fault = replace(fault, shape=_off_grid(fault, rng))
    fault = fault.sized(fault.size * float(log_uniform(*(TIMES_LARGE if kind == "one_large" else TIMES), rng)))
    return fault if abs(fault.size) <= LARGEST.get(fault.effect, np.inf) else None


def _off_grid(fault: Fault, rng: np.random.Generator) -> dict[str, float]:
    """Orders of gears that no list has, decays, payloads and time constants of any length."""
    shape = dict(fault.shape)
    if "order" in shape:
        shape["order"] = float(np.round(log_uniform(1.0, 150.0, rng), 2))
    if "decay_s" in shape:
        shape["decay_s"] = float(log_uniform(0.05, 3.0, rng))
    if "payload_kg" in shape:
        shape["payload_kg"] = float(rng.uniform(0.5, 25.0))
    if "time_constant_s" in shape:
        shape["time_constant_s"] = float(log_uniform(15.0, 2000.0, rng))
    if "period_mm" in shape:
        shape["period_mm"] = float(log_uniform(0.08, 2.0, rng))
    return shape


def drawn_foreign(rng: np.random.Generator) -> Fault:
    """An effect of no vocabulary; that of two joints' angles has any order up to 60."""
    fault = foreign(rng)
    if fault.effect == "cross_term":
        fault = replace(fault, shape=dict(fault.shape) | {"order": float(np.round(log_uniform(2.0, 60.0, rng)))})
    return fault
