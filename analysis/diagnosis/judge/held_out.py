"""Residuals at held-out places, and the widening of the model's uncertainty that they require."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from analysis.diagnosis.evidence.blocks import blocks_of
from analysis.diagnosis.evidence.observation import ObservedRun, residual_of, without_socket
from analysis.diagnosis.evidence.placements import reach_mm
from analysis.diagnosis.evidence.setups import GROUPS, FittedRuns, neighbourhoods, with_effects
from analysis.diagnosis.fit.refine import slopes_of
from analysis.diagnosis.fit.responses import basis_of, linearise
from analysis.diagnosis.fit.search import SearchResult
from analysis.procedures.shared.quantity import student_factor
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.predict import SetUps
from rigs.effects import Effect

# ----------------------------------------------------------------------------------------------------------------------
# Residuals at places held out of a model: of other runs, and of the runs used.


@dataclass(frozen=True)
class HeldOut:
    """Residuals at held-out places, by entry (n,): coordinates of positions."""

    group: Integers
    """Neighbourhood."""
    residual_mm: Array
    sd_mm: Array
    """Standard deviation of the noise in the fit."""
    noise_mm2: Array
    """Variance of the noise, as far as the readings show it."""
    stated_mm2: Array
    """Variance of the prediction according to the model."""
    robust: Array
    """Weight, reduced for outliers of the fit."""
    rows: Integers
    """Whitened rows of the readings used; empty for runs with no part in the fit."""

    @property
    def is_enough(self) -> bool:
        """Whether the neighbourhoods are enough to validate a model."""
        return len(np.unique(self.group)) >= FEWEST_GROUPS

    @property
    def whitened(self) -> Array:
        return self.residual_mm / self.sd_mm

    @property
    def rms_um(self) -> float:
        """RMS distance of a position from its prediction."""
        return 1e3 * float(np.sqrt(3 * np.average(self.residual_mm**2, weights=self.robust)))

    @property
    def rms_u_um(self) -> float:
        """Standard uncertainty of `rms_um`, as far as the neighbourhoods differ."""
        return self.rms_um / math.sqrt(2 * _FREEDOM * len(np.unique(self.group)))

    @property
    def noise_um(self) -> float:
        """Noise of a position, rms distance."""
        return 1e3 * float(np.sqrt(3 * np.average(self.noise_mm2, weights=self.robust)))


def held_out_places(result: SearchResult) -> HeldOut | None:
    """Predict each neighbourhood of the poses used from all others; None if no poses were used."""
    sets = []
    for block, rows in zip(result.linear.blocks, result.linear.rows, strict=True):
        if block.facts.of_places:
            group = _neighbourhoods(block)
            members = [np.flatnonzero(group == number) for number in np.unique(group)]
            sets += [(rows.start + each, group[each], np.empty((len(each), 0))) for each in members]
    return _predicted(result, sets)


def _held_out_placements(result: SearchResult) -> HeldOut | None:
    """Predict each placement of the poses used from all others, with the set-up fitted; None below two placements. Long
    series are not held out.
    """
    linear = result.linear
    placements: dict[str, list[int]] = {}
    for k, block in enumerate(linear.blocks):
        if block.facts.of_places:
            placements.setdefault(without_socket(block.setup), []).append(k)
    sets = []
    for placed in placements.values() if len(placements) > 1 else ():
        rows = np.concatenate([np.arange(linear.rows[k].start, linear.rows[k].stop) for k in placed])
        group = np.concatenate([_neighbourhoods(linear.blocks[k]) for k in placed])
        terms = sorted({term for k in placed for term in linear.terms[linear.blocks[k].setup]})
        if len(terms) < len(rows) < _LONGEST:
            sets.append((rows, group, basis_of(linear.U[rows][:, terms])))
    return _predicted(result, sets)


def _predicted(result: SearchResult, sets: Sequence[tuple[Integers, Integers, Array]]) -> HeldOut | None:
    """Predict sets of whitened rows, the rows of each held out together; None if there is no set.

    sets: rows (n,), their neighbourhoods (n,), and orthonormal columns (n, s) of the set-up that is fitted to them.
    """
    parts, posterior = [], result.calibrated_posterior
    sd_mm = np.concatenate([block.sd_mm for block in result.linear.blocks])
    for rows, group, placed in sets:
        residual, covariance = posterior.prediction_errors(rows)
        residual = residual - placed @ (placed.T @ residual)
        for _ in range(2):  # symmetric
            covariance = (covariance - placed @ (placed.T @ covariance)).T
        sd, variance = sd_mm[rows], sd_mm[rows] ** 2
        parts.append(
            HeldOut(
                group, residual * sd, sd, np.minimum(result.strength[rows], 1.0) * variance,
                np.maximum(np.diag(covariance), 0.0) * variance, result.state.robust[rows], rows,
            )
        )  # fmt: skip
    return _together(parts) if parts else None


def _together(parts: Sequence[HeldOut]) -> HeldOut:
    ends = np.cumsum([0, *(1 + np.ptp(part.group) for part in parts)])
    apart = [replace(part, group=part.group - part.group.min() + end) for part, end in zip(parts, ends, strict=False)]
    return HeldOut(*(np.concatenate([getattr(part, field.name) for part in apart]) for field in fields(HeldOut)))


def _neighbourhoods(run: ObservedRun) -> Integers:
    """Number of the neighbourhood of similar postures (n,) for each measured coordinate."""
    return np.repeat(neighbourhoods(run.table.q[run.rows], np.random.default_rng(0)), 3)


# ----------------------------------------------------------------------------------------------------------------------
# Widening: ratio of the residuals at held-out places to the stated uncertainty.

_FAR, _ROUNDS = 4.0, 8
"""Mean square relative to the expectation above which a neighbourhood has reduced weight, and number of rounds to
convergence. Normal coordinates exceed it in fewer than 1 % of cases.
"""
_FREEDOM = 3.0
"""Degrees of freedom of the error of a neighbourhood: a vector common to its poses."""
FEWEST_GROUPS = 6
"""Minimum number of neighbourhoods that show an unexplained error: those of 18 poses. Source: of 18 sound arms with 10
to 16 poses, four were reported to have an unknown cause.
"""
_FEWEST_FOR_FACTOR = 4
"""Number of neighbourhoods below which Student's factor does not increase further: usual sizes determine most of the
model."""
_LONGEST = 1500
"""Number of readings above which a placement is not held out: inverting their covariance takes a second."""


@dataclass(frozen=True)
class Widening:
    """Excess of residuals at held-out places over the stated uncertainty."""

    factor: float = 1.0
    """Multiplies the uncertainty, at least 1."""
    unexplained_mm: float | None = None
    """Constant contribution per coordinate; None if there are no validation places."""
    reach_mm: float | None = None
    """Largest validated distance from the touched sockets; None unless all runs are touches."""
    neighbourhoods: int = 0
    """Number of places that determine the excess."""
    beyond_mm: float = 0.0
    """Error per coordinate beyond the noise and the stated uncertainty."""

    @property
    def unexplained_um(self) -> float:
        """The constant contribution as an rms distance; 0 if too few places show more than an upper limit."""
        return 1e3 * math.sqrt(3) * (self.unexplained_mm or 0.0) * (self.neighbourhoods >= FEWEST_GROUPS)

    @property
    def beyond_um(self) -> float:
        """The whole excess as an rms distance; 0 if too few places show more than an upper limit."""
        return 1e3 * math.sqrt(3) * self.beyond_mm * (self.neighbourhoods >= FEWEST_GROUPS)


@dataclass(frozen=True)
class _Neighbourhoods:
    """Residuals of neighbourhoods (g,): mean square of a coordinate, noise part, variance stated by the model, and
    weight.
    """

    square_mm2: Array
    noise_mm2: Array
    stated_mm2: Array
    weight: Array

    @classmethod
    def of(cls, held_out: HeldOut) -> _Neighbourhoods:
        _, number = np.unique(held_out.group, return_inverse=True)
        weight = np.asarray(np.bincount(number, held_out.robust), dtype=float)
        values = (held_out.residual_mm**2, held_out.noise_mm2, held_out.stated_mm2)
        square, noise, stated = (np.bincount(number, held_out.robust * value) / weight for value in values)
        return cls(square, noise, stated, weight)

    @cached_property
    def ratio_and_weight(self) -> tuple[float, Array]:
        """Excess over the noise as a multiple of the stated variance, and the weight (g,) of each neighbourhood.

        Neighbourhoods with twice the error of the others, such as one placement of nine, have reduced weight.
        """
        weight, count = self.weight, len(self.weight)
        ratio = error = 0.0
        for _ in range(_ROUNDS):
            excess, stated = weight * (self.square_mm2 - self.noise_mm2), weight * self.stated_mm2
            ratio = float(excess.sum() / stated.sum())
            error = float(np.sqrt(count / max(count - 1, 1)) * np.linalg.norm(excess - ratio * stated) / stated.sum())
            expected = max(ratio, 1.0) * self.stated_mm2 + self.noise_mm2
            weight = self.weight * np.minimum(1.0, _FAR * expected / np.maximum(self.square_mm2, 1e-12))
        # With few neighbourhoods the ratio is uncertain, as their differences show. A standard error is added to reach
        # the upper end of the range.
        return ratio + error, weight

    def parted(self) -> Widening:
        """Split the excess into a factor and a constant contribution, by their likelihood.

        A factor is largest for sparsely measured regions, like gaps in the model. Errors outside the forms of the
        model, such as a cable, do not follow this pattern. Few neighbourhoods do not show it: the excess is then a
        factor, which further readings reduce.
        """
        ratio, weight = max(self.ratio_and_weight[0], 1.0), self.ratio_and_weight[1]
        mean = float(weight @ self.stated_mm2 / weight.sum())
        even = np.linspace(0.0, 1.0, 21)[:, None] * (ratio - 1) * mean
        expected = (ratio - even / mean) * self.stated_mm2 + even + self.noise_mm2
        fits = -0.5 * _FREEDOM * (np.log(expected) + self.square_mm2 / expected) @ (weight / self.weight)
        odds = np.exp(fits - fits.max())
        likely = float(odds @ even[:, 0] / odds.sum()) if len(weight) >= FEWEST_GROUPS else 0.0
        factor = float(np.sqrt(max(ratio - likely / mean, 1.0)))
        excess = float(weight @ (self.square_mm2 - self.noise_mm2 - self.stated_mm2) / weight.sum())
        beyond_mm = math.sqrt(max(excess, 0.0))
        return Widening(factor, float(np.sqrt(likely)), neighbourhoods=len(weight), beyond_mm=beyond_mm)


def widening_of(
    of_used: HeldOut | None,
    judges: Sequence[ObservedRun],
    elsewhere: Sequence[ObservedRun],
    fitted: FittedRuns,
    calibrated: Sequence[Effect],
    result: SearchResult,
) -> Widening:
    """Excess of prediction errors over the stated uncertainty of the calibrated model.

    It is the largest of three ratios: for the places used, with each neighbourhood (`of_used`) and each placement held
    out in turn; for held-out runs; and for runs elsewhere. The covariance assumes an arm that behaves equally in all
    postures, on all days and at all placements.
    """
    sets: list[HeldOut | None] = [of_used, _held_out_placements(result)]
    setups = used_setups = fitted.fit_with_effects(calibrated)[0]
    for runs in (judges, elsewhere):
        places = [run for run in runs if run.facts.of_places]
        setups = setups | fitted.setups_for(places, calibrated)
        sets.append(_at_runs(places, setups, calibrated, result) if places else None)
    judging = [_Neighbourhoods.of(each) for each in sets if each is not None and each.stated_mm2.any()]
    wider = max(judging, key=lambda places: places.ratio_and_weight[0]).parted() if judging else Widening()
    of_sockets = all(run.facts.frame_terms == 3 for run in (*result.linear.blocks, *judges, *elsewhere))
    only_places = all(block.facts.of_places for block in result.linear.blocks)
    if of_used is not None and only_places and result.linear.blocks[0].model.rig.calibrated is None:
        least = factor_of_few_places(len(np.unique(of_used.group)))
        wider = replace(wider, factor=max(wider.factor, least))
    return replace(wider, reach_mm=reach_mm(setups, used_setups) if of_sockets else None)


def factor_of_few_places(neighbourhoods: int) -> float:
    """Smallest factor that a number of neighbourhoods supports (GUM, Annex G.3); 1 from 20 on, where Student's t adds
    less than 7 %. Few neighbourhoods can agree by chance (docs/evidence/world.md).
    """
    return 1.0 if neighbourhoods >= GROUPS else student_factor(max(neighbourhoods, _FEWEST_FOR_FACTOR) - 1)


def _at_runs(runs: Sequence[ObservedRun], setups: SetUps, effects: Sequence[Effect], result: SearchResult) -> HeldOut:
    """Residuals of the calibrated model at held-out runs, in the set-ups of the runs used or in separately
    fitted ones.
    """
    parts, shown = [], result.noise_shown
    for run, calibrated in zip(runs, with_effects(runs, effects), strict=True):
        residual_mm = run.entries(residual_of(calibrated, setups))
        noise, variance = _stated_variances(run, setups, result)
        alike = [block.table.test == run.table.test for block in result.linear.blocks]
        shown_noise = noise * (shown[alike].mean() if any(alike) else 1.0)
        group, none = _neighbourhoods(run), np.empty(0, dtype=np.intp)
        parts.append(HeldOut(group, residual_mm, np.sqrt(noise), shown_noise, variance, np.ones_like(noise), none))
    return _together(parts)


def _stated_variances(run: ObservedRun, setups: SetUps, result: SearchResult) -> tuple[Array, Array]:
    """Variances (N,) mm² of the noise of a pose run, and of the calibrated model's prediction."""
    effects, columns, unknowns = result.effects, result.columns, result.fit.unknowns
    of_run = linearise(blocks_of([run], setups, effects), setups, effects)
    of_effect = [[unknown for unknown in unknowns if unknown.effect == k] for k in range(len(effects))]
    slopes = [slopes_of(of_run, *both) for both in zip(effects, of_effect, strict=True)]
    of_forms = of_run.columns([effect for form in columns.forms for effect in form.effects]) / columns.sizes
    change = np.concatenate([*slopes, of_forms], axis=1)
    if run.setup in result.linear.terms:
        placed = np.zeros((len(of_run.y), columns.set_ups.stop - columns.set_ups.start))
        placed[:, result.linear.terms[run.setup]] = of_run.U[:, of_run.terms[run.setup]]
        change = np.concatenate([change, placed], axis=1)
    else:
        change = of_run.without_set_up(change)
    count = change.shape[1]
    variance = np.einsum("np,np->n", change @ result.covariance[:count, :count], change)
    noise: Array = of_run.blocks[0].sd_mm ** 2
    return noise, np.maximum(variance, 0.0) * noise
