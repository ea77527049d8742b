"""Noise of a cell, drawn from the table of real cells or of a single kind, and its effect on readings.

The ranges are written independently of the copy in rig, from the table itself. Lengths are in mm.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

LAP_S = 2 * np.pi * 70.0 / 25.0
STEPS_MM = (0.0001, 0.0005, 0.001, 0.005, 0.010)
LEVELS_APART = 4.0
DRIFT_MM_PER_S = 0.020 / 600.0
_ROW_S = LAP_S / 1500
"""Coefficients of AR noise apply from row to row, with 1500 rows per lap."""


@dataclass(frozen=True)
class Noise:
    """Noise of a circle run.

    white_mm (2,): of each gauge. step_mm: resolution. slow_mm (3,): standard deviations of slow noise common to both
    gauges, of g1 and of g2. slow_s: correlation time, 0 for 1/f. drift_mm_per_s (3,): likewise. slip_mm: of the clamp
    of g1. outliers: share of readings, in bursts of this many rows. uneven: deviation of rows from even spacing, in
    spacings. stamp_s: standard deviation of the time of a row. cycle_s: of a gauge that holds its last value. lag_s
    within u_lag_s: common to all rows.
    """

    white_mm: tuple[float, float] = (0.0005, 0.0005)
    step_mm: float = 0.0001
    slow_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    slow_s: float = 0.0
    drift_mm_per_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    slip_mm: float = 0.0
    outliers: float = 0.0
    burst: int = 1
    uneven: float = 0.3
    stamp_s: float = 0.0
    cycle_s: float = 0.0
    lag_s: float = 0.0
    u_lag_s: float = 1e-4


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """A log-uniform random number."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def student(rng: np.random.Generator, freedom: float, shape: tuple[int, ...]) -> np.ndarray:
    """Random numbers of standard deviation 1 from a t distribution; with infinite freedom normal ones."""
    if not np.isfinite(freedom):
        return rng.normal(size=shape)
    return rng.standard_t(freedom, shape) / np.sqrt(freedom / (freedom - 2))


def draw_scatter(rng: np.random.Generator) -> tuple[float, float]:
    """Smallest and largest scatter of stops in a cell: 3 to 60 µm, with a ratio of up to four."""
    middle, apart = between(rng, 0.003, 0.060), between(rng, 1.0, 4.0) ** 0.5
    return max(middle / apart, 0.003), min(middle * apart, 0.060)


SINGLE: dict[str, Noise] = {
    "white": Noise(white_mm=(0.001, 0.001)),
    "AR .95": Noise(slow_mm=(0, 0.001, 0.001), slow_s=-_ROW_S / np.log(0.95)),
    "AR .995": Noise(slow_mm=(0, 0.001, 0.001), slow_s=-_ROW_S / np.log(0.995)),
    "1/f": Noise(slow_mm=(0, 0.001, 0.001)),
    "1 um steps": Noise(step_mm=0.001),
    "10 um steps": Noise(step_mm=0.010),
    "outliers": Noise(white_mm=(0.001, 0.001), outliers=0.005, burst=5),
    "uneven stamps": Noise(uneven=1.0, stamp_s=0.010),
    "own cycle": Noise(cycle_s=0.100),
    "drift": Noise(drift_mm_per_s=(DRIFT_MM_PER_S, DRIFT_MM_PER_S, -DRIFT_MM_PER_S)),
    "slip": Noise(slip_mm=0.005),
}
"""One kind of noise at a time, with a quiet gauge: white noise 0.5 µm, resolution 0.1 µm."""


def draw_cell(rng: np.random.Generator, kind: str) -> Noise:
    if kind != "table":
        return SINGLE[kind]
    slow = [between(rng, 0.0005, 0.020) for _ in range(3)]
    u_lag_s = between(rng, 1e-4, 5e-3)
    holds = rng.random() < 0.25
    return Noise(
        white_mm=(between(rng, 0.0002, 0.003),) * 2,
        step_mm=float(rng.choice(STEPS_MM)),
        slow_mm=(slow[0], slow[1], slow[2]),
        slow_s=between(rng, 0.1, 5.0) if rng.random() < 0.5 else 0.0,
        drift_mm_per_s=tuple(rng.uniform(-1, 1, 3) * DRIFT_MM_PER_S / 2),  # type: ignore[arg-type]
        outliers=rng.uniform(0, 0.005),
        burst=int(rng.choice([1, 5, 20])),
        uneven=rng.uniform(0, 1),
        stamp_s=0.0 if holds else between(rng, 1e-4, 0.020),
        cycle_s=between(rng, 0.001, 0.200) if holds else 0.0,
        lag_s=rng.normal(0, u_lag_s),
        u_lag_s=u_lag_s,
    )


def draw_run(rng: np.random.Generator, cell: Noise, kind: str) -> Noise:
    """Noise of a run. With the table, the levels of each gauge and run differ by up to LEVELS_APART."""
    if kind != "table":
        return cell
    apart = LEVELS_APART ** rng.uniform(-0.5, 0.5, 5)
    white = np.clip(np.multiply(cell.white_mm, apart[:2]), 0.0002, 0.003)
    slow = np.clip(np.multiply(cell.slow_mm, apart[2:]), 0.0005, 0.020)
    return dataclasses.replace(cell, white_mm=tuple(white.tolist()), slow_mm=tuple(slow.tolist()))


# --- effect on a run


def rows(rng: np.random.Generator, noise: Noise, end_s: float, row_s: float) -> np.ndarray:
    """Times (n,) s of rows from 0 to end_s, at an average interval row_s."""
    count = int(end_s / row_s)
    even = np.arange(count) * row_s
    return np.sort(even + noise.uneven * rng.uniform(-0.5, 0.5, count) * row_s)


def gauge_times(rng: np.random.Generator, noise: Noise, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True reading times (n, 2) s of both gauges, the row (n, 2) of the displayed noise (an earlier one
    if a gauge repeats its value), and the standard uncertainty (n,) s of each row's time.
    """
    here = np.tile(np.arange(len(t_s))[:, None], (1, 2))
    if not noise.cycle_s:
        late = rng.normal(0, 1, (len(t_s), 2)) * noise.stamp_s
        return t_s[:, None] - noise.lag_s - late, here, np.full(len(t_s), noise.stamp_s)
    phase = rng.uniform(0, 1, 2)
    cycle = np.floor(t_s[:, None] / noise.cycle_s + phase)
    age = t_s[:, None] - (cycle - phase) * noise.cycle_s
    first = np.stack([np.searchsorted(column, column) for column in cycle.T], axis=1)
    # The average delay of half a cycle is known and removed; only its spread remains.
    true_s = t_s[:, None] - noise.lag_s - (age - noise.cycle_s / 2)
    return true_s, first, np.full(len(t_s), noise.cycle_s / np.sqrt(12))


def noise_of(rng: np.random.Generator, noise: Noise, t_s: np.ndarray) -> np.ndarray:
    """Return white and slow noise, drift and slip (n, 2) mm at times (n,) s. Drift and slip are relative to the
    first row.
    """
    count = len(t_s)
    slow = _slow(rng, noise.slow_s, count, float(np.ptp(t_s)) / max(count - 1, 1)) * np.array(noise.slow_mm)[:, None]
    creep = np.array(noise.drift_mm_per_s)[:, None] * (t_s - t_s[0])
    both, own = (slow + creep)[0], (slow + creep)[1:].T
    slipped = noise.slip_mm * (t_s > rng.uniform(*np.quantile(t_s, [0.2, 0.8])))
    moved = np.stack([slipped, np.zeros(count)], axis=1)
    return both[:, None] + own + moved + rng.normal(0, 1, (count, 2)) * noise.white_mm


def _slow(rng: np.random.Generator, slow_s: float, count: int, row_s: float) -> np.ndarray:
    """Return three series (3, n) of standard deviation 1: AR(1) with correlation time slow_s, or 1/f for 0."""
    from scipy.signal import lfilter  # noqa: PLC0415 - slow to import

    if slow_s:
        rho = np.exp(-row_s / slow_s)
        shocks = rng.normal(0, np.sqrt(1 - rho**2), (3, count))
        shocks[:, 0] = rng.normal(0, 1, 3)
        return np.asarray(lfilter([1.0], [1.0, -rho], shocks, axis=1))
    # Twice the required length, because a synthesis by FFT is periodic.
    order = np.arange(1, count + 1)
    parts = (rng.normal(size=(3, count)) + 1j * rng.normal(size=(3, count))) / np.sqrt(order)
    series = np.fft.irfft(np.concatenate([np.zeros((3, 1)), parts], axis=1), 2 * count)[:, :count]
    return np.asarray(series * 2 * count / (2 * np.sqrt((1 / order).sum())))


def disturbed(rng: np.random.Generator, noise: Noise, g_mm: np.ndarray) -> np.ndarray:
    """Return readings (n, 2) mm with outliers of 10 to 100 standard deviations, rounded to the resolution."""
    sigma = np.hypot(noise.white_mm, noise.step_mm / np.sqrt(12))
    starts = rng.random(g_mm.shape) < noise.outliers / noise.burst
    hit = np.maximum.reduce([np.roll(starts, k, axis=0) for k in range(noise.burst)])
    side = np.where(rng.random(g_mm.shape) < 0.5, -1, 1) if noise.burst == 1 else rng.choice([-1, 1])
    size = side * np.exp(rng.uniform(np.log(10), np.log(100), g_mm.shape)) * sigma
    return np.asarray(np.round((g_mm + hit * size) / noise.step_mm) * noise.step_mm)
