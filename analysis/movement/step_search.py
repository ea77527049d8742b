"""Detection of a step in the readings of a placement: between two runs, or from some row on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun, parts
from analysis.diagnosis.evidence.setups import fit_setups
from analysis.diagnosis.evidence.significance import SURE_SIGMA
from analysis.movement.cause_odds import CauseOdds, causes_by_odds
from analysis.movement.causes import LEVELS, Cause
from analysis.movement.evidence import Conditioned, LinearReadings, condition
from analysis.movement.inference import MOST_MM, NAMED, Reference, ReferenceComparison, compare, study
from analysis.movement.linearise import causes_of, constants_count, evenly, linearise, selected, shift_of, workplace
from analysis.robot.kinematics.arm import Array, Integers

_FEWEST = 3
"""Minimum number of readings after a movement; fewer may be outliers."""
_FEWEST_BEFORE = 10
"""Minimum number of readings before a movement, which determine arm and set-ups well enough."""
_MOST_AFTER = 20
"""Maximum number of readings after a movement, evenly selected, used to examine it."""
_LOG_ODDS = 12.0
"""Minimum gain of log evidence for a step to be examined. Chosen: a hundred readings and ten causes give a thousand
possible steps, so an unexpected step must be certain.
"""


@dataclass(frozen=True)
class MovementStep:
    """A change from a given reading on: index of the first reading after it in time order, and the parts that moved.
    is_joint: the likeliest cause is a pair or triple.
    """

    first: int
    found: tuple[CauseOdds, ...]
    is_joint: bool


def find_step(runs: Sequence[ObservedRun], order: Integers) -> MovementStep | None:
    """The first movement among runs of places with common set-ups, if any. order (m,): position in time of each
    reading.
    """
    if len(order) < _FEWEST_BEFORE + _FEWEST:
        return None
    first = _likeliest(runs, order)
    if first is None:
        return None
    before = parts(runs, order < first)
    if earlier := find_step(before, order[order < first]):
        return earlier
    reference = study(before)
    known = {run.setup for run in reference.runs}
    after, of_after = parts(runs, order >= first), order[order >= first]
    while (later := _likeliest(after, of_after)) is not None:
        after, of_after = parts(after, of_after < later), of_after[of_after < later]
    after = [run for run in after if run.setup in known]
    count = sum(len(run.rows) for run in after)
    if count < _FEWEST:
        return None
    new = parts(after, evenly(count, _MOST_AFTER))
    compared = compare(reference, new)
    likeliest, found = next(iter(compared.posterior.probability)), _moved_parts(reference, compared)
    if not found or compared.distance_mm > MOST_MM:
        return None
    members = likeliest.members or (likeliest,)
    columns = np.concatenate([compared.shifts[member].columns for member in members], axis=1)
    moves_mm = np.abs(columns @ compared.posterior.estimates[likeliest].mean).max()
    # Smaller changes, such as drift with temperature, are covered by other effects of a diagnosis.
    is_large = moves_mm > SURE_SIGMA * reference.scatter_mm
    return MovementStep(first, found, is_joint=len(members) > 1) if is_large else None


def _moved_parts(reference: Reference, compared: ReferenceComparison) -> tuple[CauseOdds, ...]:
    """The parts of the likeliest cause that moved at odds of 20 to 1, alone or together with any others."""
    likeliest = causes_by_odds(reference, compared)[0]
    probability = compared.posterior.probability
    moved = [
        replace(part, posterior=sum(p for cause, p in probability.items() if part.cause in (cause, *cause.members)))
        for part in likeliest.together or (likeliest,)
    ]
    return tuple(part for part in moved if part.posterior >= NAMED and part.what not in ("nothing", "other"))


def _likeliest(runs: Sequence[ObservedRun], order: Integers) -> int | None:
    """Position of the first reading after the likeliest step; None if no step gains enough evidence."""
    kept, begins = selected(runs), np.cumsum([0, *(len(run.rows) for run in runs)]).tolist()
    rows = [
        begin + np.searchsorted(run.samples, short.samples)
        for run, short, begin in zip(runs, kept, begins, strict=False)
    ]
    place = workplace(runs[0].model, kept, fit_setups(kept), np.zeros(constants_count(runs[0].model.arm)))
    readings = linearise(kept, place)
    columns = {cause: shift_of(kept, place, cause).columns for cause in causes_of(kept)}
    gains = _gains(readings, condition(readings), columns, order[np.concatenate(rows)][readings.row])
    best = max(gains, key=lambda position: gains[position], default=None)
    return best if best is not None and gains[best] > _LOG_ODDS else None


def _gains(
    readings: LinearReadings, conditioned: Conditioned, columns: dict[Cause, Array], time: Integers
) -> dict[int, float]:
    """Largest gain of log evidence over all causes for a step at each position.

    The scatter is varied downwards, because the estimate from all readings contains the step.
    """
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
    """Gain of log evidence of columns (n, m) for readings (n,), integrated over scatters and sizes. Both are given in
    the principal directions of the noise, with variances (n,).
    """
    white, seen = turned / np.sqrt(variance)[:, None], y / np.sqrt(variance)
    inner, projected = white.T @ white, white.T @ seen
    values, vectors = np.linalg.eigh(inner)  # once for all levels
    full = 1.0 + LEVELS[:, None] ** 2 * np.maximum(values, 0.0)
    explained = LEVELS**2 * ((vectors.T @ projected) ** 2 / full).sum(axis=1) / float(seen @ seen)
    logs = -0.5 * len(y) * np.log1p(-np.minimum(explained, 1 - 1e-9)) - 0.5 * np.log(full).sum(axis=1)
    return float(np.logaddexp.reduce(logs) - np.log(len(logs)))
