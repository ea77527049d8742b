"""Runs in the form of a fit: readings to explain, path, laps, standstills and joint ranges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from analysis.procedures.shared.test_kind import (
    Facts,
    facts_of,
    kind_of,
    no_joints_error,
    nominal_setup,
    path_of,
    read,
    shows_joints,
)
from analysis.robot.kinematics.arm import Array, Integers, Mask
from analysis.robot.kinematics.joint_limits import turned_into
from analysis.robot.predict import Model, ModelScene, Motion, Path, SetUp, SetUps, moved
from analysis.runs.laps import laps_of
from analysis.runs.noise.readings import is_outlier, step_of
from analysis.runs.tables import CircleTable, Table, content_order
from rigs.effects import Effect

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# ----------------------------------------------------------------------------------------------------------------------
# Runs in the form of a fit: readings relative to the model of their rig file, and residuals.


@dataclass(frozen=True)
class ObservedRun:
    """Run to be explained relative to the model of its rig file."""

    model: Model
    table: Table
    path: Path
    """Smooth for a circle of a diagnosis."""
    rows: Integers
    """Table rows (m,) of the readings used; those of standstills follow those of the lap."""
    values: Array
    """Readings (m, k) mm."""
    setup: str
    """Name of the set-up, shared by runs."""
    sampling: Sampling | None = None
    wild: int = 0
    """Number of readings replaced by interpolation."""
    step_mm: float = 0.0
    """Quantisation of the coarser gauge."""

    @property
    def facts(self) -> Facts:
        return facts_of(self.table.test)

    @property
    def samples(self) -> Integers:
        """Path samples (m,) of the readings."""
        return np.asarray(self.path.rows[self.rows], dtype=np.intp)

    @property
    def t_s(self) -> Array:
        return self.path.t_s[self.samples]

    @property
    def name(self) -> str:
        """Name shared by repeated runs: `yaw cw`, `radial`."""
        direction = self.table.driven_direction
        return f"{self.setup} {direction}" if direction else self.setup

    @property
    def visits(self) -> Integers:
        """Integers (m, k) describing place and approach of each reading."""
        return np.asarray(kind_of(self.table.test).visits(self.table)[self.rows], dtype=np.int64)

    def entries(self, values: Array) -> Array:
        """Readings (m, k, …) mm as entries (N, …) mm: orders for a circle, otherwise unchanged."""
        return self.sampling.vector(values) if self.sampling else values.reshape(-1, *values.shape[2:])

    @property
    def on_lap(self) -> ObservedRun:
        """Run used for stating errors: for a circle only the lap, because a standstill would count the same place
        hundreds of times.
        """
        if self.sampling is None:
            return self
        lap = slice(len(self.sampling.phi))
        return replace(self, rows=self.rows[lap], values=self.values[lap], sampling=None)


def observe(model: Model, table: Table, where: str) -> ObservedRun:
    """Select the readings of a table, for a circle those of the laps. Raises FileError for a table that is not a circle
    of the rig, or has no joint angles.
    """
    if not shows_joints(table.test):
        raise no_joints_error(table.test, where)
    rows = kind_of(table.test).rows_used(table, model.rig, where)
    return ObservedRun(model, table, path_of(model, table), rows, table.readings[rows], table.test)


def with_placement(run: ObservedRun, placement: str) -> ObservedRun:
    return replace(run, setup=f"{run.setup} at {placement}") if placement else run


_SOCKET = ", socket "
"""Separator between the names of a placement and a socket."""


def without_socket(setup: str) -> str:
    return setup.partition(_SOCKET)[0]


def socket_of(setup: str) -> str:
    return setup.partition(_SOCKET)[2]


def by_socket(run: ObservedRun) -> list[ObservedRun]:
    """Split touches into a run per socket, each with a set-up; other runs are unchanged."""
    parts = kind_of(run.table.test).parts(run.table)
    if parts is None:
        return [run]
    socket = parts[run.rows]
    names = np.unique(socket).tolist()
    return [replace(part(run, socket == name), setup=f"{run.setup}{_SOCKET}{name}") for name in names]


def part(run: ObservedRun, keep: Mask) -> ObservedRun:
    return replace(run, rows=run.rows[keep], values=run.values[keep])


def parts(runs: Sequence[ObservedRun], keep: Mask) -> list[ObservedRun]:
    """The nonempty runs with the readings of a mask over the rows of all runs."""
    kept, begin = [], 0
    for run in runs:
        own = keep[begin : begin + len(run.rows)]
        begin += len(run.rows)
        if own.any():
            kept.append(part(run, own))
    return kept


def in_content_order(run: ObservedRun) -> ObservedRun:
    """Sort the readings of places by row contents, so that no result depends on the row order of a table without
    times.
    """
    if not run.facts.of_places:
        return run
    rank = np.argsort(content_order(run.table))
    order = np.argsort(rank[run.rows], kind="stable")
    return replace(run, rows=run.rows[order], values=run.values[order])


_FEW_ROWS = 256
"""Number of readings of a thinned circle. Chosen: they locate the ball to a tenth of a micrometre."""


def thinned(run: ObservedRun) -> ObservedRun:
    """A circle with few, evenly spaced readings of its lap, for simulation; other runs are unchanged."""
    if not run.table.swept:
        return run
    run = run.on_lap
    kept = np.argsort(run.rows)[:: -(-len(run.rows) // _FEW_ROWS)]
    path = replace(run.path, rows=run.samples[kept], alone=True)
    return replace(run, path=path, rows=np.arange(len(kept)), values=run.values[kept])


def predicted(run: ObservedRun, setup: SetUp) -> Array:
    """Predicted readings (m, k) mm; for poses the positions."""
    return predicted_in_scene(run.model, run, moved(run.model, run.path), setup)


def predicted_in_scene(model: Model, run: ObservedRun, scene: ModelScene, setup: SetUp) -> Array:
    """The same from an existing scene, common to all set-ups."""
    values = read(model, run.table, run.path, scene, setup)
    if run.facts.of_places:
        values = values[:, [3, 7, 11]]
    return values[run.rows]


def residual_of(run: ObservedRun, setups: SetUps) -> Array:
    return run.values - predicted(run, setups[run.setup])


def rms(residuals: Sequence[Array]) -> float:
    """Root mean square in mm of residuals (m, k) mm: per gauge reading, and per distance of a position."""
    squares = np.concatenate([(r**2).sum(axis=1) if r.shape[1] == 3 else (r**2).ravel() for r in residuals])
    return float(np.sqrt(squares.mean()))


# ----------------------------------------------------------------------------------------------------------------------
# Joint ranges of runs, and warnings if a model is used outside.

JointRange = tuple[float, float]
"""Lowest and highest angle of a joint, in degrees."""
BEYOND_DEG = 3.0
"""Margin of a model's validity beyond the measured range. Chosen: link constants and gear errors change little over it.
"""
BEYOND_MM = 1000 * float(np.radians(BEYOND_DEG))
"""Margin of a rail: the displacement by that angle of a joint at a metre."""


def outside_coverage(covered: Sequence[JointRange], q_rad: Array, run: str) -> list[str]:
    """A message for each joint whose angles (n, 6) rad leave the measured ranges, starting with the name of the
    `run`.
    """
    lines = []
    # A rail position may follow the joints.
    joints = np.degrees(turned_into(q_rad[:, : len(covered)], np.radians(np.array(covered)), np.radians(BEYOND_DEG)))
    for axis, ((low, high), angle) in enumerate(zip(covered, joints.T, strict=True), start=1):
        outside = int(((angle < low - BEYOND_DEG) | (angle > high + BEYOND_DEG)).sum())
        if outside:
            stands = f"axis {axis} is at {angle.min():z.1f}° to {angle.max():z.1f}°"
            lines.append(
                f"{run}: {stands}, {outside} of {len(angle)} outside {low:z.1f}° to {high:z.1f}°, where it was found"
            )
    return lines


def outside_effect_coverage(effects: Sequence[Effect], q_rad: Array, run: str) -> list[str]:
    """The same for the effects of a rig file, each with the joint range of its runs."""
    covered = [effect.found.joints_deg for effect in effects if effect.found and effect.found.joints_deg]
    if not covered:
        return []
    ranges = [(max(low for low, _ in axis), min(high for _, high in axis)) for axis in zip(*covered, strict=True)]
    return outside_coverage(ranges, q_rad, run)


# ----------------------------------------------------------------------------------------------------------------------
# Smoothing of reported angles, which removes the steps of their last digit.
#
# A controller rounds the reported angles, for example to 1e-4 degrees, which at a reach of one metre equals the noise
# of a gauge. A local parabola over a fifth of a second to either side replaces the angles of the lap.

_HALF_WIDTH_S = 0.2
"""Half width of the local parabola. Chosen: several samples at 50 Hz, and shorter than a joint reversal."""


def smooth_path(run: ObservedRun) -> ObservedRun:
    if not run.table.swept:
        return run
    # A parabola overshoots at start and stop, and would create reversals, so only laps are smoothed.
    laps, t_s, q = run.samples, run.path.t_s, run.path.q
    reach = max(2, int(np.ceil(_HALF_WIDTH_S / float(np.median(np.diff(t_s))))))
    index = np.arange(len(t_s))[:, None] + np.arange(-reach, reach + 1)
    inside = (index >= 0) & (index < len(t_s))
    index = np.clip(index, 0, len(t_s) - 1)
    x = (t_s[index] - t_s[:, None]) / _HALF_WIDTH_S
    weight = np.where(inside & (np.abs(x) < 1), 1 - x**2, 0.0)  # Epanechnikov's kernel
    powers = np.stack([np.ones_like(x), x, x**2], axis=2)
    normal = np.einsum("nw,nwi,nwj->nij", weight, powers, powers) + 1e-12 * np.eye(3)
    # Only the central value is needed, so a single row of the inverse gives the weights of the samples.
    row = np.linalg.solve(normal, np.broadcast_to(np.eye(3)[:, :1], (len(t_s), 3, 1)))[:, :, 0]
    share = weight * np.einsum("ni,nwi->nw", row, powers)
    smooth = q.copy()
    smooth[laps] = (np.einsum("nw,nwj->nj", share, q[index] - q[:, None]) + q)[laps]
    return replace(run, path=replace(run.path, motion=Motion(t_s, smooth)))


# ----------------------------------------------------------------------------------------------------------------------
# Run in the form of a diagnosis: smooth path, lap and standstills, comparable with its repeats.

GRID = 512
"""Circle angles of an interpolated lap. Chosen: a power of two for the Fourier transform, 0.7 degrees per step."""
ORDERS = GRID // 2
"""Number of orders of a channel, including order 0."""
ORDER_OF: Integers = np.tile(np.concatenate([[0], np.arange(1, ORDERS), np.arange(1, ORDERS)]), 2)
"""Order of each entry of a circle's vector: first for the sum of the gauges, then for their difference."""
STAMP_SCATTER = 0.25
"""Standard deviation of possible stamp scatter, relative to the sampling interval. Chosen: one reading in 400 then
passes the next.
"""
_ROWS = 2 * GRID
"""Rows per lap sufficient for its orders; the rows of faster gauges are averaged."""
_STANDSTILL_SHARE = 0.02
"""Share of the median joint speed of a lap below which the robot stands. Chosen: above the noise of the feedback."""
_MOST_APART = GRID // 16
"""Largest bridged distance between the start angles of repeated laps, in grid steps. Chosen: repeats of a program begin
within a row.
"""
_LEAST_STANDSTILL_ROWS = 3
"""Minimum rows of a standstill. Chosen: fewer give no mean."""
TREND_ORDERS = 4
"""Orders of the trend between laps: a growing ball, gauge or arm changes orders 0 and 1, and an eccentric ball adds the
next. Chosen: twice as many.
"""
ORDER_OF_TREND: Integers = np.tile(np.concatenate([np.arange(TREND_ORDERS), np.arange(1, TREND_ORDERS)]), 2)
"""Order of each trend entry, in the order of `ORDER_OF`."""
_OF_TREND: Integers = np.flatnonzero(ORDER_OF < TREND_ORDERS)


@dataclass(frozen=True)
class Sampling:
    """Conversion of a circle's rows to a vector, for L laps with rows (n,)."""

    before: Integers
    """Rows (L, GRID) before each grid angle, and `after` it."""
    after: Integers
    share: Array
    """Weight (L, GRID) of the rows after."""
    phi: Array
    """Circle angles (n,) rad of the laps' rows, which come first."""
    stands: tuple[Integers, ...]
    """Rows of the standstills before and after the lap."""
    stand_share: Array
    """Their number in grid steps."""
    trend: Array
    """Weights (L,) of the laps in the change between laps, with the noise of a lap; empty for a single lap."""
    bridged: tuple[int, int] | None = None
    """First and last grid angle (possibly negative, or of the next turn) at the start of the laps that are
    interpolated from their neighbours.
    """

    def gridded(self, values: Array) -> Array:
        """Row values (m, …) at the grid (GRID, …), averaged over the laps."""
        mean: Array = self._interpolation @ values[: self._interpolation.shape[1]].reshape(-1, values[0].size)
        return mean.reshape(GRID, *values.shape[1:])

    @cached_property
    def _interpolation(self) -> csr_array:
        return self._matrix(np.full(len(self.share), 1 / len(self.share)))

    @cached_property
    def _trend(self) -> csr_array:
        return self._matrix(self.trend)

    def _matrix(self, laps: Array) -> csr_array:
        """Matrix (GRID, n) from row values to their sum over the laps, with weights (L,)."""
        from scipy.sparse import csr_array  # noqa: PLC0415 - slow to import

        weight = np.concatenate([((1 - self.share) * laps[:, None]).ravel(), (self.share * laps[:, None]).ravel()])
        rows = np.concatenate([self.before.ravel(), self.after.ravel()])
        grid = np.tile(np.arange(GRID), 2 * len(self.share))
        matrix = csr_array((weight, (grid, rows)), shape=(GRID, len(self.phi)))
        if self.bridged is None:
            return matrix
        # Bridged grid angles are interpolated linearly between their neighbours.
        begin, end = self.bridged
        bridge, share = np.eye(GRID), np.arange(1, end - begin + 2) / (end - begin + 2)
        inside = np.arange(begin, end + 1) % GRID
        bridge[inside] = 0.0
        bridge[inside, (begin - 1) % GRID] = 1 - share
        bridge[inside, (end + 1) % GRID] = share
        return csr_array(csr_array(bridge) @ matrix)

    def gridded_sd(self, sd: Array) -> Array:
        """Standard deviation (GRID, …) at the grid for independent row errors sd (m, …)."""
        weight = self._interpolation
        variance: Array = weight.multiply(weight) @ sd[: weight.shape[1]].reshape(-1, sd[0].size) ** 2
        return np.sqrt(variance).reshape(GRID, *sd.shape[1:])

    def vector(self, values: Array) -> Array:
        """Readings (m, 2, …) of two gauges as entries (N, …): orders of sum and difference (unitary), means over
        standstills, and slow orders of the trend between laps.
        """
        parts = [by_orders(self.gridded(values))]
        for rows in self.stands:
            parts += _channels(values[rows].mean(axis=0, keepdims=True))
        if len(self.trend):
            laps: Array = self._trend @ values[: len(self.phi)].reshape(len(self.phi), -1)
            parts.append(by_orders(laps.reshape(GRID, *values.shape[1:]))[_OF_TREND])
        return np.concatenate(parts)

    @property
    def begin(self) -> float:
        """Start angle of the laps, in grid steps."""
        return float(self.phi[0] % (2 * np.pi)) * GRID / (2 * np.pi)

    @property
    def seam(self) -> tuple[float, float]:
        """Extent of each lap before and after its start angle with rows on either side, in grid steps."""
        laps = len(self.share)
        off = (self.phi - self.phi[0]) * GRID / (2 * np.pi)
        number, near = _number(self.phi, laps), (off + GRID / 2) % GRID - GRID / 2
        before = [near[(number == lap) & (near < 0)] for lap in range(laps)]
        after = [near[(number == lap) & (near > 0)] for lap in range(laps)]
        return (
            min((float(rows.max()) for rows in before if len(rows)), default=0.0),
            max((float(rows.min()) for rows in after if len(rows)), default=0.0),
        )

    @property
    def averaged(self) -> float:
        """Share of white noise power remaining after interpolation between rows, averaged over the laps."""
        return float(np.mean((1 - self.share) ** 2 + self.share**2)) / len(self.share)

    def without_stands(self) -> Sampling:
        return replace(self, stands=(), stand_share=np.empty(0))

    def without_trend(self) -> Sampling:
        return replace(self, trend=np.empty(0))


def bridging(samplings: Sequence[Sampling]) -> list[Sampling]:
    """Interpolate the same grid angles around the start of repeated laps.

    At the end of a lap a joint may be a full turn away from the start, which changes the readings. Repeated laps start
    up to a row apart, so a grid angle near the start would show the end of one lap and the start of another.
    """
    first = samplings[0].begin
    offsets = [(sampling.begin - first + GRID / 2) % GRID - GRID / 2 for sampling in samplings]
    if max(offsets) - min(offsets) > _MOST_APART:
        return list(samplings)
    seams = [(off + sampling.seam[0], off + sampling.seam[1]) for off, sampling in zip(offsets, samplings, strict=True)]
    bridged = (int(np.floor(first + min(seams)[0])), int(np.ceil(first + max(after for _, after in seams))))
    return [replace(sampling, bridged=bridged) for sampling in samplings]


def by_orders(readings: Array) -> Array:
    """Fourier coefficients (N, …) of the sum and difference of both gauges, given their readings (GRID, 2, …). `curve`
    is the inverse.
    """
    parts = []
    for channel in _channels(readings):
        spectrum = np.fft.rfft(channel, axis=0, norm="ortho")
        parts += [spectrum[:1].real, np.sqrt(2) * spectrum[1:ORDERS].real, np.sqrt(2) * spectrum[1:ORDERS].imag]
    return np.concatenate(parts)


def curve(vector: Array) -> Array:
    """Readings (GRID, 2) mm of both gauges around a circle, given the coefficients of `by_orders`."""
    per_channel = len(ORDER_OF) // 2
    channels = []
    for part in (vector[:per_channel], vector[per_channel : 2 * per_channel]):
        spectrum = np.zeros(ORDERS + 1, dtype=complex)
        spectrum[0] = part[0]
        spectrum[1:ORDERS] = (part[1:ORDERS] + 1j * part[ORDERS:]) / np.sqrt(2)
        channels.append(np.fft.irfft(spectrum, n=GRID, norm="ortho"))
    total, apart = channels
    return np.asarray(np.stack([total - apart, total + apart], axis=1) / np.sqrt(2), dtype=float)


def _channels(values: Array) -> tuple[Array, Array]:
    return (values[:, 0] + values[:, 1]) / np.sqrt(2), (values[:, 1] - values[:, 0]) / np.sqrt(2)


def observe_run(model: Model, table: Table, where: str) -> ObservedRun:
    """Observe a run's table in the form of a diagnosis. Raises FileError for a table that is not a circle of the
    rig.
    """
    if not isinstance(table, CircleTable):
        return observe(model, table, where)
    sound = without_outliers(table)
    wild = int(np.count_nonzero(sound.g_mm != table.g_mm))
    step_mm = max(step_of(gauge) for gauge in table.g_mm.T)
    laps = laps_of(table, model.rig, where)
    table = averaged(sound, len(laps.phi) // laps.count // _ROWS)
    lap = observe(model, table, where)
    smoothed = smooth_path(lap)
    phi, q, first, last = laps_of(table, model.rig, where).phi, smoothed.path.q, int(lap.rows[0]), int(lap.rows[-1])
    speed = np.linalg.norm(np.gradient(q, smoothed.path.t_s, axis=0), axis=1)
    still = speed < _STANDSTILL_SHARE * np.median(speed[lap.rows])
    # standstills before and after the lap, if present
    stands = [np.flatnonzero(still[:first]), last + 1 + np.flatnonzero(still[last + 1 :])]
    stands = stands if min(map(len, stands)) >= _LEAST_STANDSTILL_ROWS else []
    begins = len(lap.rows) + np.cumsum([0, *(len(rows) for rows in stands)])
    places = tuple(np.arange(a, a + len(rows)) for a, rows in zip(begins, stands, strict=False))
    per_step = len(lap.rows) / (GRID * _laps(phi))
    sampling = sampling_of(phi, places, np.array([len(rows) / per_step for rows in stands]))
    rows = np.concatenate([lap.rows, *stands]).astype(np.intp)
    raw, smooth = replace(lap, rows=rows), replace(smoothed, rows=rows)
    # Servo ripple is real motion, so the readings are corrected by the predicted effect of removing it from the path.
    setup = nominal_setup(model.rig, table)
    values = table.g_mm[rows] - (predicted(raw, setup) - predicted(smooth, setup))
    return replace(smooth, values=values, sampling=sampling, wild=wild, step_mm=step_mm)


def without_outliers(table: CircleTable) -> CircleTable:
    g_mm = table.g_mm.copy()
    for gauge in g_mm.T:
        wild = is_outlier(gauge)
        if wild.any() and not wild.all():
            gauge[wild] = np.interp(table.t_s[wild], table.t_s[~wild], gauge[~wild])
    return table if np.array_equal(g_mm, table.g_mm) else replace(table, g_mm=g_mm)


def averaged(table: CircleTable, count: int) -> CircleTable:
    """A circle with each `count` rows averaged, which limits the cost of fast gauges."""
    if count < 2:
        return table
    whole = len(table.t_s) // count * count

    def means_by_group(values: Array) -> Array:
        return np.asarray(values[:whole].reshape(-1, count, *values.shape[1:]).mean(axis=1), dtype=float)

    return replace(
        table, t_s=means_by_group(table.t_s), q=means_by_group(table.q), g_mm=means_by_group(table.g_mm), u_t_s=None
    )


def _laps(phi: Array) -> int:
    return max(1, round(float(np.ptp(phi)) / (2 * np.pi)))


def sampling_of(phi: Array, stands: tuple[Integers, ...], stand_share: Array) -> Sampling:
    """Sampling for circle angles (n,) rad of laps in order of time."""
    laps, grid = _laps(phi), np.arange(GRID) * 2 * np.pi / GRID
    number, turned = _number(phi, laps), phi % (2 * np.pi)
    before, after, share = np.empty((3, laps, GRID))
    for lap in range(laps):
        rows = np.flatnonzero(number == lap)
        order = rows[np.argsort(turned[rows])]
        angle = turned[order]
        later = np.searchsorted(angle, grid) % len(angle)
        step = (angle[later] - angle[later - 1]) % (2 * np.pi)
        part = ((grid - angle[later - 1]) % (2 * np.pi)) / np.where(step > 0, step, 1.0)
        before[lap], after[lap], share[lap] = order[later - 1], order[later], np.clip(part, 0, 1)
    # The trend is the change between laps, normalised to length 1.
    weights = np.arange(laps) - (laps - 1) / 2
    trend = weights / np.linalg.norm(weights) if laps > 1 else np.empty(0)
    return Sampling(before.astype(np.intp), after.astype(np.intp), share, phi, stands, stand_share, trend)


def _number(phi: Array, laps: int) -> Array:
    return np.asarray(np.minimum(np.abs(phi - phi[0]) // (2 * np.pi), laps - 1), dtype=float)
