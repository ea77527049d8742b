"""A movement among runs that should share a set-up: between which runs, or from which row on.

All readings of one placement are taken in order. A step of each cause is tried from each reading on, by its evidence
beside the constants of the arm and the set-ups, which are fitted to all readings at the same time. The likeliest step
is then judged as `rig moved` judges it: the readings before it are the reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun, parts
from analysis.diagnosis.evidence.setups import fit_setups
from analysis.movement.causes import LEVELS, Cause
from analysis.movement.evidence import Conditioned, LinearReadings, condition
from analysis.movement.inference import MOST_MM, compare, study
from analysis.movement.linearise import causes_of, constants_count, linearise, selected, shift_of, workplace
from analysis.movement.result import CauseOdds, moved_of
from analysis.robot.kinematics.arm import Array, Integers

_FEWEST = 3
"""Readings after a movement, fewer of which are a wild reading or two."""
_FEWEST_BEFORE = 10
"""Readings before a movement, from which arm and set-ups are known well enough."""
_MOST_AFTER = 20
"""Readings after a movement by which it is judged, evenly chosen."""
_LOG_ODDS = 12.0
"""Smallest gain of log evidence of a step that is examined. Chosen: a hundred readings and ten causes have a thousand
steps, and an unexpected step has to be certain."""
_TIMES_SCATTER = 3.0
"""Smallest effect on a reading, in multiples of the scatter: what is smaller, as drift with the temperature, has causes
of its own in a diagnosis."""


@dataclass(frozen=True)
class Step:
    """A change from one reading on: the index of the first reading after it, in order, with what moved."""

    first: int
    found: CauseOdds


def find_step(runs: Sequence[ObservedRun], order: Integers) -> Step | None:
    """Return the movement among runs of places that should share their set-ups; None if nothing moved. `order` (m,) is
    the position in time of each reading of all runs, one after the other."""
    if len(order) < _FEWEST_BEFORE + _FEWEST:
        return None
    first = _likeliest(runs, order)
    if first is None:
        return None
    before, after = parts(runs, order < first), parts(runs, order >= first)
    reference = study(before)
    known = {run.setup for run in reference.runs}
    new = _thinned([run for run in after if run.setup in known])
    if sum(len(run.rows) for run in new) < _FEWEST:
        return None
    compared = compare(reference, new)
    if compared.distance_mm > MOST_MM:
        return None
    found = moved_of(reference, compared).named
    if found is None or found.what in ("nothing", "other", "pair"):
        return None
    moves_mm = np.abs(compared.shifts[found.cause].columns @ compared.posterior.estimates[found.cause].mean).max()
    return Step(first, found) if moves_mm > _TIMES_SCATTER * reference.scatter_mm else None


def _thinned(runs: Sequence[ObservedRun]) -> list[ObservedRun]:
    total = sum(len(run.rows) for run in runs)
    keep = np.zeros(total, dtype=bool)
    keep[np.unique(np.linspace(0, total - 1, min(total, _MOST_AFTER)).astype(int))] = True
    return parts(runs, keep)


def _likeliest(runs: Sequence[ObservedRun], order: Integers) -> int | None:
    """Return the position of the first reading after the likeliest step; None if no step gains enough."""
    kept, positions = selected(runs), _selected_positions(runs, order)
    place = workplace(runs[0].model, kept, fit_setups(kept), np.zeros(constants_count(runs[0].model.arm)))
    readings = linearise(kept, place)
    time = positions[readings.row]
    causes = causes_of(kept)
    columns = {cause: shift_of(kept, place, cause).columns for cause in causes}
    gains = _gains(readings, condition(readings), columns, time)
    best = max(gains, key=lambda position: gains[position], default=None)
    return best if best is not None and gains[best] > _LOG_ODDS else None


def _selected_positions(runs: Sequence[ObservedRun], order: Integers) -> Integers:
    """Return the positions of the readings that `selected` keeps."""
    numbered, begin = [], 0
    for run, short in zip(runs, selected(runs), strict=True):
        rows = np.searchsorted(run.samples, short.samples)
        numbered.append(order[begin + rows])
        begin += len(run.rows)
    return np.concatenate(numbered)


def _gains(
    readings: LinearReadings, conditioned: Conditioned, columns: dict[Cause, Array], time: Integers
) -> dict[int, float]:
    """Return for each position the largest gain of log evidence of a step of a cause from there on. The scatter is the
    smallest that the readings allow beside a step: that of all of them contains the step."""
    likeliest = conditioned.likeliest
    positions = np.unique(time)[_FEWEST_BEFORE : 1 - _FEWEST]
    unit = readings.sd_mm[:, None]
    y = likeliest.vectors.T @ (readings.residual / readings.sd_mm)
    gains: dict[int, float] = {}
    for position in positions.tolist():
        step = (time >= position)[:, None]
        for cause, whole in columns.items():
            turned = likeliest.vectors.T @ (whole * step / unit * cause.scale)
            gain = max(_gain(y, turned, likeliest.values + (share * likeliest.scatter) ** 2) for share in (1.0, 0.3))
            gains[position] = max(gains.get(position, 0.0), gain)
    return gains


def _gain(y: Array, turned: Array, variance: Array) -> float:
    """Return the gain of log evidence, over scatters and sizes, of columns (n, m) beside readings (n,), both in the
    directions in which the noise has these variances (n,)."""
    white, seen = turned / np.sqrt(variance)[:, None], y / np.sqrt(variance)
    inner, projected = white.T @ white, white.T @ seen
    count, left = len(y), float(seen @ seen)
    logs = []
    for level in LEVELS.tolist():
        full = level**2 * inner + np.eye(len(inner))
        explained = level**2 * float(projected @ np.linalg.solve(full, projected))
        gain = -0.5 * count * np.log1p(-min(explained / left, 1 - 1e-9))
        logs.append(gain - 0.5 * float(np.linalg.slogdet(full)[1]))
    return float(np.logaddexp.reduce(logs) - np.log(len(logs)))
