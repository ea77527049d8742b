"""Prediction errors of the calibrated model at held-out places: widening of u, and dependence of the remaining error.

Each neighbourhood of poses is held out in turn and predicted by the model of all others. The prediction error is
compared with possible dependences that no named effect has: posture, direction of joint motion, time, temperature. Each
dependence is an error of every joint, fitted to all neighbourhoods except one and evaluated there. The explained share
therefore refers to independent places, and a dependence with no predictive power is not reported.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import Self

import numpy as np

from analysis.diagnosis.evidence.blocks import Block, blocks_of
from analysis.diagnosis.evidence.observation import ObservedRun, residual_of, without_socket
from analysis.diagnosis.evidence.placements import reach_mm
from analysis.diagnosis.evidence.setups import GROUPS, neighbourhoods, with_effects
from analysis.diagnosis.fit.refine import slopes_of
from analysis.diagnosis.fit.responses import basis_of, linearise
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.judge.remains import ResidualCheck, ResidualSummary, Subject
from analysis.diagnosis.judge.validation import Stages, noise_shown
from analysis.procedures.shared.test_kind import facts_of
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.model.predict import SetUp

# ----------------------------------------------------------------------------------------------------------------------
# Places held out of a model: of other runs, and of the runs used.


@dataclass(frozen=True)
class Misses:
    """Errors at held-out places, by entry (n,): neighbourhood, squared error in mm², noise part, and stated variance.

    Outliers have the reduced weight `robust` of the fit.
    """

    group: Integers
    missed_mm2: Array
    noise_mm2: Array
    stated_mm2: Array
    robust: Array

    @classmethod
    def together(cls, parts: Sequence[Self]) -> Self:
        """Concatenate parts."""
        names = [field.name for field in fields(cls)]
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


@dataclass(frozen=True)
class LeftOut(Misses):
    """Places used, each neighbourhood or placement held out in turn and predicted by the others.

    It contains the whitened rows (n,) of the readings and their errors in noise standard deviations.
    """

    rows: Integers
    missed_sigma: Array

    @property
    def rms_um(self) -> float:
        """Root mean square prediction error of positions, in µm."""
        return 1e3 * float(np.sqrt(3 * np.average(self.missed_mm2, weights=self.robust)))


def places_left_out(result: SearchResult) -> LeftOut | None:
    """Return the prediction of each neighbourhood of the poses used from all others; None if no poses were used."""
    linear, parts, first = result.linear, list[LeftOut](), 0
    for block, of_block in zip(linear.blocks, linear.rows, strict=True):
        if facts_of(block.table.test).of_places:
            group = _neighbourhoods(block)
            for number in np.unique(group).tolist():
                rows = of_block.start + np.flatnonzero(group == number)
                parts.append(_left_out(result, rows, np.full(len(rows), first + number)))
            first += int(group.max()) + 1
    return LeftOut.together(parts) if parts else None


def _left_out(result: SearchResult, rows: Integers, group: Integers, placed: Array | None = None) -> LeftOut:
    """Return whitened rows (n,) held out together, after removal of the part absorbed by `placed`, orthonormal
    set-up columns (n, s).
    """
    posterior = result.calibrated_posterior
    noise = np.minimum(result.strength[rows], 1.0)
    variance_mm2 = np.concatenate([block.sd_mm for block in result.linear.blocks])[rows] ** 2
    missed, covariance = posterior.left_out(rows)
    if placed is not None:
        missed, covariance = missed - placed @ (placed.T @ missed), covariance - placed @ (placed.T @ covariance)
        covariance -= (covariance @ placed) @ placed.T
    stated = np.maximum(np.diag(covariance), 0.0) * variance_mm2
    robust = result.state.robust[rows]
    return LeftOut(
        group=group, missed_mm2=missed**2 * variance_mm2, noise_mm2=noise * variance_mm2, stated_mm2=stated,
        robust=robust, rows=rows, missed_sigma=missed,
    )  # fmt: skip


def _neighbourhoods(run: ObservedRun) -> Integers:
    """Return the number of the neighbourhood of similar postures (n,) for each measured coordinate."""
    return np.repeat(neighbourhoods(run.table.q[run.rows], np.random.default_rng(0)), 3)


# ----------------------------------------------------------------------------------------------------------------------
# Widening: ratio of the prediction errors to the stated uncertainty.

_FAR, _ROUNDS = 4.0, 8
"""Mean square relative to the expectation above which a neighbourhood has reduced weight, exceeded for three normal
coordinates in fewer than 1 % of cases; and number of rounds to convergence.
"""
_FREEDOM = 3.0
"""Degrees of freedom of the error of a neighbourhood: a vector common to its poses."""
_FEWEST_GROUPS = 4
"""Minimum number of neighbourhoods: three leave too little for a fit. Source: of 18 sound arms with 10 or 12 poses,
which form two, six were reported to have an unknown cause.
"""
_LONGEST = 1500
"""Number of readings above which a placement is not held out: inverting their covariance takes a second."""


_WITHIN = 0.9545
"""Probability of a normal error within two standard uncertainties."""
_LEAST_FREEDOM = 3
"""Smallest degrees of freedom of the factor. Chosen: under 20 places, typical sizes determine most of the model."""


@dataclass(frozen=True)
class Widening:
    """Excess of prediction errors at held-out places over the stated uncertainty.

    `factor`: multiplies the uncertainty, at least 1. unexplained_mm: constant contribution per coordinate; None if
    there are no validation places. reach_mm: largest validated distance from the touched sockets, None unless all runs
    are touches. neighbourhoods: number of places that determine the excess. beyond_mm: error per coordinate beyond the
    noise and the stated uncertainty.
    """

    factor: float = 1.0
    unexplained_mm: float | None = None
    reach_mm: float | None = None
    neighbourhoods: int = 0
    beyond_mm: float = 0.0

    @property
    def unexplained_um(self) -> float:
        """The constant contribution as an rms distance in µm; 0 if too few places show more than an upper limit."""
        return 1e3 * math.sqrt(3) * (self.unexplained_mm or 0.0) * (self.neighbourhoods >= _FEWEST_GROUPS)

    @property
    def beyond_um(self) -> float:
        """The whole excess as an rms distance in µm; 0 if too few places show more than an upper limit."""
        return 1e3 * math.sqrt(3) * self.beyond_mm * (self.neighbourhoods >= _FEWEST_GROUPS)


@dataclass(frozen=True)
class _Neighbourhoods:
    """Errors of neighbourhoods (g,): mean square of a coordinate in mm², noise part, variance stated by the model,
    and weight of the entries.
    """

    missed_mm2: Array
    noise_mm2: Array
    stated_mm2: Array
    weight: Array

    @classmethod
    def of(cls, misses: Misses) -> _Neighbourhoods:
        """Return the means over the entries of each neighbourhood."""
        group, ones = misses.group, np.ones(len(misses.group))
        entries = misses.robust * np.stack([misses.missed_mm2, misses.noise_mm2, misses.stated_mm2, ones])
        sums = np.array([entries[:, group == number].sum(axis=1) for number in np.unique(group).tolist()])
        weight = sums[:, 3]
        missed, noise, stated = sums[:, :3].T / weight
        return cls(missed, noise, stated, weight)

    @cached_property
    def _ratio_and_weight(self) -> tuple[float, Array]:
        """The excess over the noise as a multiple of the stated variance, and the weight (g,) of each neighbourhood.

        Neighbourhoods with twice the error of the others, such as one placement of nine, have reduced weight: u
        describes most places.
        """
        weight, count = self.weight, len(self.weight)
        ratio = error = 0.0
        for _ in range(_ROUNDS):
            excess, stated = weight * (self.missed_mm2 - self.noise_mm2), weight * self.stated_mm2
            ratio = float(excess.sum() / stated.sum())
            error = float(np.sqrt(count / max(count - 1, 1)) * np.linalg.norm(excess - ratio * stated) / stated.sum())
            expected = max(ratio, 1.0) * self.stated_mm2 + self.noise_mm2
            weight = self.weight * np.minimum(1.0, _FAR * expected / np.maximum(self.missed_mm2, 1e-12))
        # With few neighbourhoods the ratio is uncertain, as their differences show. A standard error is added to reach
        # the upper end of the range.
        return ratio + error, weight

    @property
    def ratio(self) -> float:
        """Factor by which the stated variance is too small."""
        return self._ratio_and_weight[0]

    def parted(self) -> Widening:
        """Split the excess into a factor and a constant contribution, each with the likelihood from the neighbourhoods.

        A factor is largest for sparsely measured regions, like gaps in the model. Errors outside the forms of the
        model, such as a cable or backlash, do not follow this pattern.
        """
        ratio, weight = max(self.ratio, 1.0), self._ratio_and_weight[1]
        mean = float(weight @ self.stated_mm2 / weight.sum())
        even = np.linspace(0.0, 1.0, 21)[:, None] * (ratio - 1) * mean
        expected = (ratio - even / mean) * self.stated_mm2 + even + self.noise_mm2
        fits = -0.5 * _FREEDOM * (np.log(expected) + self.missed_mm2 / expected) @ (weight / self.weight)
        odds = np.exp(fits - fits.max())
        likely = float(odds @ even[:, 0] / odds.sum())
        factor = float(np.sqrt(max(ratio - likely / mean, 1.0)))
        excess = float(weight @ (self.missed_mm2 - self.noise_mm2 - self.stated_mm2) / weight.sum())
        beyond_mm = math.sqrt(max(excess, 0.0))
        return Widening(factor, float(np.sqrt(likely)), neighbourhoods=len(weight), beyond_mm=beyond_mm)


def widening_of(
    left_out: LeftOut | None,
    judges: Sequence[ObservedRun],
    elsewhere: Sequence[ObservedRun],
    stages: Stages,
    result: SearchResult,
) -> Widening:
    """Return the excess of prediction errors over the stated uncertainty of the calibrated model.

    It is the largest of three ratios: for the places used, with each neighbourhood (`left_out`) and each placement held
    out in turn; for held-out runs; and for runs elsewhere. The covariance assumes a model that is smooth enough and an
    arm that behaves equally in all postures, on all days and at all placements. Otherwise the errors are larger than it
    states. Residuals are (m, k) mm.
    """
    sets: list[Misses | None] = [left_out, _placements_left_out(result)]
    setups = dict(stages.calibrated.setups)
    for runs in (judges, elsewhere):
        places = [run for run in runs if facts_of(run.table.test).of_places]
        setups |= stages.calibrated.setups_with(with_effects(places, stages.calibrated.effects))
        sets.append(_misses_of(places, setups, stages, result) if places else None)
    judging = [_Neighbourhoods.of(misses) for misses in sets if misses is not None]
    judging = [neighbourhoods for neighbourhoods in judging if neighbourhoods.stated_mm2.any()]
    wider = max(judging, key=lambda places: places.ratio).parted() if judging else Widening()
    of_sockets = all(facts_of(run.table.test).frame_terms == 3 for run in (*result.linear.blocks, *judges, *elsewhere))
    only_places = all(facts_of(block.table.test).of_places for block in result.linear.blocks)
    if left_out is not None and only_places and result.linear.blocks[0].model.rig.calibrated is None:
        least = factor_of_few_places(len(np.unique(left_out.group)))
        wider = replace(wider, factor=max(wider.factor, least))
    return replace(wider, reach_mm=reach_mm(setups, stages.calibrated.setups) if of_sockets else None)


def factor_of_few_places(neighbourhoods: int) -> float:
    """Return the smallest factor that a number of neighbourhoods supports: Student's t over 2 for 95.45 % (GUM, Annex
    G.3); 1 from 20 on, where it adds less than 7 %.

    Few neighbourhoods can agree with the model by chance: of 31 tables of 20 to 35 poses of measured arms, the ratio
    was 1 in 17, and there only 90 % of the errors elsewhere were within 2 u (docs/evidence/world.md).
    """
    from scipy.stats import t as student  # noqa: PLC0415 - slow to import

    if neighbourhoods >= GROUPS:
        return 1.0
    return float(student.ppf((1 + _WITHIN) / 2, max(neighbourhoods - 1, _LEAST_FREEDOM))) / 2


def _placements_left_out(result: SearchResult) -> LeftOut | None:
    """Return the prediction of each placement of the poses used from all others, with the set-up fitted; None below two
    placements.

    Long series are used for prediction but not held out.
    """
    linear, parts, first = result.linear, list[LeftOut](), 0
    blocks = [k for k, block in enumerate(linear.blocks) if facts_of(block.table.test).of_places]
    placement = {k: without_socket(linear.blocks[k].setup) for k in blocks}
    names = sorted(set(placement.values()))
    for name in names if len(names) > 1 else ():
        placed = [k for k in blocks if placement[k] == name]
        rows = np.concatenate([np.arange(linear.rows[k].start, linear.rows[k].stop) for k in placed])
        group = np.concatenate([_neighbourhoods(linear.blocks[k]) for k in placed])
        terms = sorted({term for k in placed for term in linear.terms[linear.blocks[k].setup]})
        if len(terms) < len(rows) < _LONGEST:
            parts.append(_left_out(result, rows, first + group, basis_of(linear.U[rows][:, terms])))
            first += int(group.max()) + 1
    return LeftOut.together(parts) if parts else None


def _misses_of(
    runs: Sequence[ObservedRun], setups: Mapping[str, SetUp], stages: Stages, result: SearchResult
) -> Misses:
    """Return the prediction errors of the calibrated model for held-out runs, in the set-ups of the runs used or in
    separately fitted set-ups.
    """
    parts, first, shown = list[Misses](), 0, noise_shown(result)
    for run, calibrated in zip(runs, with_effects(runs, stages.calibrated.effects), strict=True):
        residual = residual_of(calibrated, setups)
        noise, variance = _stated_variances(run, setups, result)
        alike = [block.table.test == run.table.test for block in result.linear.blocks]
        noise = noise * (shown[alike].mean() if any(alike) else 1.0)
        group = first + _neighbourhoods(run)
        parts.append(Misses(group, run.entries(residual) ** 2, noise, variance, np.ones_like(noise)))
        first = int(group.max()) + 1
    return Misses.together(parts)


def _stated_variances(run: ObservedRun, setups: Mapping[str, SetUp], result: SearchResult) -> tuple[Array, Array]:
    """Return the variances (N,) mm² of the noise of a pose run, and of the calibrated model's prediction: in the
    set-up of the runs used, or in a separately fitted set-up.
    """
    effects, columns, unknowns = result.effects, result.columns, result.fit.unknowns
    of_run = linearise(blocks_of([run], setups, effects), setups, effects)
    of_effect = [[unknown for unknown in unknowns if unknown.effect == k] for k in range(len(effects))]
    slopes = [slopes_of(of_run, *both) for both in zip(effects, of_effect, strict=True)]
    change = np.concatenate([*slopes, columns.forms_in(of_run)], axis=1)
    count = columns.set_ups.start
    if run.setup in result.linear.terms:
        placed = np.zeros((len(of_run.y), columns.set_ups.stop - columns.set_ups.start))
        placed[:, result.linear.terms[run.setup]] = of_run.U[:, of_run.terms[run.setup]]
        change, count = np.concatenate([change, placed], axis=1), columns.set_ups.stop
    else:
        basis = basis_of(of_run.U)
        change -= basis @ (basis.T @ change)
    covariance = result.covariance(count)
    variance = np.einsum("np,np->n", change @ covariance, change)
    noise: Array = of_run.blocks[0].sd_mm ** 2
    return noise, np.maximum(variance, 0.0) * noise


# ----------------------------------------------------------------------------------------------------------------------
# Remaining error of the poses used, and its dependences.

_UNIT_RAD = np.radians(1e-3)
"""Unit of a joint error. It has no influence on the result, because the strength is scaled."""
_STRENGTHS = 4.0 ** np.arange(-8, 7)
"""Squares of a form's strength in this unit, from a 256th of a unit to 64; the best is used."""
_Functions = Callable[[Block], Array]


def remains_of(result: SearchResult, left_out: LeftOut | None, temperature: Array | None) -> ResidualSummary | None:
    """Return the remaining error of held-out places; None if no places were held out.

    temperature (n,): in °C of the rows of a single table, None if unknown.
    """
    linear = result.linear
    if left_out is None or len(np.unique(left_out.group)) < _FEWEST_GROUPS:
        return None
    warmth: Array | None = None
    tables = [block.table for block in linear.blocks if facts_of(block.table.test).of_places]
    if temperature is not None and len(set(map(id, tables))) == 1 and np.ptp(temperature) > 0:
        warmth = ((temperature - temperature.mean()) / np.ptp(temperature))[:, None]
    # Possible dependences as functions (n, c) rad at a block's samples, None if not available.
    subjects: dict[Subject, _Functions | None] = {
        "posture": _of_places(lambda block: np.concatenate([f(block.table.q) for f in (np.cos, np.sin)], axis=1)),
        "approach": _of_places(sides_of) if any(table.sides is not None for table in tables) else None,
        "time": None,  # tables of places have no times, and their row order is no time order
        "temperature": None if warmth is None else _of_places(lambda _: warmth),
        "speed": None,  # undefined for a stationary robot
    }
    off = np.sqrt(left_out.robust) * left_out.missed_sigma
    looked = []
    for subject, functions in subjects.items():
        share = None
        if functions is not None:
            axes = [linear.by_joint(axis, functions)[left_out.rows] for axis in range(1, linear.axes + 1)]
            weighted = np.sqrt(left_out.robust)[:, None] * np.concatenate(axes, axis=1)
            share = share_left_out(weighted, off, left_out.group)
        looked.append(ResidualCheck(subject, share))
    noise_um = 1e3 * float(np.sqrt(3 * np.average(left_out.noise_mm2, weights=left_out.robust)))
    return ResidualSummary(left_out.rms_um, noise_um, tuple(looked))


def _of_places(of_rows: Callable[[Block], Array]) -> _Functions:
    """Convert functions of table rows (n, c) to functions of the samples of a block's path; zero for circles."""

    def functions(block: Block) -> Array:
        samples = len(block.path.q)
        if not facts_of(block.table.test).of_places:
            return np.zeros((samples, of_rows(block).shape[1]))
        values = _UNIT_RAD * of_rows(block)
        return np.repeat(values, samples // len(values), axis=0)

    return functions


def sides_of(block: Block) -> Array:
    """Return the approach direction (n, axes) of each joint as a sign; zero if unknown."""
    sides = block.table.sides
    return np.zeros(block.table.q.shape) if sides is None else sides.astype(float)


def share_left_out(columns: Array, off: Array, group: Integers) -> float:
    """Return the share of the square of a residual (n,) explained by columns (n, c) in cross-validation over groups
    (n,).

    The strength with the largest share is used. 0 if no strength explains any of it.
    """
    order = np.argsort(group, kind="stable")
    ends = [0, *(np.flatnonzero(np.diff(group[order])) + 1).tolist(), len(order)]
    groups = [order[begin:end] for begin, end in pairwise(ends)]
    normal, right = columns.T @ columns, columns.T @ off
    squares = np.zeros(len(_STRENGTHS))
    for rows in groups:
        of_group = columns[rows]
        power, turn = np.linalg.eigh(normal - of_group.T @ of_group)
        seen = turn.T @ (right - of_group.T @ off[rows])
        fitted = seen / (np.maximum(power, 0.0) + 1 / _STRENGTHS[:, None])
        squares += ((off[rows] - fitted @ (of_group @ turn).T) ** 2).sum(axis=1)
    return max(1 - float(squares.min() / (off @ off)), 0.0)
