"""Noise of a realistic cell (table of real-cells.md), drawn for a cell, each set-up and each run; mm, s, degrees.

The ranges of the table are sampled log-uniformly unless stated otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.worlds.stranger.screws import Array

RESOLUTIONS_MM = (1e-4, 5e-4, 1e-3, 5e-3, 1e-2)
ORDERS = 3
"""Number of orders of the smooth variation along a lap between runs. Half of its energy is constant."""
SLOW_STEP_S = 0.01
"""Time step of slow noise, a tenth of the shortest time constant, with linear interpolation."""
OWN_LEVELS = 4.0
"""Largest ratio between the noise levels of gauges and runs."""


@dataclass(frozen=True)
class Levels:
    """Noise levels of a set-up. white_mm: by run and gauge (runs, gauges); slow_mm: by run (runs,); the rest for all
    its runs.

    slow_s: time constant of an AR(1) process, 0 for a 1/f spectrum; common: share of its energy common to all gauges;
    joints_deg, ball_mm: scatter between runs; drift_mm_min (3,): of the ball; stops_mm: rms distance of stops from the
    place of the target, by target number.
    """

    white_mm: Array
    slow_mm: Array
    slow_s: float
    common: float
    joints_deg: float
    ball_mm: float
    drift_mm_min: Array
    stops_mm: Mapping[int, float]


@dataclass(frozen=True)
class CellNoise:
    """Noise properties of a cell. tail_df: degrees of freedom of the t distribution of stops, 0 for normal;
    outliers: share of readings; bursts: outliers in groups of 3 to 10 rows; uneven: relative variation of the
    reading interval; jitter_s: of a timestamp; encoder_deg: step of the angles.
    """

    rate_hz: float
    resolution_mm: float
    tail_df: float
    outliers: float
    bursts: bool
    uneven: float
    jitter_s: float
    encoder_deg: float


def log_uniform(low: float, high: float, rng: np.random.Generator, size: int | None = None) -> Any:
    return np.exp(rng.uniform(np.log(low), np.log(high), size))


def drawn_cell(rng: np.random.Generator, kind: str, rate_hz: float) -> CellNoise:
    """Return random noise properties of a cell; `heavy_tails` and `dirty` are the worst cases.

    The jitter of timestamps, 0.1 to 20 ms, is at most a fifth of the reading interval, so they stay in order.
    """
    worst = kind == "dirty"
    tail = 2.2 if kind == "heavy_tails" else float(rng.choice([0.0, 0.0, rng.uniform(2.5, 6.0)]))
    jitter = 0.02 if worst else log_uniform(1e-4, 0.02, rng)
    return CellNoise(
        rate_hz=rate_hz,
        resolution_mm=float(rng.choice(RESOLUTIONS_MM)),
        tail_df=tail,
        outliers=0.005 if worst else float(rng.uniform(0, 0.005) * (rng.uniform() < 0.5)),
        bursts=bool(rng.uniform() < 0.5),
        uneven=0.4 if worst else float(rng.uniform(0.0, 0.3)),
        jitter_s=float(min(jitter, 0.2 / rate_hz)),
        encoder_deg=float(log_uniform(2e-5, 1e-3, rng)),
    )


def drawn_levels(rng: np.random.Generator, runs: int, gauges: int, targets: list[int]) -> Levels:
    """Return random noise levels of a set-up with this number of runs."""
    apart = log_uniform(1.0, OWN_LEVELS, rng)
    way = rng.standard_normal(3)
    stops = log_uniform(0.003, 0.060, rng)
    return Levels(
        white_mm=log_uniform(2e-4, 3e-3 / apart, rng) * apart ** rng.uniform(0, 1, (runs, gauges)),
        slow_mm=log_uniform(5e-4, 2e-2 / apart, rng) * apart ** rng.uniform(0, 1, runs),
        slow_s=float(rng.choice([0.0, log_uniform(0.1, 5.0, rng)])),
        common=float(rng.uniform(0.5, 0.95)),
        joints_deg=float(log_uniform(3e-4, 5e-3, rng)),
        ball_mm=float(log_uniform(1e-3, 2e-2, rng)),
        drift_mm_min=rng.uniform(0, 2e-3) * way / np.linalg.norm(way),
        stops_mm={number: float(np.clip(stops * log_uniform(0.5, 2.0, rng), 0.003, 0.060)) for number in targets},
    )


def stamps(noise: CellNoise, seconds: float, rng: np.random.Generator) -> Array:
    """Return reading times (m,) s from zero."""
    steps = 1 + noise.uneven * rng.standard_normal(int(1.3 * seconds * noise.rate_hz) + 10)
    times = np.cumsum(np.clip(steps, 0.4, 3.0)) / noise.rate_hz
    return times[times < seconds] - times[0]


def slow(seconds: float, tau_s: float, columns: int, rng: np.random.Generator) -> Array:
    """Return (n, columns) of unit variance in steps SLOW_STEP_S: AR(1) with a time constant, or 1/f above 0.05 Hz if
    it is zero.
    """
    n = 2 * int(np.ceil(seconds / SLOW_STEP_S) + 2)
    f = np.fft.rfftfreq(n, SLOW_STEP_S)
    power = 1 / (1 + (2 * np.pi * f * tau_s) ** 2) if tau_s else 1 / np.maximum(f, 0.05)
    power[0] *= bool(tau_s)
    draws = rng.standard_normal((2, len(f), columns)) / np.sqrt(2)
    made = np.fft.irfft((draws[0] + 1j * draws[1]) * np.sqrt(power)[:, None], n, axis=0)
    made *= n / np.sqrt(2 * power.sum())
    return made


def along_lap(phase: Array) -> Array:
    """Return (m, 1 + 2 ORDERS) independent components of a run scatter of unit variance, at phase (m,) rad of the
    lap.
    """
    orders = np.arange(1, ORDERS + 1)
    waves = np.concatenate([np.cos(phase[:, None] * orders), np.sin(phase[:, None] * orders)], axis=1)
    return np.concatenate([np.full((len(phase), 1), np.sqrt(0.5)), waves * np.sqrt(0.5 / ORDERS)], axis=1)


def slow_noise(levels: Levels, run: int, t: Array, seconds: float, rng: np.random.Generator) -> Array:
    """Return slow noise (m, k) mm at t (m,) of a run of this length; the process is independent of the sampling."""
    gauges = levels.white_mm.shape[1]
    parts = slow(seconds, levels.slow_s, gauges + 1, rng)
    grid = SLOW_STEP_S * np.arange(len(parts))
    parts = np.stack([np.interp(t, grid, column) for column in parts.T], axis=1)
    both = np.sqrt(levels.common) * parts[:, :1] + np.sqrt(1 - levels.common) * parts[:, 1:]
    return levels.slow_mm[run] * both


def stop_scatter(levels: Levels, tail_df: float, target: Array, rng: np.random.Generator) -> Array:
    """Displacements (m, 3) mm of stops from their average position.

    The level of a target is the rms distance of the normal core; a t distribution adds its tails.
    """
    draws = rng.standard_t(tail_df, (len(target), 3)) if tail_df else rng.standard_normal((len(target), 3))
    level = np.array([levels.stops_mm[int(number)] for number in target])
    return draws * level[:, None] / np.sqrt(3)


def wild(noise: CellNoise, white_mm: Array, rows: int, rng: np.random.Generator) -> Array:
    """Return outliers (rows, k) mm of 10 to 100 times the white noise of the gauge."""
    found = np.zeros((rows, len(white_mm)))
    longest = 10 if noise.bursts else 1
    mean = 6.5 if noise.bursts else 1.0
    for gauge, level in enumerate(white_mm):
        for begin in np.flatnonzero(rng.uniform(size=rows) < noise.outliers / mean):
            length = int(rng.integers(3, longest + 1)) if noise.bursts else 1
            size = rng.choice([-1.0, 1.0]) * log_uniform(10, 100, rng) * level
            found[begin : begin + length, gauge] += size
    return found
