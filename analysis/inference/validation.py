"""Validation: what a frozen model leaves of runs used and left out, and the model that is handed over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.inference.blocks import Block, blocks_of
from analysis.inference.observation import ObservedRun, residual_of, rms, without_socket
from analysis.inference.placements import reach_mm
from analysis.inference.refine import slopes_of
from analysis.inference.responses import basis_of, limits_um, linearise, noise_um, rms_um
from analysis.inference.result import Gap, TestGap
from analysis.inference.search import SearchResult
from analysis.inference.setups import FittedRuns, fit_run_setups, neighbourhoods, with_effects
from analysis.inference.state import background_effects
from analysis.kinematics.arm import Array, Integers
from analysis.model.predict import SetUp
from rigs.effects import Effect

# ----------------------------------------------------------------------------------------------------------------------
# Validation: what a frozen model leaves of the runs used, of held-out runs, and of runs at another place.


@dataclass(frozen=True)
class FrozenModel:
    """A model that is held against runs: the effects that it adds to the rig file, and the set-ups that fit the runs
    used with them."""

    effects: tuple[Effect, ...]
    setups: Mapping[str, SetUp]

    def residuals(self, runs: Sequence[ObservedRun]) -> list[Array]:
        """Return the residuals (m, k) mm of each run. Runs in a set-up that was used keep it; the others have their own
        fitted."""
        modelled = with_effects(runs, self.effects)
        setups = self.setups_with(modelled)
        return [residual_of(run.on_lap, setups) for run in modelled]

    def setups_with(self, runs: Sequence[ObservedRun]) -> dict[str, SetUp]:
        """Return its set-ups, and those of runs with its effects, of (m, k) mm, that are in none of them."""
        new = [run for run in runs if run.setup not in self.setups]
        return {**self.setups, **(fit_run_setups(new)[0] if new else {})}


@dataclass(frozen=True)
class Stages:
    """The models that are held against runs, one after the other: without what was found, with the names, and
    calibrated."""

    bare: FrozenModel
    named: FrozenModel
    calibrated: FrozenModel

    @property
    def has_background(self) -> bool:
        """Whether the calibrated model has more than the names."""
        return self.calibrated.effects != self.named.effects

    def names_alone(self) -> Stages:
        """Return these models with the names in place of the whole one."""
        return replace(self, calibrated=self.named)


def stages_of(fitted: FittedRuns, result: SearchResult) -> Stages:
    """Return the models of a search, with set-ups fitted to the runs used, of (m, k) mm. Where what was found beside
    the names explains these runs worse than the names alone, the calibrated model has the names alone."""
    names = result.effects
    whole = (*names, *background_effects(result.calibrated_posterior))
    bare, named, calibrated = (FrozenModel(effects, fitted.beside(effects)[0]) for effects in ((), names, whole))
    is_worse = rms(fitted.beside(whole)[1]) > rms(fitted.beside(names)[1])
    return Stages(bare, named, named if is_worse else calibrated)


def gap(runs: Sequence[ObservedRun], stages: Stages, result: SearchResult, run_names: Sequence[str]) -> Gap:
    """Return the gap of runs without what was found, with the names, and calibrated; residuals are (m, k) mm.

    The noise and scatter of one of the runs come from repeats, or else from the assumed noise; that of touches, and of
    many poses, as far as the readings show it. Runs of another place have that of their test.
    """
    bare, named, calibrated = (model.residuals(runs) for model in (stages.bare, stages.named, stages.calibrated))
    before, after, calibrated_um = (1e3 * rms(residuals) for residuals in (bare, named, calibrated))
    tests = []
    for test in dict.fromkeys(run.table.test for run in runs):
        um = []
        for residuals in (bare, calibrated):
            of_test = [mm for run, mm in zip(runs, residuals, strict=True) if run.table.test == test]
            sizes = [np.linalg.norm(mm, axis=1) if mm.shape[1] == 3 else np.abs(mm) for mm in of_test]
            um += [1e3 * rms(of_test), 1e3 * max(float(size.max()) for size in sizes)]
        tests.append(TestGap(test, *um))
    keeps = all(run.setup in stages.calibrated.setups for run in runs)
    blocks, same_names = result.linear.blocks, {run.name for run in runs}
    alike = [block.name in same_names for block in blocks]
    if not any(alike):
        same_tests = {run.table.test for run in runs}
        alike = [block.table.test in same_tests for block in blocks]
    size = np.array([len(block.rows) * block.count for block in blocks]) * (alike if any(alike) else 1)
    floor = float(np.sqrt(size @ (_noise_shown(result) * noise_um(result.linear) ** 2) / size.sum()))
    return Gap(tuple(run_names), before, after, floor, calibrated_um, tuple(tests), keeps)


@dataclass(frozen=True)
class Widening:
    """How far places that had no part in a model are missed beyond what it states: the `factor` by which its
    uncertainty grows, at least 1, and what is as much everywhere, unexplained_mm of one coordinate; None where no
    places judge it. It holds up to reach_mm from the sockets touched, None unless all runs are of touches."""

    factor: float = 1.0
    unexplained_mm: float | None = None
    reach_mm: float | None = None


@dataclass(frozen=True)
class _Missed:
    """What neighbourhoods of places (g,) were missed by, a coordinate's mean square in mm²; of it the noise of their
    readings, and the variance that the model states there."""

    missed: Array
    noise: Array
    stated: Array
    weight: Array

    @cached_property
    def _fitted(self) -> tuple[float, Array]:
        """The excess over the noise as a multiple of the variance stated, and one standard error more: of few
        neighbourhoods it is known badly, which how much they differ says; and how much each counts (g,). Those that are
        missed by twice what all others are, as one placement of nine, count less: u is what most places need."""
        weight, count = self.weight, len(self.weight)
        ratio = error = 0.0
        for _ in range(_ROUNDS):
            excess, stated = weight * (self.missed - self.noise), weight * self.stated
            ratio = float(excess.sum() / stated.sum())
            error = float(np.sqrt(count / max(count - 1, 1)) * np.linalg.norm(excess - ratio * stated) / stated.sum())
            expected = max(ratio, 1.0) * self.stated + self.noise
            weight = self.weight * np.minimum(1.0, _FAR * expected / np.maximum(self.missed, 1e-12))
        return ratio + error, weight

    @property
    def ratio(self) -> float:
        """The factor by which the variance stated is too small."""
        return self._fitted[0]

    def widening(self) -> Widening:
        """Return what makes the variance stated as much larger on the mean as the ratio says: a factor, something that
        is as much everywhere, or both, each as likely as its share makes the neighbourhoods.

        A factor grows where little was measured, as what a model does not know does; what no form of it can be, a cable
        or a play, does not.
        """
        ratio, weight = max(self.ratio, 1.0), self._fitted[1]
        mean = float(weight @ self.stated / weight.sum())
        even = np.linspace(0.0, 1.0, 21)[:, None] * (ratio - 1) * mean
        expected = (ratio - even / mean) * self.stated + even + self.noise
        fits = -0.5 * _FREEDOM * (np.log(expected) + self.missed / expected) @ (weight / self.weight)
        odds = np.exp(fits - fits.max())
        likely = float(odds @ even[:, 0] / odds.sum())
        return Widening(float(np.sqrt(max(ratio - likely / mean, 1.0))), float(np.sqrt(likely)))


_FAR, _ROUNDS = 4.0, 8
"""Mean square over that expected from which a neighbourhood counts less: of three normal coordinates less than one in a
hundred is so far. And rounds until that has settled."""
_FREEDOM = 3.0
"""Degrees of freedom of what a neighbourhood is missed by: one vector, which its poses share."""


def widening(
    left_out: LeftOut,
    judges: Sequence[ObservedRun],
    elsewhere: Sequence[ObservedRun],
    stages: Stages,
    result: SearchResult,
) -> Widening:
    """Return how far places are missed beyond what the calibrated model states: by the largest of the ratios of places
    used, each neighbourhood (`left_out`), and each placement, left out in its turn; of those that were held out; of
    runs elsewhere.

    A model that is smooth where an arm is not, or the same in postures, on days, or about placements where it is not,
    misses places by more than its covariance allows for. Residuals are (m, k) mm.
    """
    sets = [_missed_of(left_out.sums) if len(left_out.rows) else None, _missed_by_placement(result)]
    setups = dict(stages.calibrated.setups)
    for runs in (judges, elsewhere):
        places = [run for run in runs if run.table.kind.of_places]
        setups |= stages.calibrated.setups_with(with_effects(places, stages.calibrated.effects))
        sets.append(_missed_by(places, setups, stages, result) if places else None)
    judging = [missed for missed in sets if missed is not None and missed.stated.any()]
    wider = max(judging, key=lambda missed: missed.ratio).widening() if judging else Widening()
    tables = [run.table for run in (*result.linear.blocks, *judges, *elsewhere)]
    of_sockets = all(table.kind.frame_terms == 3 for table in tables)
    return replace(wider, reach_mm=reach_mm(setups, stages.calibrated.setups) if of_sockets else None)


@dataclass(frozen=True)
class LeftOut:
    """Places used, each neighbourhood left out in its turn: the whitened rows (n,) of the readings, their
    neighbourhood, what the model of all others misses them by, in standard deviations of the noise and squared in mm²,
    how much of the square is noise, and what is stated. Wild readings count as little as in the fit, `robust`."""

    rows: Integers
    group: Integers
    missed: Array
    missed_mm2: Array
    noise_mm2: Array
    stated_mm2: Array
    robust: Array

    @property
    def sums(self) -> Array:
        """Sums over the entries of each neighbourhood (g, 4), as `_missed_of` takes them."""
        entry = self.robust * np.stack([self.missed_mm2, self.noise_mm2, self.stated_mm2, np.ones(len(self.rows))])
        return np.array([entry[:, self.group == number].sum(axis=1) for number in np.unique(self.group).tolist()])


def places_left_out(result: SearchResult) -> LeftOut:
    """Return each neighbourhood of the poses used as all others predict it; empty where there are no poses."""
    linear, parts, first = result.linear, list[LeftOut](), 0
    for block, of_block in zip(linear.blocks, linear.rows, strict=True):
        if block.table.kind.of_places:
            group = _neighbourhoods(block)
            for number in np.unique(group).tolist():
                rows = of_block.start + np.flatnonzero(group == number)
                parts.append(_left_out(result, rows, np.full(len(rows), first + number)))
            first += int(group.max()) + 1
    return _together(parts)


def _together(parts: Sequence[LeftOut]) -> LeftOut:
    number, value = np.zeros(0, dtype=np.int64), np.zeros(0)
    none = LeftOut(number, number, value, value, value, value, value)
    return LeftOut(*(np.concatenate([getattr(part, name) for part in (none, *parts)]) for name in vars(none)))


def _missed_by_placement(result: SearchResult) -> _Missed | None:
    """Return by how much the model of all others misses each placement of the poses used, its set-up fitted to it, by
    neighbourhood; None where there are not two. Long series are not left out, only the others predicted by them."""
    linear, left_out, first = result.linear, list[LeftOut](), 0
    blocks = [k for k, block in enumerate(linear.blocks) if block.table.kind.of_places]
    placement = {k: without_socket(linear.blocks[k].setup) for k in blocks}
    names = sorted(set(placement.values()))
    for name in names if len(names) > 1 else ():
        parts = [k for k in blocks if placement[k] == name]
        rows = np.concatenate([np.arange(linear.rows[k].start, linear.rows[k].stop) for k in parts])
        group = np.concatenate([_neighbourhoods(linear.blocks[k]) for k in parts])
        terms = sorted({term for k in parts for term in linear.terms[linear.blocks[k].setup]})
        if len(terms) < len(rows) < _LONGEST:
            left_out.append(_left_out(result, rows, first + group, basis_of(linear.U[rows][:, terms])))
            first += int(group.max()) + 1
    return _missed_of(_together(left_out).sums) if left_out else None


_LONGEST = 1500
"""Readings of a placement from which it is not left out: their covariance is inverted, in a second."""


def _left_out(result: SearchResult, rows: Integers, group: Integers, placed: Array | None = None) -> LeftOut:
    """Return whitened rows (n,), left out together: without what `placed`, orthonormal columns (n, s) of a set-up,
    takes up."""
    posterior = result.calibrated_posterior
    noise = np.minimum(result.strength[rows], 1.0)
    variance_mm2 = np.concatenate([block.sd_mm for block in result.linear.blocks])[rows] ** 2
    missed, covariance = posterior.left_out(rows)
    if placed is not None:
        missed, covariance = missed - placed @ (placed.T @ missed), covariance - placed @ (placed.T @ covariance)
        covariance -= (covariance @ placed) @ placed.T
    stated = np.maximum(np.diag(covariance), 0.0) * variance_mm2
    robust = result.state.robust[rows]
    return LeftOut(rows, group, missed, missed**2 * variance_mm2, noise * variance_mm2, stated, robust)


def _neighbourhoods(run: ObservedRun) -> Integers:
    """Return the neighbourhood of each entry (n,) of places."""
    return np.repeat(neighbourhoods(run.table.q[run.rows], np.random.default_rng(0)), 3)


def _missed_by(
    runs: Sequence[ObservedRun], setups: Mapping[str, SetUp], stages: Stages, result: SearchResult
) -> _Missed:
    """Return by how much the calibrated model misses neighbourhoods of runs of places that had no part in it, in the
    set-ups of the runs used, or in their own."""
    groups, shown = [], _noise_shown(result)
    for run, calibrated in zip(runs, with_effects(runs, stages.calibrated.effects), strict=True):
        residual = residual_of(calibrated, setups)
        noise, variance = _stated_variances(run, setups, result)
        alike = [block.table.test == run.table.test for block in result.linear.blocks]
        noise = noise * (shown[alike].mean() if any(alike) else 1.0)
        group = _neighbourhoods(run)
        entry = np.stack([run.entries(residual) ** 2, noise, variance, np.ones_like(noise)])
        groups += [entry[:, group == number].sum(axis=1) for number in np.unique(group).tolist()]
    return _missed_of(np.array(groups))


def _missed_of(sums: Array) -> _Missed:
    """Return neighbourhoods (g, 4) of sums over their entries: squares missed, of noise and stated, and weights."""
    weight = sums[:, 3]
    missed, noise, stated = sums[:, :3].T / weight
    return _Missed(missed, noise, stated, weight)


def _stated_variances(run: ObservedRun, setups: Mapping[str, SetUp], result: SearchResult) -> tuple[Array, Array]:
    """Return the variances (N,) mm² of the noise of a run of poses, and of what the calibrated model predicts for its
    entries: in the set-up of the runs used, or in one of its own, which takes up what it can."""
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
    covariance = result.calibrated_posterior.joint_covariance(count, len(unknowns))
    variance = np.einsum("np,np->n", change @ covariance, change)
    noise: Array = of_run.blocks[0].sd_mm ** 2
    return noise, np.maximum(variance, 0.0) * noise


def held_out_gains(result: SearchResult, runs: Sequence[ObservedRun]) -> list[float | None]:
    """Return, for each name, the share of the gap's energy on held-out runs that it removes beside everything else that
    was found, or None where no held-out run shows it beyond the scatter of one run.

    The set-up is fitted again to each run; a healthy arm's share of every effect is taken from the runs used. Residuals
    are (m, k) mm.
    """
    whole, gained, shown = 0.0, np.zeros(len(result.contributions)), np.zeros(len(result.contributions), dtype=bool)
    setups = result.linear.setups_moved_by(result.moves)
    for run in runs:
        judged = _at_places_used(result, run) or _at_other_places(result, run, setups)
        residual = judged.residual - judged.free_share
        after = judged.energy(residual)
        whole += judged.energy(judged.before)
        gained += [judged.energy(residual + change) - after for change in judged.contributions]
        shown |= np.array([judged.shows(change) for change in judged.contributions], dtype=bool)
    return [float(gain / whole) if is_shown else None for gain, is_shown in zip(gained, shown, strict=True)]


@dataclass(frozen=True)
class _JudgedRun:
    """One run judged by the names and the healthy share that other runs determined, in standard deviations of a block
    (N,).

    `before` is the residual without them and `residual` that with all of them. `free_share` is what free forms add
    beside them, zero where that is not known. `contributions` are the changes when each name is removed.
    `basis` (N, s) is orthonormal and spans what the set-up could absorb. `limit_um` is the rms change from which a name
    is material beside the scatter of one run.
    """

    block: Block
    before: Array
    residual: Array
    free_share: Array
    contributions: Sequence[Array]
    basis: Array
    limit_um: float

    def without_set_up(self, values: Array) -> Array:
        """Return whitened values (N,) with the part removed that the set-up could absorb."""
        return values - self.basis @ (self.basis.T @ values)

    def energy(self, values: Array) -> float:
        """Return the energy in mm² of values (N,), with the set-up fitted."""
        return float(((self.without_set_up(values) * self.block.sd_mm) ** 2).sum())

    def shows(self, change: Array) -> bool:
        """Return whether a change of the readings (N,) is material beside the scatter of one run, with the set-up
        fitted."""
        return rms_um(self.block, self.without_set_up(change) * self.block.sd_mm) > self.limit_um


def _at_places_used(result: SearchResult, run: ObservedRun) -> _JudgedRun | None:
    """Return a run at places where runs of its kind were used, or None where there are none or where its periods of
    standing differ from theirs."""
    linear = result.linear
    kinds = [(block.name, block.targets_key) for block in linear.blocks]
    kind = (run.name, run.targets_key)
    if kind not in kinds or run.model.rig != linear.blocks[kinds.index(kind)].model.rig:
        return None
    k = kinds.index(kind)
    block, rows = linear.blocks[k], linear.rows[k]
    sampling = run.sampling
    if sampling and block.sampling:
        sampling = replace(
            sampling if block.sampling.stands else sampling.without_stands(), bridged=block.sampling.bridged
        )
        sampling = sampling if len(block.sampling.trend) else sampling.without_trend()
    (with_names,) = with_effects([run], result.effects)
    # Where the set-ups fit the names, and back along their slopes, as the names were fitted.
    residual = residual_of(with_names, linear.setups_moved_by(result.moves))
    run_entries = replace(run, sampling=sampling).entries(residual)
    if len(run_entries) != len(block.y_mm):
        return None
    whitened = block.white(run_entries) + linear.U[rows] @ result.moves
    before = whitened + (linear.residual(()) - result.fit.residual)[rows]
    changes = [change[rows] for change in result.contributions]
    residual_with_share = whitened - result.posterior.healthy_share[rows]
    free, limit = result.free_share[rows], float(result.scatter_limits_um[k])
    return _JudgedRun(block, before, residual_with_share, free, changes, basis_of(linear.U[rows]), limit)


def _at_other_places(result: SearchResult, run: ObservedRun, setups: Mapping[str, SetUp]) -> _JudgedRun:
    """Return a run at places, or in a way, that no run used has: other poses, another radius, another speed."""
    effects = result.effects
    placed = setups if run.setup in setups else fit_run_setups(with_effects([run], effects))[0]
    of_run = linearise(blocks_of([run], placed, effects), placed, effects)
    share, residual = result.columns.forms_in(of_run), of_run.residual(effects)
    changes = of_run.contributions(effects, residual)
    with_share = residual - share @ result.posterior.mean[: share.shape[1]]
    (block,), none, limit = of_run.blocks, np.zeros_like(with_share), float(limits_um(of_run)[0])
    return _JudgedRun(block, of_run.residual(()), with_share, none, changes, basis_of(of_run.U), limit)


def residual_um(runs: Sequence[ObservedRun], used: FittedRuns, effects: Sequence[Effect]) -> float:
    """Return the rms residual (m, k) of runs with some effects alone, in µm: what their remedy alone leaves. As in the
    gap, runs in a set-up of the runs used keep it, and others have their own."""
    return 1e3 * rms(FrozenModel(tuple(effects), used.beside(effects)[0]).residuals(runs))


_SHOW_NOISE = 20
"""Poses that show their own noise, of which a set-up and an arm take some. Source: 24 poses of an independent generator
with noise of 21.5 µm show 17.5, 50 with 51 show 44, 47 with 39 show 36; assumed were 71."""


def shows_noise(block: Block) -> bool:
    """Return whether readings (m, k) show their own noise without repeats: touches, or enough poses."""
    return block.table.kind.of_places and (block.table.kind.constants_apart or len(block.rows) >= _SHOW_NOISE)


def _noise_shown(result: SearchResult) -> Array:
    """Return which share of the variance of its noise the readings of each block (b,) show, at the most all."""
    linear, strength = result.linear, result.strength
    blocks = zip(linear.blocks, linear.rows, strict=True)
    return np.array([min(float(strength[rows].mean()), 1.0) if shows_noise(block) else 1.0 for block, rows in blocks])
