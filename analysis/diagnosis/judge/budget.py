"""Error budget with shares that add up to 1, and the size of a named effect in each set-up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.diagnosis.evidence.observation import GRID, ORDER_OF
from analysis.diagnosis.evidence.setups import BALL_PRIOR_MM
from analysis.diagnosis.evidence.significance import ODDS, POSSIBLE_SIGMA
from analysis.diagnosis.fit.background import CoefficientPosterior
from analysis.diagnosis.fit.candidates import LARGEST_FAULT, Form
from analysis.diagnosis.fit.responses import Linearisation, Response, basis_of, rms_by_block
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.fit.selection_state import FAULT, combined_effect, least_fault
from analysis.diagnosis.judge.budget_part import LARGE_SHARE, BudgetPart, GroupMember, Rank
from analysis.diagnosis.judge.named import Named, Share
from analysis.diagnosis.judge.result import Gap
from analysis.robot.kinematics.arm import Array, Integers
from rigs.effects import Effect
from rigs.schema.effect import PartKind, healthy, label_of, scaled, size_field, size_of

# ----------------------------------------------------------------------------------------------------------------------
# Budget: all parts of the gap between model and readings, with shares adding up to 1.
#
# With the initial residual t of the model and the contribution e_i of part i, both without the parts absorbed by
# set-ups, t = Σ e_i. The share of part i is e_i't / t't = Σ_j e_i'e_j / t't: common contributions of two parts are
# halved. Every test is weighted by its readings, as in the gap.

_CANCELS = 0.005
"""Negative share above which a part is combined with the part it cancels; a smaller negative share counts as zero."""
_MOST_MEMBERS = 3
"""Number of listed group members. Chosen. Their odds refer to all members."""
_INVISIBLE_UM = 1e-3
"""Contribution of a healthy effect below which a multiple of it has no meaning, as for the backlash of a joint that
always approaches from one side.
"""
_BY_JOINT: tuple[PartKind, ...] = ("curve", "reversal")
"""Kinds of parts separate for each joint."""


def group_of(effect: Effect) -> tuple[PartKind, int | None]:
    """Kind of part for small terms of an effect, with the joint if separate per joint."""
    return effect.part, getattr(effect, "axis", None) if effect.part in _BY_JOINT else None


@dataclass(frozen=True)
class GapMeasure:
    """Measure of whitened changes of readings (N,) in µm, as in the gap: rms over the readings of all runs without the
    part absorbed by set-ups, of which the readings alone do not determine the height of the ball above the circle.
    """

    linear: Linearisation

    @cached_property
    def _root(self) -> Array:
        """Factor (N,) of each entry that converts the sum of squares to a mean square in µm²."""
        blocks = self.linear.blocks
        counts = [len(block.sampling.phi if block.sampling else block.rows) * block.count for block in blocks]
        readings = np.array(counts, dtype=float)
        parts = []
        for block, share in zip(blocks, readings / readings.sum(), strict=True):
            factor = np.zeros(len(block.y_mm))
            if block.sampling:
                factor[: len(ORDER_OF)] = 1 / (2 * GRID)
            else:
                factor[:] = (3 if block.facts.of_places else 1) / len(factor)
            parts.append(1e3 * block.sd_mm * np.sqrt(share * factor))
        return self.linear.at_entries(parts)

    @cached_property
    def _absorbs(self) -> tuple[Array, Array]:
        """Set-up responses (N, s), and the projection (s, N) of weighted changes onto them. Balls of circles and
        hemispheres are limited as in the fit of a gap; all other terms are free.
        """
        U = self._root[:, None] * self.linear.U
        whole = self._root * self.linear.residual(())
        kept = whole - basis_of(U) @ (basis_of(U).T @ whole)
        precision = np.zeros(U.shape[1])
        for block, rows in zip(self.linear.blocks, self.linear.rows, strict=True):
            if not block.facts.of_places:
                precision[self.linear.terms[block.setup][:3]] += float(kept[rows] @ kept[rows]) / BALL_PRIOR_MM**2
        return U, np.linalg.pinv(U.T @ U + np.diag(precision), hermitian=True) @ U.T

    def of(self, changes: Array) -> Array:
        """Whitened changes (N, …) as vectors with the mean square in µm² as their sum of squares."""
        weighted = self._root[:, None] * changes if changes.ndim == 2 else self._root * changes
        U, moves = self._absorbs
        return weighted - U @ (moves @ weighted)

    def without_set_up(self, changes: Array) -> Array:
        """The same without the part absorbed by set-ups in noise standard deviations, for plots."""
        _, moves = self._absorbs
        return changes - self.linear.U @ ((moves * self._root) @ changes)

    def residual_mm(self, effects: Sequence[Effect]) -> list[Array]:
        return self.linear.in_mm(self.without_set_up(self.linear.residual(effects)))

    def scatter_mm(self) -> list[Array]:
        """Responses (N, c) mm of each block to a standard deviation of all scatter between runs."""
        return self.linear.in_mm(self.without_set_up(np.concatenate([self.linear.Z, self.linear.stamps], axis=1)))

    def um(self, changes: Array) -> float:
        return float(np.linalg.norm(self.of(changes)))

    def with_free_set_ups_um(self, changes: Array) -> float:
        """RMS in µm of whitened changes (N,) that no term of a set-up absorbs."""
        return float(np.linalg.norm(self._root * self.linear.without_set_up(changes)))


@dataclass(frozen=True)
class EffectChange:
    """Contribution of a fitted effect: `change` (N,) of the whitened readings, its rms, and its ratio to a healthy
    effect, None if that is invisible. `apart`: relative standard uncertainty from differences between single runs
    beyond noise and scatter.
    """

    change: Array
    um: float
    u_um: float
    times_usual: float | None
    apart: float = 0.0


def effect_changes(result: SearchResult) -> list[EffectChange]:
    """Contribution of each fitted effect to the readings, including departures of its form.

    Its uncertainty is that of the contribution: size and shape may be correlated, and the contribution is then as
    certain as the readings show.
    """
    refined, posterior, measure = result.fit, result.posterior, GapMeasure(result.linear)
    T, means, covariance = posterior.terms.T, posterior.term_means, posterior.term_covariance
    allowed = len(refined.unknowns) + np.cumsum([0, *(departure.columns.shape[1] for departure in refined.departures)])
    changes, deflection_um = list[EffectChange](), usual_deflection_um(result, measure)
    for k, effect in enumerate(refined.effects):
        parameters = [j for j, unknown in enumerate(refined.unknowns) if unknown.effect == k]
        departures = list(range(int(allowed[k]), int(allowed[k + 1])))
        change = result.contributions[k] + T[:, departures] @ means[departures]
        columns, um = measure.of(T[:, parameters]), measure.um(change)
        u_um = float(np.sqrt(max(np.sum(columns @ covariance[np.ix_(parameters, parameters)] * columns), 0.0)))
        # as in an arm without a fault, in multiples of its healthy size
        shapes = {shape.field: shape.expected for shape in effect.free(result.linear.payload)}
        as_usual = scaled(healthy(effect), effect.usual_times(result.reference), **shapes)
        usual = measure.um(result.linear.columns([as_usual])[:, 0])
        if is_of_support(effect):
            usual = max(usual, deflection_um)
        apart, times = runs_apart(result, k), um / usual if usual > _INVISIBLE_UM else None
        changes.append(EffectChange(change, um, float(np.hypot(u_um, apart * um)), times, apart))
    return changes


def is_of_support(effect: Effect) -> bool:
    """True for a softness outside the joints, which is compared with the softness of the whole arm: readings hardly
    separate them, and a support that is stiffer than the joints needs no repair.
    """
    return effect.part == "gravity" and effect.DEED == "mount"


def usual_deflection_um(result: SearchResult, measure: GapMeasure) -> float:
    """RMS deflection of the joints of a healthy arm of this build under load, in these readings."""
    joints = [form for form in result.columns.forms if form.effect.part == "gravity" and form.effect.STAGE == "joint"]
    if not joints:
        return 0.0
    indices = np.array([column for form in joints for column in form.columns])
    times = np.array([form.effect.usual_times(result.reference) for form in joints for _ in form.columns])
    moved = measure.of(result.columns.X[:, indices])
    return float(np.sqrt(np.sum(moved**2 @ (result.columns.healthy[indices] * times**2))))


_Drawn = tuple[BudgetPart, Array]
"""A part, and its contribution (N,) as a vector of `GapMeasure.of`."""


@dataclass(frozen=True)
class Budget:
    """Parts of a gap of readings (N,), from a search result."""

    result: SearchResult
    gap: Gap

    @cached_property
    def measure(self) -> GapMeasure:
        return GapMeasure(self.result.linear)

    @cached_property
    def gap_vector(self) -> Array:
        return self.measure.of(self.result.linear.residual(()))

    @cached_property
    def apart_um2(self) -> float:
        """Mean square difference of single runs from the mean of their repeats."""
        return float(np.mean([1 - 1 / block.count for block in self.result.linear.blocks])) * self.gap.noise_floor_um**2

    @cached_property
    def whole_um2(self) -> float:
        """Mean square of the gap: that of the mean of repeated runs plus the differences of single runs from it."""
        return max(float(self.gap_vector @ self.gap_vector) + self.apart_um2, 1e-12)

    def share(self, vector: Array) -> float:
        return float(vector @ self.gap_vector) / self.whole_um2

    def parts(self, named: Sequence[Named], changes: Sequence[EffectChange]) -> list[BudgetPart]:
        """The parts, largest share first; shares add up to 1. named: fitted effects in any order, possibly with a
        vibration that no model removes.
        """
        result, drawn, vibrations = self.result, list[_Drawn](), list[tuple[int, Named]]()
        for place, name in enumerate(named):
            if name.effect not in result.effects:
                vibrations.append((place, name))  # with a new phase in each run
                continue
            change = changes[result.effects.index(name.effect)]
            is_unsure = name.doubt != "usual" or change.um < POSSIBLE_SIGMA * change.u_um
            as_usual: Rank = "usual" if least_fault(name.effect, result.reference) < np.inf else "difference"
            vector = self.measure.of(change.change)
            part = BudgetPart(
                "effect", change.um, change.u_um, self.share(vector), axis=getattr(name.effect, "axis", None),
                name=label_of(name.effect), times_usual=change.times_usual,
                rank="unusual" if name.is_confirmed else "undecided" if is_unsure else as_usual,
                odds=name.probability, held_out_gain=name.held_out_gain, doubt=name.doubt, index=place,
            )  # fmt: skip
            drawn.append((part, vector))
        parts = [part for part, _ in self._without_cancelling([*drawn, *self._groups()])]
        # Residual above the noise, with the unknown causes; the scatter is the rest.
        residual = self.measure.of(result.beyond_noise * result.posterior.residual + result.free_share)
        unexplained = BudgetPart("unexplained", float(np.linalg.norm(residual)), 0.0, self.share(residual))
        scattered = slice(result.columns.set_ups.stop, None)
        moved = result.columns.X[:, scattered] @ result.posterior.mean[scattered]
        inside = self.measure.um((1 - result.beyond_noise) * result.posterior.residual + moved)
        left = 1.0 - sum(part.share for part in [*parts, unexplained])
        for place, name in vibrations:
            of_scatter = min(name.contribution_um**2 / self.whole_um2, max(left, 0.0))
            left -= of_scatter
            part = BudgetPart(
                "effect", name.contribution_um, name.u_um, of_scatter, name=label_of(name.effect),
                rank="unusual" if name.is_confirmed else "usual", odds=name.probability, index=place,
            )  # fmt: skip
            parts.append(part)
        parts += [unexplained, BudgetPart("scatter", float(np.sqrt(inside**2 + self.apart_um2)), 0.0, left)]
        # A slightly negative share becomes zero, and the excess of the others is reduced in proportion.
        shares = [max(part.share, 0.0) for part in parts]
        shared = (replace(part, share=share / sum(shares)) for part, share in zip(parts, shares, strict=True))
        return sorted(shared, key=lambda part: -part.share)

    def _without_cancelling(self, drawn: Sequence[_Drawn]) -> list[_Drawn]:
        """Combine largely cancelling parts, so that no share is negative."""
        kept = list(drawn)
        while len(kept) > 1 and (least := min(kept, key=lambda each: each[0].share))[0].share < -_CANCELS:
            others = [each for each in kept if each is not least]
            partner = min(others, key=lambda each: float(each[1] @ least[1]))
            (part, vector), (cancelled, opposite) = partner, least
            vector = vector + opposite
            both = replace(
                part, um=float(np.linalg.norm(vector)), u_um=max(part.u_um, cancelled.u_um), share=self.share(vector),
                together=(*(part.together or (part,)), *(cancelled.together or (cancelled,))),
            )  # fmt: skip
            kept = [(both, vector) if each is partner else each for each in others]
        return kept

    def _groups(self) -> list[_Drawn]:
        """Combined contribution of the small terms of each kind."""
        columns, groups = self.result.columns, dict[tuple[PartKind, int | None], list[Form]]()
        for form in columns.forms:
            groups.setdefault(group_of(form.effect), []).append(form)
        drawn = []
        for (kind, axis), forms in groups.items():
            indices = np.array([column for form in forms for column in form.columns])
            moved, vector, u_um = self._combined(indices)
            times = np.array([form.effect.usual_times(self.result.reference) for form in forms for _ in form.columns])
            usual_um = float(np.sqrt(np.sum(moved**2 @ (columns.healthy[indices] * times**2))))
            um = float(np.linalg.norm(vector))
            ratio = um / usual_um if usual_um > _INVISIBLE_UM else 0.0
            rank: Rank = "undecided" if um < POSSIBLE_SIGMA * u_um else "unusual" if ratio > FAULT else "usual"
            part = BudgetPart(kind, um, u_um, self.share(vector), axis=axis, times_usual=ratio, rank=rank)
            part = replace(part, members=self._members(forms, vector)) if part.share > LARGE_SHARE else part
            drawn.append((self._with_rank_of_member(part), vector))
        return drawn

    def _with_rank_of_member(self, part: BudgetPart) -> BudgetPart:
        """Rank of a usual group by the size of the member that certainly dominates it: many usual errors together are
        larger than one fault.
        """
        if part.rank != "usual" or part.cause is None:
            return part
        effect, reference = part.cause.effect, self.result.reference
        if abs(size_of(effect)) <= FAULT * effect.usual_times(reference):
            return part
        return replace(part, rank="undecided" if np.isfinite(least_fault(effect, reference)) else "difference")

    def _combined(self, indices: Integers) -> tuple[Array, Array, float]:
        """Changes (N, n) by columns, their sum (N,) at the means, and its standard uncertainty in µm."""
        posterior, moved = self.result.posterior, self.measure.of(self.result.columns.X[:, indices])
        u_um = float(np.sqrt(max(np.sum(moved.T @ moved * posterior.covariance_among(indices)), 0.0)))
        return moved, moved @ posterior.mean[indices], u_um

    def _members(self, forms: Sequence[Form], group: Array) -> tuple[GroupMember, ...]:
        """Possible members of a `group` (N,), likeliest first, each in its best form and with its contribution among
        the small terms. The odds include the case of no dominant member.

        The runs cannot test invisible effects, and waves of which a joint covered only a few cycles, because a wrong
        zero looks like them.
        """
        posterior, state, selection = self.result.posterior, self.result.state, self.result.selection
        hidden = selection.not_testable(state, posterior)
        of_curves = zip(self.result.columns.forms, *selection.waves_of_curves, strict=True)
        not_shown = {form.columns for form, wave, piece in of_curves if (wave and piece) or form.name in hidden}
        forms = [form for form in forms if form.columns not in not_shown]
        gain = posterior.gains(forms, state.level).fault
        best: dict[str, int] = {}
        # for equal values the first, independent of rounding
        for k in np.argsort(-gain.round(6), kind="stable").tolist():
            if np.isfinite(gain[k]):
                best.setdefault(forms[k].name, k)
        evidence = np.array([0.0, *(gain[k] for k in best.values())])
        odds = np.exp(evidence - evidence.max())
        members = []
        for k, likely in zip(best.values(), (odds / odds.sum())[1:].tolist(), strict=True):
            _, vector, u_um = self._combined(np.array(forms[k].columns))
            effect = combined_effect(forms[k].effects, posterior.size(forms[k]))
            share = float(vector @ group) ** 2 / max(float(vector @ vector) * float(group @ group), _NOTHING)
            members.append(GroupMember(effect, float(np.linalg.norm(vector)), likely, u_um, share))
        return tuple(sorted(members, key=lambda member: -member.odds)[:_MOST_MEMBERS])


# ----------------------------------------------------------------------------------------------------------------------
# Size of a named effect per set-up: an effect of the arm has the same size everywhere.
#
# An unexplained error can resemble an effect on one circle, or even two, but hardly with equal size at every place. If
# set-ups disagree on the size, the effect therefore imitates a different cause.

_NOTHING = 1e-300
"""Below any visible value, to avoid division by zero."""


@dataclass(frozen=True)
class SizesBySetUp:
    """Size of a named effect in each of n informative set-ups, relative to that in all runs, fitted together with all
    other contributions. Empty below two set-ups.
    """

    setups: tuple[str, ...]
    value: Array
    covariance: Array

    def shares(self) -> tuple[Share, ...]:
        sds = np.sqrt(np.diag(self.covariance))
        return tuple(Share(*share) for share in zip(self.setups, self.value.tolist(), sds.tolist(), strict=True))

    def birge_ratio(self) -> float:
        """Ratio (at least 1) of the scatter between set-ups to that expected from the noise of the readings.

        A wrong form, such as a different crossing of backlash, changes the size on each path. The Birge ratio (1932),
        used by CODATA for constants, is applied if chance explains a disagreement in fewer than 5 % of cases.
        """
        if not self.setups:
            return 1.0
        weight, freedom = np.linalg.inv(self.covariance), len(self.setups) - 1
        away = self.value - (weight @ self.value).sum() / weight.sum()
        disagreement = float(away @ weight @ away)
        return 1.0 if _by_chance(disagreement, freedom) else float(np.sqrt(disagreement / freedom))


def _by_chance(energy: float, freedom: int) -> bool:
    """Whether noise gives a sum of squares of this size, in units of the variance, in at least 5 % of cases."""
    from scipy.special import chdtri  # noqa: PLC0415 - slow to import

    return energy <= float(chdtri(freedom, 1 / ODDS))


def sizes_by_setup(result: SearchResult, k: int, limits: Array) -> SizesBySetUp:
    """Sizes of effect k in set-ups whose readings it changes by more than the limits (b,) µm."""
    linear, change = result.linear, result.contributions[k]
    setups = np.array([block.setup for block in linear.blocks])
    shown = list(dict.fromkeys(setups[rms_by_block(linear, change).um > limits].tolist()))
    if len(shown) < 2:
        return SizesBySetUp((), np.empty(0), np.empty((0, 0)))
    # A column for each of these set-ups and a common column for all others, in which the effect is also free.
    number = np.array([shown.index(setup) if setup in shown else len(shown) for setup in setups])
    columns = np.zeros((len(change), number.max() + 1))
    for rows, column in zip(linear.rows, number, strict=True):
        columns[rows, column] = change[rows]
    precision, slope = _other_parameters(result, k).cavity(columns)
    covariance = np.asarray(np.linalg.inv(precision + np.eye(len(slope)) / LARGEST_FAULT**2), dtype=float)
    of_shown = slice(len(shown))
    return SizesBySetUp(tuple(shown), (1 + covariance @ slope)[of_shown], covariance[of_shown, of_shown])


def runs_apart(result: SearchResult, k: int) -> float:
    """Relative standard uncertainty of effect k's size from differences between single runs beyond noise and scatter; 0
    if chance explains them.

    Noise is equal for all entries of a band, and scatter for all joints. A single joint wandering along the path
    resembles a lag or gear error of this joint.
    """
    linear, beside, change = result.linear, _other_parameters(result, k), result.contributions[k]
    weight, scatter = beside.background.weight, np.concatenate([linear.Z, linear.stamps], axis=1)
    pull = weight * beside.without_absorbed(change[:, None])[:, 0]
    # Share of the size determined by the readings instead of the prior.
    pull /= max(float(change @ pull) + (size_of(result.effects[k]) / LARGEST_FAULT) ** 2, _NOTHING)
    freedom, shown, expected = 0, 0.0, 0.0
    for block, rows in zip(linear.blocks, linear.rows, strict=True):
        if block.count > 1:
            single = block.apart_mm @ (pull[rows] / block.sd_mm)
            shown += float(single @ single) / (block.count * (block.count - 1))
            expected += float(np.sum(pull[rows] ** 2 / weight[rows]) + np.sum((pull[rows] @ scatter[rows]) ** 2))
            freedom += block.count - 1
    by_chance = not freedom or _by_chance(freedom * shown / max(expected, _NOTHING), freedom)
    return 0.0 if by_chance else float(np.sqrt(shown - expected))


def _other_parameters(result: SearchResult, k: int) -> CoefficientPosterior:
    """Posterior of all other parameters, with the fitted size of effect k fixed."""
    refined, fitted = result.fit, result.fit.fitted_terms
    field = size_field(refined.effects[k])
    kept = np.ones(len(fitted.mean), dtype=bool)
    kept[: len(refined.unknowns)] = [unknown.effect != k or unknown.field != field for unknown in refined.unknowns]
    shape = [unknown.field != field for unknown in refined.unknowns if unknown.effect == k]
    # All other responses are the same, so that their products with the columns are computed once.
    responses = list(fitted.responses)
    responses[k] = Response(responses[k].columns[:, shape])
    terms = replace(
        fitted,
        responses=tuple(responses),
        precision=fitted.precision[np.ix_(kept, kept)],
        mean=fitted.mean[kept],
        held=fitted.held[kept],
    )
    return CoefficientPosterior(result.posterior.background, terms)
