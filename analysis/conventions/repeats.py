"""Circles whose gauges are exchanged or negated relative to their repeats, because of swapped cables or columns.

An exchange does not change the mean of the gauges, and it reverses the sign of their difference. Another sign reverses
both. A ball that was moved changes both as well, but only in the first order of the circle: the sign of both is judged
by the higher ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from analysis.conventions.finding import Finding, Misfit
from analysis.conventions.gauge_order import ORDER, SIGN
from analysis.kinematics.arm import Array
from analysis.noise.readings import rms
from analysis.traces.laps import laps_of
from analysis.traces.loading import Measured
from analysis.traces.tables import CircleTable
from rigs.errors import FileError

GRID = 256
"""Circle angles to which laps are interpolated, so that they can be compared."""
_LEAST_MM = 0.05
"""Smallest difference from the repeats that is examined: joints of real cells repeat to 0.005°, which moves gauges 50
mm apart by 0.01 mm, and the limit is five times that."""
_CLEAR = 4.0
"""Factor by which the difference must fit better with its sign reversed, and by which the mean must fit better
unchanged. Chosen: far from the factor of 1 that noise gives."""


@dataclass(frozen=True)
class Lap:
    """A circle run on the grid: mean and difference of its gauges (GRID,) mm, without their own means."""

    run: Measured
    mean: Array
    apart: Array

    @property
    def place(self) -> tuple[object, ...]:
        """What runs share that see one ball: the test, the circle and the placement."""
        manifest = self.run.run.manifest
        return (manifest.test, manifest.placement, self.run.rig.tests.circle, self.run.rig.robot)


def laps_on_grid(runs: Iterable[Measured]) -> list[Lap]:
    """The circle runs with two gauges, on the grid; those that hold no lap are reported where they are analysed."""
    laps_of_runs = []
    for run in runs:
        with suppress(FileError):
            if isinstance(run.table, CircleTable) and run.table.g_mm.shape[1] == 2:
                laps = laps_of(run.table, run.rig, str(run.path))
                g_mm = gridded(laps.phi, laps.g_mm)
                g_mm -= g_mm.mean(axis=0)
                laps_of_runs.append(Lap(run, g_mm.mean(axis=1), g_mm[:, 1] - g_mm[:, 0]))
    return laps_of_runs


def gridded(phi: Array, values: Array) -> Array:
    """Values (n, k) at circle angles phi (n,) rad as their means (GRID, k) about the angles of the grid; between
    neighbours where there are none."""
    place = np.round(phi * GRID / (2 * np.pi)).astype(int) % GRID
    count = np.bincount(place, minlength=GRID)
    filled = np.flatnonzero(count)
    means = [np.bincount(place, column, GRID)[filled] / count[filled] for column in values.T]
    return np.stack([np.interp(np.arange(GRID), filled, mean, period=GRID) for mean in means], axis=1)


def repeat_findings(runs: Sequence[Measured]) -> Iterator[Finding]:
    """Which runs contradict their repeats. Where two equal halves of the repeats contradict each other, it is the half
    that contradicts the circles of the other direction."""
    laps = laps_on_grid(runs)
    groups: dict[tuple[object, ...], list[Lap]] = {}
    for lap in laps:
        direction = lap.run.run.manifest.direction
        group_of_lap = next(
            (group for (way, *_), group in groups.items() if way == direction and group[0].place == lap.place), None
        )
        if group_of_lap is None:
            groups[(direction, len(groups))] = [lap]
        else:
            group_of_lap.append(lap)
    for group in groups.values():
        direction = group[0].run.run.manifest.direction
        reverse = [lap for lap in laps if lap.place == group[0].place and lap.run.run.manifest.direction != direction]
        yield from _contradicting(group, reverse)


def _contradicting(repeats: Sequence[Lap], reverse: Sequence[Lap]) -> Iterator[Finding]:
    """The repeats whose difference has the opposite sign to that of most of them."""
    mean, apart = np.array([lap.mean for lap in repeats]), np.array([lap.apart for lap in repeats])
    sign = np.where(np.linalg.eigh(apart @ apart.T)[1][:, -1] < 0, -1.0, 1.0)
    if abs(sign.sum()) > 0:
        sign *= np.sign(sign.sum())
    elif reverse:
        sign *= np.sign(float((sign @ apart) @ sum(lap.apart for lap in reverse))) or 1.0
    else:
        return
    most = sign > 0
    usual, usual_apart = mean[most].mean(axis=0), apart[most].mean(axis=0)
    for k in np.flatnonzero(~most).tolist():
        as_labelled, as_meant = rms(apart[k] - usual_apart), rms(apart[k] + usual_apart)
        if as_labelled > max(_LEAST_MM, _CLEAR * as_meant, _CLEAR * rms(mean[k] - usual)):
            yield _finding(repeats[k], as_labelled, as_meant, negated=False)
            continue
        spectra = np.fft.rfft(np.stack([apart[k], usual_apart, mean[k], usual]))
        spectra[:, 1] = 0.0  # where the ball is
        shapes = np.fft.irfft(spectra, n=len(usual))
        as_labelled, as_meant = (
            np.hypot(rms(shapes[0] - shapes[1]), rms(shapes[2] - shapes[3])),
            np.hypot(rms(shapes[0] + shapes[1]), rms(shapes[2] + shapes[3])),
        )
        if as_labelled > max(_LEAST_MM, _CLEAR * as_meant):
            yield _finding(repeats[k], float(as_labelled), float(as_meant), negated=True)


def _finding(lap: Lap, as_labelled: float, as_meant: float, *, negated: bool) -> Finding:
    name = lap.run.run.manifest.name
    misfit = Misfit(as_labelled, as_meant, GRID / 4 * float(np.log(as_labelled / max(as_meant, 1e-6))))
    if negated:
        what = "compared with its repeats, its gauges g1 and g2 count the other way"
        remedy = "give counts: towards in its rig file, or import it with both signs changed"
        return Finding(SIGN, "decisive", ("g1_mm", "g2_mm"), "g1 and g2 negated", what, remedy, misfit, (name,))
    what = "compared with its repeats, its gauges g1 and g2 are exchanged"
    remedy = "check the cables, or import it with the columns exchanged"
    return Finding(ORDER, "decisive", ("g1_mm", "g2_mm"), "g1 and g2 exchanged", what, remedy, misfit, (name,))
