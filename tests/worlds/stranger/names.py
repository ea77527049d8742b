"""Every effect of the vocabulary at every possible seat, at its healthy size: the background and the candidates for
hiding.
"""

from __future__ import annotations

import numpy as np

from tests.worlds.stranger.faults import Fault, Key, healthy_of

GEAR_ORDERS = (1.0, 2.0, 4.0, 8.0, 16.0, 36.0, 60.0, 100.0)
PHASES_DEG = (0.0, 90.0)
COUPLED = ((4, 5), (5, 6), (4, 6))
GAUGES = ("g1", "g2")
AXES = range(1, 7)
ON_AXES = ("joint_offset", "backlash", "reversal_spike", "servo_lag", "compliance", "link_bending")
ON_GAUGES = ("gauge_scale", "gauge_inclination", "gauge_dead_band", "gauge_drift", "gauge_cyclic")
SINGLE_EFFECTS = ("gauge_baseline", "thermal_growth", "time_lag", "clock_rate", "ball_form", "vibration")


def everything() -> list[tuple[str, dict[str, Key]]]:
    """Return effect and keys of every name."""
    found: list[tuple[str, dict[str, Key]]] = [(effect, {"axis": axis}) for effect in ON_AXES for axis in AXES]
    found += [("transmission_error", {"axis": axis}) for axis in AXES]
    found += [("link_geometry", {"axis": axis, "field": field}) for axis in AXES for field in ("a", "alpha", "d")]
    found += [("link_geometry", {"axis": 3, "field": "beta"})]
    found += [("wrist_coupling", {"from_axis": before, "to_axis": after}) for before, after in COUPLED]
    found += [(effect, {"gauge": gauge}) for effect in ON_GAUGES for gauge in GAUGES]
    return found + [(effect, {}) for effect in SINGLE_EFFECTS]


def looks(effect: str, keys: dict[str, Key]) -> list[Fault]:
    """Return shapes that span the possible appearances of a name, with ideal forms."""
    size = healthy_of(effect, keys)
    match effect:
        case "transmission_error":
            shapes = [{"order": order, "phase_deg": phase} for order in GEAR_ORDERS for phase in PHASES_DEG]
        case "reversal_spike":
            shapes = [{"decay_s": decay} for decay in (0.1, 0.3, 1.0)]
        case "compliance":
            shapes = [{"payload_kg": 0.0}, {"payload_kg": 15.0}]
        case "thermal_growth":
            shapes = [{"time_constant_s": tau} for tau in (60.0, 600.0)]
        case "ball_form":
            shapes = [{"lobes": lobes, "phase_deg": phase} for lobes in (2, 3, 4, 5, 6) for phase in PHASES_DEG]
        case "gauge_cyclic":
            shapes = [{"period_mm": period, "phase_deg": p} for period in (0.2, 0.5, 1.0) for p in PHASES_DEG]
        case "vibration":
            shapes = [{"frequency_hz": f, "phase_deg": phase} for f in (7.0, 13.0) for phase in PHASES_DEG]
        case _:
            shapes = [{}]
    return [Fault(effect, keys, size, shape) for shape in shapes]


def drawn_shape(effect: str, rng: np.random.Generator) -> dict[str, float]:
    phase = float(np.round(rng.uniform(0, 360), 1))
    match effect:
        case "transmission_error":
            orders = (1, 2, 3, 4, 6, 8, 12, 16, 20, 30, 40, 60, 80, 100, 121, 160)
            return {"order": float(rng.choice(orders)), "phase_deg": phase}
        case "reversal_spike":
            return {"decay_s": float(np.exp(rng.uniform(np.log(0.1), np.log(1.0))))}
        case "compliance":
            return {"payload_kg": float(rng.uniform(1, 15))}
        case "thermal_growth":
            return {"time_constant_s": float(np.exp(rng.uniform(np.log(30), np.log(600))))}
        case "ball_form":
            return {"lobes": float(rng.integers(2, 7)), "phase_deg": phase}
        case "gauge_cyclic":
            return {"period_mm": float(rng.choice([0.2, 0.5, 1.0])), "phase_deg": phase}
        case "vibration":
            return {"frequency_hz": float(rng.uniform(5, 18)), "phase_deg": phase}
        case "backlash":
            return {"preload": float(rng.choice([0.0, 0.0, rng.uniform(0, 0.3)]))}
    return {}
