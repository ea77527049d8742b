"""Draw hidden effects that are visible in the tests, and the small effects of every healthy arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.worlds.stranger.faults import SIGNED, Fault
from tests.worlds.stranger.names import COUPLED, drawn_shape, everything
from tests.worlds.stranger.screws import Array
from tests.worlds.stranger.sight import LEAST_SNR, Frame, Scales

MOST_SNR = 60.0
OUTSIDE_SNR = 20.0
LARGEST = 25.0
"""Largest fault in healthy sizes."""
TWIN = 0.98
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
HAS_FORM = ("backlash", "transmission_error", "compliance", "reversal_spike", "thermal_growth", "ball_form",
            "gauge_dead_band", "gauge_cyclic", "gauge_drift", "servo_lag")  # fmt: skip
"""Effects that can occur with a form different from the vocabulary."""
VISIBLE_BY_SHAPE = ("transmission_error", "reversal_spike", "compliance", "thermal_growth", "gauge_cyclic", "ball_form",
             "vibration")  # fmt: skip
"""Effects whose shape determines their visibility."""
DENSE = 0.2
OUTSIDE = ("cross_term", "slip", "speed_error", "foreign_friction", "dent", "thermal_step", "rate_hysteresis")
_TRIES = 200


@dataclass(frozen=True)
class Hidden:
    """A hidden fault and its visibility in the runs.

    snr: signal-to-noise ratio against noise and background. snr_noise: the same against noise only. twins: names of
    effects that the tests cannot distinguish from it. rival, rival_sigma: the nearest other effect, and its distance in
    sigma with noise only.
    """

    fault: Fault
    snr: float
    snr_noise: float
    twins: tuple[str, ...] = ()
    rival: str = ""
    rival_sigma: float = np.inf


class NothingToHideError(Exception):
    """No random draw satisfied the requirements."""


def background(
    names: Sequence[str], share: Mapping[str, float], rng: np.random.Generator, dense: Frame | None = None
) -> list[Fault]:
    """A fault of each name with a random part, or all, of its share of the healthy size.

    dense: frame without background, to use the complete share. There a fault with a shape more visible than usual is
    limited to this share of its own limit.
    """
    found = []
    for effect, keys in everything():
        fault = Fault(
            effect, keys, 0.0, drawn_shape(effect, rng), float(rng.uniform(0, 0.5)), float(rng.uniform(-1, 1))
        )
        part = 1.0 if dense else rng.uniform(0, 1)
        sign = rng.choice([-1.0, 1.0]) if effect in SIGNED else 1.0
        if fault.name in names:
            made = fault.sized(float(sign * part * share[fault.name] * fault.healthy))
            if dense and effect in VISIBLE_BY_SHAPE:
                sigma = float(np.linalg.norm(dense.of([made])))
                made = made.sized(made.size * min(1.0, DENSE * LEAST_SNR / max(sigma, 1e-9)))
            found.append(made)
    return found


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


def hide(
    scales: Scales,
    share: Mapping[str, float],
    count: int,
    rng: np.random.Generator,
    effects: Sequence[str] | None = None,
    rough: tuple[float, float] = (0.0, 0.25),
    sizes: tuple[float, float] | None = None,
) -> list[Hidden]:
    """Return faults that are each visible even if the others are known: SNR 7 … 60, or with `sizes` in healthy sizes
    and SNR > 7.
    """
    quiet = scales.frame({})
    for _ in range(_TRIES):
        drawn = [candidate(rng, effects, rough) for _ in range(count)]
        if len({fault.name for fault in drawn}) < count:
            continue
        if any(np.linalg.norm(quiet.of([fault])) * LARGEST < LEAST_SNR for fault in drawn):
            continue
        frame = scales.frame(share, [fault.name for fault in drawn])
        grown = [_grown(frame, fault, rng, sizes) for fault in drawn]
        if all(grown) and _apart(frame, [fault for fault in grown if fault]):
            return [_looked_at(frame, quiet, fault) for fault in grown if fault]
    raise NothingToHideError(f"{count} hidden effects: none of {_TRIES} draws can be seen")


def _grown(frame: Frame, fault: Fault, rng: np.random.Generator, sizes: tuple[float, float] | None) -> Fault | None:
    """Fault with a size drawn by its SNR; None if it is out of range."""
    unit = abs(fault.size)
    if sizes:
        fault = fault.sized(fault.size * float(np.exp(rng.uniform(*np.log(sizes)))))
        return fault if np.linalg.norm(frame.of([fault])) >= LEAST_SNR else None
    wanted = float(np.exp(rng.uniform(np.log(1.1 * LEAST_SNR), np.log(0.95 * MOST_SNR))))
    for _ in range(4):
        fault = fault.sized(fault.size * wanted / max(float(np.linalg.norm(frame.of([fault]))), 1e-9))
        if abs(fault.size) > LARGEST * unit:
            return None
    return fault if LEAST_SNR <= np.linalg.norm(frame.of([fault])) <= MOST_SNR else None


def _apart(frame: Frame, faults: list[Fault]) -> bool:
    """True if each fault has SNR 7 even if the sizes of the others are free."""
    rows = np.array([frame.of([fault]) for fault in faults])
    if len(rows) == 1:
        return True
    alone = 1 / np.sqrt(np.diag(np.linalg.pinv(rows @ rows.T)))
    return bool(alone.min() >= LEAST_SNR)


def _looked_at(frame: Frame, quiet: Frame, fault: Fault) -> Hidden:
    """Fault with its SNR and the names similar to it."""
    x = quiet.of([fault])
    size, alike = float(np.linalg.norm(x)), quiet.likeness(x)
    away = {name: size * np.sqrt(max(0.0, 1 - c**2)) for name, c in alike.items() if name != fault.name}
    twins = tuple(name for name, sigma in away.items() if alike[name] > TWIN or sigma < 1.0)
    rival = min((name for name in away if name not in twins), key=lambda name: away[name])
    return Hidden(fault, float(np.linalg.norm(frame.of([fault]))), size, twins, rival, float(away[rival]))


@dataclass(frozen=True)
class Foreign:
    """An effect outside the vocabulary: its SNR, the part that no single name explains, and the nearest name."""

    fault: Fault
    snr: float
    snr_unexplained: float
    nearest: str


def hide_foreign(scales: Scales, share: Mapping[str, float], rng: np.random.Generator) -> Foreign:
    """An effect that no name of the vocabulary explains; the unexplained part has SNR 20 … 60."""
    frame, quiet = scales.frame(share), scales.frame({})
    for _ in range(_TRIES):
        fault, wanted = foreign(rng), float(np.exp(rng.uniform(np.log(OUTSIDE_SNR), np.log(MOST_SNR))))
        for _ in range(3):
            x = frame.of([fault])
            left = _left(x, frame)
            if left < 1e-6:
                break
            fault = fault.sized(fault.size * wanted / left)
        x = frame.of([fault])
        alike = quiet.likeness(quiet.of([fault]))
        nearest = max(alike, key=lambda name: alike[name])
        if alike[nearest] < 0.95 and _left(x, frame) >= OUTSIDE_SNR and fault.size < 0.3:
            return Foreign(fault, float(np.linalg.norm(x)), _left(x, frame), nearest)
    raise NothingToHideError("no foreign effect can be seen")


def _left(x: Array, frame: Frame) -> float:
    return float(np.linalg.norm(x)) * np.sqrt(max(0.0, 1 - max(frame.likeness(x).values()) ** 2))


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
