"""Scatter between runs and noise of readings, in mm, s and degrees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.worlds.stranger.screws import Array


@dataclass(frozen=True)
class Noise:
    """Noise of a cell. white: of a reading, mm; wander, wander_s: an Ornstein-Uhlenbeck process, nine tenths common
    to all gauges; joints_deg, ball_mm: scatter between runs; encoder_deg: encoder step; rate_hz of the readings,
    uneven by a share.
    """

    white: float
    wander: float = 0.001
    wander_s: float = 0.5
    joints_deg: float = 0.0002
    ball_mm: float = 0.001
    encoder_deg: float = 1e-4
    rate_hz: float = 50.0
    uneven: float = 0.1


def drawn_noise(rng: np.random.Generator) -> Noise:
    return Noise(
        white=float(rng.uniform(0.0005, 0.002)),
        wander_s=float(rng.uniform(0.3, 1.0)),
        encoder_deg=float(np.exp(rng.uniform(np.log(2e-5), np.log(3e-4)))),
        rate_hz=float(rng.uniform(42, 58)),
        uneven=float(rng.uniform(0.02, 0.25)),
    )


def stamps(noise: Noise, seconds: float, rng: np.random.Generator) -> Array:
    """Return reading times (m,) s from zero, at least 0.1 ms apart."""
    steps = 1 + noise.uneven * rng.standard_normal(int(seconds * noise.rate_hz * 1.3))
    times = np.cumsum(np.clip(steps, 0.3, 3.0)) / noise.rate_hz
    return np.round(times[times < seconds] - times[0], 4)


def added(noise: Noise, t: Array, gauges: int, rng: np.random.Generator) -> Array:
    """Noise (m, gauges) mm of readings at t (m,)."""
    kept = np.exp(-np.diff(t, prepend=-1e9) / noise.wander_s)
    kicks = noise.wander * np.sqrt(1 - kept**2)[:, None] * rng.standard_normal((len(t), gauges + 1))
    level, walks = np.zeros(gauges + 1), np.empty((len(t), gauges + 1))
    for k in range(len(t)):
        level = kept[k] * level + kicks[k]
        walks[k] = level
    wander = np.sqrt(0.9) * walks[:, :1] + np.sqrt(0.1) * walks[:, 1:]
    return wander + noise.white * rng.standard_normal((len(t), gauges))
