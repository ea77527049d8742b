"""A run as a diagnosis sees it: its path smooth, its lap and where it stood, ready to be laid over its repeats."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.rounding import smooth
from analysis.fitting.observation import Observation, observe, predicted
from analysis.kinematics.arm import Array, Integers
from analysis.model.predict import Model, nominal_setup
from analysis.noise.readings import is_wild
from analysis.traces.laps import laps_of
from analysis.traces.tables import CircleTable, Table

GRID = 512
"""Circle angles that a lap is interpolated to; the highest order is a little under half of it."""
ORDERS = GRID // 2
ORDER_OF: Integers = np.tile(np.concatenate([[0], np.arange(1, ORDERS), np.arange(1, ORDERS)]), 2)
"""The order of each entry of a circle's vector: first those of the sum of the gauges, then of their difference."""
_ROWS = 2 * GRID
"""Rows of a lap that are enough for its orders: those of a quicker gauge are averaged."""
_STANDS = 0.02
"""Share of the lap's median speed below which the robot stands."""
_LEAST_STAND = 3


@dataclass(frozen=True)
class Sampling:
    """How a circle's rows become a vector.

    before, after (L, GRID): in each lap the rows beside each grid angle, share (L, GRID) of the latter; phi (n,) rad of
    the laps' rows, which come first; stands: rows of standing before the lap and after it; stand_share (len(stands),):
    how long a stand is in steps of the grid."""

    before: Integers
    after: Integers
    share: Array
    phi: Array
    stands: tuple[Integers, ...]
    stand_share: Array

    def gridded(self, values: Array) -> Array:
        """(m, …) at the rows to (GRID, …) at the grid, the mean of the laps."""
        share = self.share.reshape(*self.share.shape, *[1] * (values.ndim - 1))
        found: Array = (values[self.before] * (1 - share) + values[self.after] * share).mean(axis=0)
        return found

    def vector(self, values: Array) -> Array:
        """Readings (m, 2, …) of two gauges to (N, …): orders of sum and difference (unitary), then stands."""
        parts = [by_orders(self.gridded(values))]
        for rows in self.stands:
            mean = values[rows].mean(axis=0, keepdims=True)
            parts += [_sum(mean), _difference(mean)]
        return np.concatenate(parts)

    @property
    def averaged(self) -> float:
        """What is left of the power of white noise between two rows."""
        return float(np.mean((1 - self.share) ** 2 + self.share**2)) / len(self.share)

    def without_stands(self) -> Sampling:
        """The same for the lap alone."""
        return replace(self, stands=(), stand_share=np.empty(0))


def by_orders(readings: Array) -> Array:
    """Readings (GRID, 2, …) at the grid to the orders of sum and difference, (N, …); `curve` is its inverse."""
    parts = []
    for channel in (_sum(readings), _difference(readings)):
        spectrum = np.fft.rfft(channel, axis=0, norm="ortho")
        parts += [spectrum[:1].real, np.sqrt(2) * spectrum[1:ORDERS].real, np.sqrt(2) * spectrum[1:ORDERS].imag]
    return np.concatenate(parts)


def curve(vector: Array) -> Array:
    """Readings (GRID, 2) at the grid, from the orders of a circle's vector."""
    half = len(ORDER_OF) // 2
    channels = []
    for part in (vector[:half], vector[half : 2 * half]):
        spectrum = np.zeros(ORDERS + 1, dtype=complex)
        spectrum[0] = part[0]
        spectrum[1:ORDERS] = (part[1:ORDERS] + 1j * part[ORDERS:]) / np.sqrt(2)
        channels.append(np.fft.irfft(spectrum, n=GRID, norm="ortho"))
    total, apart = channels
    readings: Array = np.stack([total - apart, total + apart], axis=1) / np.sqrt(2)
    return readings


def _sum(values: Array) -> Array:
    added: Array = (values[:, 0] + values[:, 1]) / np.sqrt(2)
    return added


def _difference(values: Array) -> Array:
    apart: Array = (values[:, 1] - values[:, 0]) / np.sqrt(2)
    return apart


@dataclass(frozen=True)
class Seen:
    """One run. model: of its own rig file; one: its observation, smooth, the rows of stands behind those of the lap;
    wild: how many readings of a circle leave their neighbours and follow them here."""

    model: Model
    one: Observation
    sampling: Sampling | None
    wild: int = 0

    @property
    def name(self) -> str:
        """Of what it repeats: `yaw cw`, `radial`."""
        table = self.one.table
        return f"{self.one.setup} {table.direction}" if isinstance(table, CircleTable) else self.one.setup


def see(model: Model, table: Table, where: str) -> Seen:
    """A run's table. Raises FileError for a circle that is none."""
    if not isinstance(table, CircleTable):
        return Seen(model, observe(model, table, where), None)
    sound = calm(table)
    wild = int(np.count_nonzero(sound.g_mm != table.g_mm))
    table = averaged(sound, _rows_a_lap(table, model, where) // _ROWS)
    lap = observe(model, table, where)
    smoothed = smooth(lap)
    sampling, rows = _sampled(table, model, smoothed, where)
    raw, one = replace(lap, rows=rows), replace(smoothed, rows=rows)
    # Servo ripple is real: the readings are those of the smooth path once what the joints did beside it is taken off.
    setup = nominal_setup(model.rig, table)
    ripple = predicted(model, raw, setup) - predicted(model, one, setup)
    return Seen(model, replace(one, values=table.g_mm[rows] - ripple), sampling, wild)


def calm(table: CircleTable) -> CircleTable:
    """A circle whose wild readings follow their neighbours."""
    g_mm = table.g_mm.copy()
    for gauge in g_mm.T:
        wild = is_wild(gauge)
        if wild.any() and not wild.all():
            gauge[wild] = np.interp(table.t_s[wild], table.t_s[~wild], gauge[~wild])
    return replace(table, g_mm=g_mm)


def averaged(table: CircleTable, count: int) -> CircleTable:
    """A circle with the means of each `count` rows in the place of these, so that cost does not grow with the rate of a
    gauge; the last rows that make no whole mean are left out."""
    if count < 2:
        return table
    whole = len(table.t_s) // count * count

    def means(values: Array) -> Array:
        mean: Array = values[:whole].reshape(-1, count, *values.shape[1:]).mean(axis=1)
        return mean

    return replace(table, t_s=means(table.t_s), q=means(table.q), g_mm=means(table.g_mm), u_t_s=None)


def _rows_a_lap(table: CircleTable, model: Model, where: str) -> int:
    laps = laps_of(table, model.rig, where)
    return len(laps.phi) // laps.count


def _sampled(table: CircleTable, model: Model, one: Observation, where: str) -> tuple[Sampling, Integers]:
    phi = laps_of(table, model.rig, where).phi
    stands = _stands(one)
    begins = len(one.rows) + np.cumsum([0, *(len(rows) for rows in stands)])
    places = tuple(np.arange(a, a + len(rows)) for a, rows in zip(begins, stands, strict=False))
    per_step = len(one.rows) / (GRID * _laps(phi))
    shares = np.array([len(rows) / per_step for rows in stands])
    return _sampling(phi, places, shares), np.concatenate([one.rows, *stands]).astype(np.intp)


def _laps(phi: Array) -> int:
    """How many laps circle angles (n,) rad, in order of time, go on for."""
    return max(1, round(float(np.ptp(phi)) / (2 * np.pi)))


def _sampling(phi: Array, stands: tuple[Integers, ...], stand_share: Array) -> Sampling:
    """Of the circle angles (n,) rad of some laps, in order of time."""
    laps = _laps(phi)
    number = np.minimum(np.abs(phi - phi[0]) // (2 * np.pi), laps - 1)
    sides = [_beside(np.flatnonzero(number == lap), phi) for lap in range(laps)]
    before, after, share = (np.array(side) for side in zip(*sides, strict=True))
    return Sampling(before, after, share, phi, stands, stand_share)


def _beside(rows: Integers, phi: Array) -> tuple[Integers, Integers, Array]:
    """The rows of one lap before and after each grid angle, (GRID,) each, and the share of the latter."""
    order = rows[np.argsort(phi[rows] % (2 * np.pi))]
    angle = phi[order] % (2 * np.pi)
    grid = np.arange(GRID) * 2 * np.pi / GRID
    after = np.searchsorted(angle, grid) % len(angle)
    before = after - 1
    step = (angle[after] - angle[before]) % (2 * np.pi)
    share = ((grid - angle[before]) % (2 * np.pi)) / np.where(step > 0, step, 1.0)
    return order[before], order[after], np.clip(share, 0, 1)


def _stands(one: Observation) -> list[Integers]:
    """Rows of standing before the lap and after it; none where there are not both."""
    t, q = one.path.t_s, one.path.q
    speed = np.linalg.norm(np.gradient(q, t, axis=0), axis=1)
    still = speed < _STANDS * np.median(speed[one.rows])
    first, last = int(one.rows[0]), int(one.rows[-1])
    found = [np.flatnonzero(still[:first]), last + 1 + np.flatnonzero(still[last + 1 :])]
    return found if min(map(len, found)) >= _LEAST_STAND else []
