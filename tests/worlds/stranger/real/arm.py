"""A realistic arm: every effect of the vocabulary at its healthy size together, and faults of 5 to 100 times that
size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tests.worlds.stranger.faults import SIGNED, SIZE, Fault
from tests.worlds.stranger.names import COUPLED, drawn_shape, everything
from tests.worlds.stranger.real.noise import log_uniform

TIMES = (5.0, 100.0)
TIMES_LARGE = (8.0, 100.0)
LARGEST = {"gauge_inclination": 25.0}
"""Upper limits; a gauge tilted by more degrees would not fit in its holder."""
OFF_GRID = ("backlash", "transmission_error", "compliance", "reversal_spike", "thermal_growth", "gauge_cyclic")
"""Effects with a continuous shape parameter."""
WAVES = ("transmission_error", "ball_form", "gauge_cyclic", "vibration")
"""Effects of which a healthy arm may have several waves with different orders, lobes or periods."""
WEIGHTS = {
    "backlash": 3.0,
    "transmission_error": 3.0,
    "reversal_spike": 2.0,
    "compliance": 2.0,
    "joint_offset": 2.0,
    "link_geometry": 2.0,
    "clock_rate": 0.5,
    "vibration": 0.5,
}
"""Relative frequency of effects, 1 by default. Joint effects are more frequent because they are the purpose of rig."""
OUTSIDE = ("cross_term", "slip", "speed_error", "foreign_friction", "dent", "thermal_step", "rate_hysteresis")


def healthy_arm(level: float, rng: np.random.Generator) -> list[Fault]:
    """Every effect at every seat, with a zero-mean normal size of standard deviation `level` times the healthy
    size.

    One-sided sizes are the absolute value. A joint gear has two or three orders and the ball two or three lobes, which
    share the variance.
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
    """Return shapes with different orders or lobes."""
    found: dict[float, dict[str, float]] = {}
    while len(found) < parts:
        shape = drawn_shape(effect, rng)
        found.setdefault(shape.get("order", shape.get("lobes", 0.0)), shape)
    return list(found.values())


def plant(healthy: Sequence[Fault], fault: Fault) -> tuple[Fault, list[Fault]]:
    """Fault combined with the healthy size of the same parameter, and the other effects of the arm.

    Two waves of the same order are indistinguishable and combined. Waves of other orders stay among the other effects.
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
    """Return order, lobes, period or frequency of a wave; empty for other effects."""
    return {key: x for key, x in fault.shape.items() if key != "phase_deg"} if fault.effect in WAVES else {}


def candidate(rng: np.random.Generator, effects: Sequence[str] | None, rough: tuple[float, float]) -> Fault:
    """A fault of healthy size at a random seat."""
    every = everything()
    known = list(dict.fromkeys(effect for effect, _ in every)) if effects is None else list(effects)
    weights = np.array([WEIGHTS.get(effect, 1.0) for effect in known])
    effect = str(rng.choice(known, p=weights / weights.sum()))
    seats = [keys for other, keys in every if other == effect]
    keys = seats[rng.integers(len(seats))]
    sign = float(rng.choice([-1.0, 1.0])) if effect in SIGNED else 1.0
    fault = Fault(effect, keys, 1.0, drawn_shape(effect, rng), float(rng.uniform(*rough)), float(rng.uniform(-1, 1)))
    return fault.sized(sign * fault.healthy)


def drawn_fault(rng: np.random.Generator, kind: str) -> Fault | None:
    """A random fault with a size according to its kind; None if there is no such cell. An effect name is also
    a kind.
    """
    off_grid = kind == "off_grid"
    effects = OFF_GRID if off_grid else (kind,) if kind in SIZE else None
    fault = candidate(rng, effects, (0.3, 0.9) if off_grid else (0.0, 0.25))
    if off_grid:
        fault = replace(fault, shape=_off_grid(fault, rng))
    fault = fault.sized(fault.size * float(log_uniform(*(TIMES_LARGE if kind == "one_large" else TIMES), rng)))
    return fault if abs(fault.size) <= LARGEST.get(fault.effect, np.inf) else None


_OFF_GRID = {"order": (1.0, 150.0), "decay_s": (0.05, 3.0), "time_constant_s": (15.0, 2000.0), "period_mm": (0.08, 2.0)}


def _off_grid(fault: Fault, rng: np.random.Generator) -> dict[str, float]:
    """Return continuous random shape parameters: gear orders, decay times, payloads and time constants."""
    shape = dict(fault.shape)
    for key in shape.keys() & _OFF_GRID.keys():  # an effect has one of them
        shape[key] = float(log_uniform(*_OFF_GRID[key], rng))
    if "order" in shape:
        shape["order"] = round(shape["order"], 2)
    if "payload_kg" in shape:
        shape["payload_kg"] = float(rng.uniform(0.5, 25.0))
    return shape


def foreign(rng: np.random.Generator) -> Fault:
    """A random effect of outside.py of size 0.005° or 0.005 mm."""
    effect = str(rng.choice(OUTSIDE))
    axis, other = (int(k) for k in rng.permutation(np.arange(1, 6))[:2])
    phase = float(rng.uniform(0, 360))
    fault = Fault(effect, {"axis": axis}, 0.005)
    match effect:
        case "cross_term":
            before, after = COUPLED[0] if rng.uniform() < 0.3 else (axis, other)
            shape = {"order": float(rng.integers(3, 25)), "phase_deg": phase}
            return replace(fault, keys={"axis": before, "other": after}, shape=shape)
        case "slip":
            return replace(fault, shape={"share": float(rng.uniform(0.25, 0.75))})
        case "foreign_friction":
            return replace(fault, keys={"axis": axis, "other": other})
        case "dent":
            return replace(fault, keys={}, shape={"at_deg": phase, "wide_deg": float(rng.uniform(4, 15))})
        case "thermal_step":
            return replace(fault, keys={}, shape={"share": float(rng.uniform(0.3, 0.7))})
        case "rate_hysteresis":
            return replace(fault, keys={"gauge": str(rng.choice(["g1", "g2"]))})
    return fault


def drawn_foreign(rng: np.random.Generator) -> Fault:
    """An effect outside the vocabulary; one that depends on two joint angles has any order up to 60."""
    fault = foreign(rng)
    if fault.effect == "cross_term":
        fault = replace(fault, shape=dict(fault.shape) | {"order": float(np.round(log_uniform(2.0, 60.0, rng)))})
    return fault
