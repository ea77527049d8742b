"""Refinement of named effects: sizes and shapes fitted on the simulator by Gauss-Newton, with the background.

The residual of a wrong shape would support other names. The shape (crossing of a backlash, order of a gear, decay) is
therefore fitted with the size, and deviations from the ideal effect (`departures`) are included in proportion to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np

from analysis.diagnosis.fit.background import Background, FittedTerms, MarginalValues
from analysis.diagnosis.fit.candidates import LARGEST_FAULT
from analysis.diagnosis.fit.departures import departure_columns, fewest_columns, similar_columns
from analysis.diagnosis.fit.responses import Linearisation, Response
from analysis.robot.kinematics.arm import Array
from rigs.effects import Effect, bounds, healthy_size, one_sided, size_field
from rigs.schema.effect import PHASE, is_wave, name_of

FIT_ROUNDS = 8
"""Largest number of Gauss-Newton rounds. Chosen: more than a fit near the optimum needs."""
_TRIES = 5
"""Largest number of damping increases in a round. Chosen: five factors of 8 raise the damping by more than 10⁴."""
_FURTHEST = 4.0
"""Largest distance of a shape from the expected value, in prior standard deviations. Chosen."""
_ENOUGH = 0.1
"""Chi-square that a round must gain for the fit to continue. Chosen: well below any evidence that matters."""
_NEARBY = 0.005
"""Relative change of a size, and of the spread of a shape, up to which derivatives and departures are not recomputed.
Chosen: at 2 % the uncertainty of a backlash of 0.1° was 28 % too large.
"""

_NEAR_LIMIT = 0.01
"""Standard uncertainties between a value and a limit below which the value is the limit. Chosen: below all figures."""
_WHOLE = 0.5
"""Share of integer orders of gears. Chosen: a wave of non-integer order loses at most half of the odds."""

_One = TypeVar("_One")


@dataclass(frozen=True)
class UnknownParameter:
    """An unknown: index of the effect, field, expected value, prior standard deviation, and lower bound."""

    effect: int
    field: str
    expected: float
    spread: float
    low: float = -np.inf


@dataclass(frozen=True)
class Refined:
    """Effects with fitted sizes and shapes."""

    effects: tuple[Effect, ...]
    unknowns: tuple[UnknownParameter, ...]
    values: Array
    """Of the unknowns (q,)."""
    covariance: Array
    """Of the unknowns (q, q)."""
    to_limit: Array
    """Distance (q,) to the limit of each unknown that the next step would move there, NaN for the others."""
    residual: Array
    """Whitened residual (N,) with the effects, with set-ups and background unchanged."""
    tangents: tuple[Response, ...]
    """Derivatives by the unknowns of each effect."""
    departures: tuple[Response, ...]
    free: Response
    """Columns of unknown causes, scaled to a standard deviation."""

    def fitted_sd(self, effect: int) -> dict[str, float]:
        """Standard uncertainty of each fitted parameter of an effect with the form of its formula."""
        sds = np.sqrt(np.diag(self.covariance))
        return {u.field: float(sd) for u, sd in zip(self.unknowns, sds, strict=True) if u.effect == effect}

    def sd(self, effect: int) -> dict[str, float]:
        """Standard uncertainty of each fitted parameter of an effect, including that of the form."""
        stated = self.fitted_sd(effect)
        whole, name = self.effects[effect], size_field(self.effects[effect])
        if name in stated:
            stated[name] = float(np.hypot(stated[name], whole.FORM_U * getattr(whole, name)))
        return stated

    @cached_property
    def fitted_terms(self) -> FittedTerms:
        allowances = (*self.departures, self.free)
        allowed = sum(response.columns.shape[1] for response in allowances)
        precision = [unknown.spread**-2 for unknown in self.unknowns] + [1.0] * allowed
        away = np.array([unknown.expected for unknown in self.unknowns]) - self.values
        to_limits = np.concatenate([self.to_limit, np.full(allowed, np.nan)])
        return FittedTerms(
            self.residual,
            (*self.tangents, *allowances),
            np.diag(precision),
            np.concatenate([away, np.zeros(allowed)]),
            to_limits,
        )

    def without(self, place: int) -> Refined:
        """The fit with an effect removed, the others unchanged; the residual is not updated."""
        return self.only([k for k in range(len(self.effects)) if k != place])

    def only(self, places: Sequence[int]) -> Refined:
        """The fit with the effects at these places in this order, unchanged; the residual is not updated."""
        rows = [row for place in places for row, unknown in enumerate(self.unknowns) if unknown.effect == place]
        unknowns = [replace(self.unknowns[row], effect=places.index(self.unknowns[row].effect)) for row in rows]
        return replace(
            self, effects=_at(self.effects, places), unknowns=tuple(unknowns), values=self.values[rows],
            covariance=self.covariance[np.ix_(rows, rows)], to_limit=self.to_limit[rows],
            tangents=_at(self.tangents, places), departures=_at(self.departures, places),
        )  # fmt: skip


def refine(
    linear: Linearisation,
    background: Background,
    effects: Sequence[Effect],
    fitted: Refined | None = None,
    free: Array | None = None,
    rounds: int = FIT_ROUNDS,
    *,
    with_alike: bool | None = None,
) -> Refined:
    """Fit sizes and shapes of effects from their current values.

    `fitted` is an earlier fit of the first of these effects, which move along their tangents; a final fit of all
    together removes the error of that. A new effect starts within the limits of its size, and is first fitted
    separately if others resemble it. `free` (N, f): columns of unknown causes. `with_alike`: only the
    fit together with effects resembling a new effect, or only that without them.
    """
    before = fitted or no_effects(linear)
    old = len(before.effects)
    effects = [*effects]
    for k, effect in enumerate(effects[old:], start=old):
        field, limits = size_field(effect), size_limits(effect, unlimited=name_of(effect) in linear.unlimited)
        effects[k] = effect.model_copy(update={field: float(np.clip(getattr(effect, field), *limits))})
    unknowns = (*before.unknowns, *_unknowns(linear, effects, old))
    free_terms = before.free if free is None else Response(free)

    def solved(begin: Sequence[Effect], *, alike: bool) -> Refined:
        departures = [_departures(linear, effect, alike=alike) for effect in begin[old:]]
        return _Problem(linear, background, before, unknowns, (*before.departures, *departures), free_terms).solved(
            begin, rounds
        )

    if fitted and not with_alike:
        # Fitted together with effects resembling it, a new effect may diverge: a backlash ended at a fifth of the
        # width.
        first = solved(effects, alike=False)
        if with_alike is False or not any(effect.departures().alike for effect in effects[old:]):
            return first
        effects = first.effects
    return solved(effects, alike=True)


def whole_order_gain(refined: Refined, place: int) -> float:
    """Log evidence that a fitted wave gains because many orders are integers; 0 for other effects.

    A fit treats the order as continuous. The evidence for the nearest integer is the ratio of the densities of
    posterior and prior there (Dickey 1971).
    """
    for k, unknown in enumerate(refined.unknowns):
        if unknown.effect == place and unknown.field == "order":
            sd, value = float(np.sqrt(refined.covariance[k, k])), float(refined.values[k])
            off, expected = round(value) - value, round(value) - unknown.expected
            ratio = unknown.spread / sd * np.exp(0.5 * (expected / unknown.spread) ** 2 - 0.5 * (off / sd) ** 2)
            return float(np.log(1 - _WHOLE + _WHOLE * ratio))
    return 0.0


def _departures(linear: Linearisation, effect: Effect, *, alike: bool) -> Response:
    def compute() -> Array:
        departures = departure_columns(linear, effect)
        return fewest_columns(
            np.concatenate([departures, similar_columns(linear, effect)], axis=1) if alike else departures
        )

    steps = _steps_nearby(effect, _unknowns(linear, [effect], 0))
    return linear.near.of(f"departures{', alike' * alike}", effect, steps, compute)


def _steps_nearby(effect: Effect, unknowns: Sequence[UnknownParameter]) -> dict[str, float]:
    """Differences of an effect's parameters over which derivatives and departures hardly change."""
    steps = {unknown.field: _NEARBY * unknown.spread for unknown in unknowns}
    size = size_field(effect)
    steps[size] = _NEARBY * max(abs(float(getattr(effect, size))), healthy_size(effect))
    return steps | ({PHASE: float(np.degrees(_NEARBY))} if is_wave(effect) else {})


def no_effects(linear: Linearisation) -> Refined:
    none = Response(np.empty((len(linear.y), 0)))
    return Refined((), (), np.empty(0), np.empty((0, 0)), np.empty(0), linear.y, (), (), none)


@dataclass(frozen=True)
class _Projected:
    """Values in the background, and `across` (f, k), their products with the departures and unknown causes."""

    marginal: MarginalValues
    across: Array


@dataclass(frozen=True, eq=False)
class _Problem:
    """A fit with a background, of effects of which the first are `fitted` before; other arrays as in `Refined`."""

    linear: Linearisation
    background: Background
    fitted: Refined
    unknowns: tuple[UnknownParameter, ...]
    departures: tuple[Response, ...]
    free: Response

    @cached_property
    def expected(self) -> Array:
        return np.array([u.expected for u in self.unknowns])

    @cached_property
    def spread(self) -> Array:
        return np.array([u.spread for u in self.unknowns])

    @cached_property
    def _allowed(self) -> MarginalValues:
        """Columns (N, f) of the deviations allowed beside the effects: departures and unknown causes."""
        return self.background.marginal_responses((*self.departures, self.free))

    @cached_property
    def _inverse(self) -> Array:
        products = self._allowed.products(self._allowed)
        products[np.diag_indices_from(products)] += 1.0
        return np.asarray(np.linalg.inv(products), dtype=float)

    @cached_property
    def _before(self) -> _Projected:
        return self._projected(self.background.marginal_responses(self.fitted.tangents))

    def solved(self, effects: Sequence[Effect], rounds: int) -> Refined:
        """Levenberg-Marquardt iteration within the bounds of the parameters."""
        x = np.array([float(getattr(effects[u.effect], u.field)) for u in self.unknowns])
        limits, phases = self._limits(effects), np.array([unknown.field == PHASE for unknown in self.unknowns])
        x = np.clip(x, limits[0], limits[1])
        now = self._with(effects, x)
        (r, cost), damping, gained = self._tried(now, x), 1e-4, np.inf
        for turn in range(rounds + 1):
            slopes = self._slopes(now)
            H, fall = self._normal(self._projected(self.background.marginal_responses(slopes)), r)
            if turn == rounds or gained < _ENOUGH or not len(x):
                break
            gradient, least = fall - (x - self.expected) / self.spread**2, damping
            whole = step_within(limits - x, H, gradient)[0]
            if 2 * gradient @ whole - whole @ H @ whole < _ENOUGH:
                break
            for _ in range(_TRIES):
                damped = H + damping * np.diag(np.diag(H))
                step = step_within(limits - x, damped, gradient)[0]
                tried = np.where(phases, (x + step + 180) % 360 - 180, x + step)  # phases from -180 to 180 degrees
                nearer = self._with(now, tried)
                there_r, there_cost = self._tried(nearer, tried)
                if there_cost < cost:
                    break
                damping = max(damping, 1e-2) * 8
            else:
                break
            gained = cost - there_cost
            x, now, r, cost = tried, nearer, there_r, there_cost
            # A damping that was needed is mostly needed again.
            damping = damping / 10 if damping == least else damping
        tangents = (*self.fitted.tangents, *slopes)
        covariance: Array = np.asarray(np.linalg.inv(H), dtype=float)
        sd = np.sqrt(np.diag(covariance)[len(covariance) - len(x) :])
        # Where a fit stops before a limit depends on rounding, and so on the order of the readings.
        nearest = np.where(np.abs(x - limits[0]) < np.abs(x - limits[1]), *limits)
        if (is_near := np.abs(x - nearest) < _NEAR_LIMIT * sd).any():
            x = np.where(is_near, nearest, x)
            now = self._with(now, x)
        to_limit = step_within(limits - x, H, fall - (x - self.expected) / self.spread**2)[1]
        return Refined(
            tuple(now), self.unknowns, x, covariance, to_limit, self.linear.residual(now), tangents, self.departures,
            self.free,
        )  # fmt: skip

    def _tried(self, effects: Sequence[Effect], x: Array) -> tuple[_Projected, float]:
        """The residual (N, 1) with the effects at unknowns x (q,), and its cost."""
        r = self._projected(self.background.marginal_residual(self.linear.residual(effects)))
        return r, float(self._product(r, r)[0, 0]) + float((((x - self.expected) / self.spread) ** 2).sum())

    def _projected(self, marginal: MarginalValues) -> _Projected:
        return _Projected(marginal, self._allowed.products(marginal))

    def _product(self, first: _Projected, second: _Projected) -> Array:
        return first.marginal.products(second.marginal) - first.across.T @ self._inverse @ second.across

    def _normal(self, J: _Projected, r: _Projected) -> tuple[Array, Array]:
        """Normal matrix (q, q) for the earlier unknowns and the slopes J of the new ones, and the negative gradient
        (q,).
        """
        cross = self._product(self._before, J)
        H = np.block([[self._product(self._before, self._before), cross], [cross.T, self._product(J, J)]])
        fall = np.concatenate([self._product(self._before, r), self._product(J, r)])[:, 0]
        return H + np.diag(1 / self.spread**2), fall

    def _slopes(self, effects: Sequence[Any]) -> tuple[Response, ...]:
        """Derivatives (N, q) by the unknowns of each new effect, or of the latest effect near it. Effects are
        additive.
        """
        near, slopes = self.linear.near, []
        for k in range(len(self.fitted.effects), len(effects)):
            unknowns = [unknown for unknown in self.unknowns if unknown.effect == k]
            compute = partial(slopes_of, self.linear, effects[k], unknowns)
            slopes.append(near.of("slopes", effects[k], _steps_nearby(effects[k], unknowns), compute))
        return tuple(slopes)

    def _limits(self, effects: Sequence[Any]) -> Array:
        """Bounds (2, q) of the unknowns. A shape remains near the plausible values, even after a long first step."""
        limits = np.empty((2, len(self.unknowns)))
        for k, unknown in enumerate(self.unknowns):
            effect = effects[unknown.effect]
            if unknown.field == PHASE:
                limits[:, k] = -np.inf, np.inf
            elif unknown.field == size_field(effect):
                limits[:, k] = size_limits(effect, unlimited=name_of(effect) in self.linear.unlimited)
            else:
                (low, high), reach = bounds(effect, unknown.field), _FURTHEST * unknown.spread
                limits[:, k] = max(low, unknown.low, unknown.expected - reach), min(high, unknown.expected + reach)
        return limits

    def _with(self, effects: Sequence[Any], x: Array) -> list[Any]:
        made = list(effects)
        for unknown, value in zip(self.unknowns, x, strict=True):
            made[unknown.effect] = made[unknown.effect].model_copy(update={unknown.field: float(value)})
        return made


def slopes_of(linear: Linearisation, effect: Any, unknowns: Sequence[UnknownParameter]) -> Array:
    """Derivatives (N, q) of whitened readings by the unknowns of an effect, over small steps within bounds."""
    steps, changed = np.empty(len(unknowns)), []
    for k, unknown in enumerate(unknowns):
        size = 1e-3 * unknown.spread if unknown.field != size_field(effect) else 0.05 * healthy_size(effect)
        at = float(getattr(effect, unknown.field))
        steps[k] = -size if at + size > bounds(effect, unknown.field)[1] else size
        changed.append(effect.model_copy(update={unknown.field: at + steps[k]}))
    columns = linear.columns([effect, *changed])
    return (columns[:, 1:] - columns[:, :1]) / steps


def size_limits(effect: Effect, *, unlimited: bool = False) -> tuple[float, float]:
    """Smallest and largest size of an effect in a fit; if `unlimited`, only the sign is limited."""
    if unlimited:
        return 0.0 if one_sided(effect) else -np.inf, np.inf
    (low, high), most = bounds(effect, size_field(effect)), effect.MOST * healthy_size(effect)
    return max(low, -most), min(high, most)


def ended_at_limit(effect: Effect) -> bool:
    """Whether the size of a fitted effect is at the limit of the search, or beyond it."""
    size, (low, high) = float(getattr(effect, size_field(effect))), size_limits(effect)
    return size >= high or (low != 0 and size <= low) or bool(np.isclose(size, [low or high, high]).any())


def step_within(limits: Array, H: Array, gradient: Array) -> tuple[Array, Array]:
    """Step (q,) to the optimum within limits of the step (2, q), and the part (q,) fixed by limits, NaN for others.

    H (q, q) is the normal matrix, and gradient (q,) the negative gradient. If a limit shortens the step of an unknown,
    the others are solved again; otherwise they would go to the optimum of an unlimited fit.
    """
    step, (low, high) = np.linalg.solve(H, gradient), limits
    if ((step >= low) & (step <= high)).all():
        return np.asarray(step, dtype=float), np.full(len(step), np.nan)
    from scipy.optimize import lsq_linear  # noqa: PLC0415 - slow to import

    # H = A'A, in units with a diagonal of 1; eigenvalues below rounding are rounding.
    unit = 1 / np.sqrt(np.diag(H))
    values, turn = np.linalg.eigh(unit[:, None] * H * unit)
    root = np.sqrt(np.maximum(values, values[-1] * np.finfo(float).eps))
    along = turn.T @ (unit * gradient) / root
    solution = lsq_linear(root[:, None] * turn.T, along, (low / unit, high / unit), method="bvls")
    bounded: Array = np.clip(np.asarray(solution.x * unit, dtype=float), low, high)
    at_limit: Array = np.where(solution.active_mask == 0, np.nan, bounded)
    return bounded, at_limit


def _unknowns(linear: Linearisation, effects: Sequence[Effect], first: int) -> list[UnknownParameter]:
    unknowns = []
    for k, effect in enumerate(effects[first:], start=first):
        at: Any = dict(effect)
        unknowns.append(UnknownParameter(k, size_field(effect), 0.0, LARGEST_FAULT * healthy_size(effect)))
        if is_wave(effect):
            unknowns.append(UnknownParameter(k, PHASE, float(at[PHASE]), 360.0))
        for shape in effect.STRETCHED:
            begin = float(at[shape.field])
            spread = max(shape.share * begin, shape.least)
            unknowns.append(UnknownParameter(k, shape.field, begin, spread, shape.low))
        for free in effect.free(linear.payload):
            spread = free.spread_from(float(at[free.field]))
            unknowns.append(UnknownParameter(k, free.field, free.expected, spread, free.low))
    return unknowns


def _at(items: tuple[_One, ...], places: Sequence[int]) -> tuple[_One, ...]:
    return tuple(items[place] for place in places)
