"""Candidate effects, and the columns of all possible changes of the readings."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.evidence.blocks import Block, recent
from analysis.diagnosis.evidence.setups import constants_apart
from analysis.diagnosis.evidence.significance import SURE_SIGMA
from analysis.diagnosis.fit.departures import initial_play_columns
from analysis.diagnosis.fit.joint_curves import CurveColumns, JointCurves, curve_columns
from analysis.diagnosis.fit.responses import Linearisation, Response
from analysis.diagnosis.fit.triangles import double_triangle, lower_triangle, symmetric
from analysis.robot.kinematics.arm import Array, rail_mm
from analysis.runs.tables import format_of
from rigs.effects import VOCABULARY, Effect, one_sided
from rigs.schema.effect import PartKind, Scope, healthy, is_play, name_of, phases, scaled
from rigs.schema.vocabulary import MOST_AXES

# ----------------------------------------------------------------------------------------------------------------------
# Candidates: possible names of a diagnosis, each with columns in the readings. The response to an effect is
# simulate(model + effect) - simulate(model) (`linearisation`), never written by hand. A column is such a response at a
# healthy size; an effect with a free phase has two. Names, forms and shapes: `rigs/effects`.

_PLAY_SIGMA = 15.0
"""Size in sigmas of the narrowest backlash tried. Chosen: well above the detection limit of 7 sigma."""
_PLAYS = (1.0, 6.0, 30.0)
"""Backlash widths tried, in healthy widths: of healthy arms, and of two faults. Chosen: factors of about five, refined
by the fit.
"""


@dataclass(frozen=True)
class Candidate:
    """An effect in a given form."""

    name: str
    effects: tuple[Effect, ...]
    """Effect of each column, at `size` of the healthy size: the response to backlash is not proportional to the
    width.
    """
    size: float = 1.0
    shaped: tuple[Effect, ...] = ()
    """The effect in the other shapes tried by a search."""
    weight: float = 1.0
    """Relative likelihood of each."""

    @property
    def effect(self) -> Effect:
        return self.effects[0]


def candidates_for(linear: Linearisation) -> list[Candidate]:
    """List every registered effect that the runs can show."""
    scope = _scope(linear.blocks)
    places = [forms for cls in VOCABULARY.values() for forms in cls.forms(scope)]
    plays = [healthy(form) for forms in places for form in forms if is_play(form)]
    sigmas = iter(np.linalg.norm(linear.columns(plays), axis=0))
    candidates = []
    for forms in places:
        for form in forms:
            sizes = [min(1.0, form.STRAIGHT)]
            if is_play(form):  # the response depends on the width
                sizes = sorted({min(1.0, _PLAY_SIGMA / max(float(next(sigmas)), 1e-9)), *_PLAYS})
            tried = [(free.stated, {free.field: value}) for free in form.free(scope.payload) for value in free.tried]
            # All alternatives to the rig file together are as likely as the stated value, so their number does not
            # lower the likelihood of a name.
            weight = 1 / len(tried) if any(stated for stated, _ in tried) else 1.0
            for whole, size in ((scaled(healthy(form), size), size) for size in sizes):
                shaped = tuple(whole.model_copy(update=shape) for _, shape in tried)
                candidates.append(Candidate(name_of(form), phases(whole), size, shaped, weight))
    return candidates


def _scope(blocks: Sequence[Block]) -> Scope:
    tables = [block.table for block in blocks]
    timed = any(table.swept for table in tables)
    gauges = max((format_of(table.test).gauges for table in tables), key=len)
    twist_deg = np.degrees(blocks[0].model.arm.alpha)
    arm = blocks[0].model.arm
    rail = arm.rail is not None and any(np.ptp(rail_mm(arm, table.q)) > 0 for table in tables)
    # On circles, if any, joints move during the readings.
    moving = [block for block in blocks if block.table.swept] or blocks
    turned = np.max([block.turns for block in moving], axis=0)
    payload = blocks[0].model.load.payload
    return Scope(timed, gauges, tuple(twist_deg.tolist()), tuple(turned[: arm.axes].tolist()), rail, payload)


# ----------------------------------------------------------------------------------------------------------------------
# Columns: all possible changes of the readings, namely every form of every effect, set-ups, and scatter between runs.
#
# A form is a possible appearance of a name: a gear error of a given order (two columns, because of the free phase), or
# backlash of a given width and crossing. A healthy arm has a little of every effect, so the healthy size of each name
# is distributed over the forms.

_BALL_MM, _PLACED_MM = 10.0, 1000.0
"""Prior standard deviation of a set-up term about the first fit: of a ball, and of an instrument or its target. It
matters only for poorly determined terms, such as the height of a ball above the plane of a circle. Chosen: a ball is
placed at the centre of the tool's circle, an instrument may be anywhere.
"""
LARGEST_FAULT = 68.0
"""Largest fault in healthy sizes: faults are 5 to 100 healthy sizes."""
_SMALLEST_FAULT = 6.0
"""Smallest fault, relative to the level of the arm: 5 healthy sizes, with a margin of 1."""
_MEAN = float(np.sqrt(2 / np.pi))
"""Mean magnitude of a standard normal variable."""
WEIGHT_DIGITS, _UNEVEN, _RESIDUALS, _AMONG = 9, 4, 8, 3
"""Digits for distinguishing reading weights; cached weighted products of a band, about 5 MB each; cached residuals; and
cached products of fitted terms.
"""
_SIZE_RATIO = 1.85
"""Ratio of consecutive fault sizes: 6, 11, 20, 37 and 68 in a healthy arm. Chosen: the evidence is an average over
sizes and smooth in their logarithm.
"""


_APART: tuple[PartKind, ...] = ("constants", "gravity")
"""Parts of the error with a separate level: links, zeros and stiffness are independent of the quality of gears."""


@dataclass(frozen=True)
class Level:
    """Level of the small errors of an arm, 1 in a typical healthy arm. If `apart` is given, geometry and deflection
    under load have levels of their own, because an arm with perfect gears may have inaccurate links.
    """

    others: float = 1.0
    apart: tuple[float, ...] = ()

    @classmethod
    def of_values(cls, values: Array) -> Level:
        others, *apart = values.tolist()
        return cls(others, tuple(apart))

    @property
    def values(self) -> Array:
        """The levels of others and of the parts apart (1 + n,)."""
        return np.array([self.others, *self.apart])

    def index(self, effect: Effect) -> int:
        return 1 + _APART.index(effect.part) if self.apart and effect.part in _APART else 0

    def of(self, effect: Effect) -> float:
        return (self.others, *self.apart)[self.index(effect)]

    def by_part(self) -> dict[str, float]:
        """Level of each part, as in the JSON."""
        apart = self.apart or (self.others,) * len(_APART)
        return {"others": self.others, **dict(zip(_APART, apart, strict=True))}

    def at_least(self, least: float) -> Level:
        return Level.of_values(np.maximum(self.values, least))


HEALTHY, HEALTHY_APART = Level(), Level(apart=(1.0,) * len(_APART))
"""Level of a typical healthy arm: common to all parts, and separate for each."""


def fault_sizes(level: float) -> Array:
    """Possible fault sizes (n,), in healthy sizes, for an arm with a background level."""
    least = min(_SMALLEST_FAULT * level, LARGEST_FAULT / 4)
    return np.geomspace(least, LARGEST_FAULT, 1 + round(np.log(LARGEST_FAULT / least) / np.log(_SIZE_RATIO)))


@dataclass(frozen=True, kw_only=True)
class Form(Candidate):
    """One shape in which an effect may occur, with the indices of its `columns`."""

    columns: tuple[int, ...]

    @property
    def one_sided(self) -> bool:
        return len(self.effects) == 1 and one_sided(self.effect)


@dataclass(frozen=True, eq=False)
class BandWeights:
    """Inverse variances of the readings, factored by band."""

    scale: Array
    """Largest (b,) of each band."""
    shape: Array
    """Share (N,) of it."""
    uneven: list[int]
    """Bands with unequal weights."""


@dataclass(frozen=True, eq=False)
class Columns:
    """The columns of a linearisation: all possible changes of the readings."""

    X: Array
    """Columns (N, p): forms per healthy size, then set-ups per mm, then scatter of joints, ball and stamps."""
    forms: tuple[Form, ...]
    set_ups: slice
    """The columns of set-ups."""
    band: NDArray[np.int64]
    """Index (N,) of the band of each entry."""
    healthy: Array
    """Prior variances (p,) in a healthy arm, growing with the level."""
    fixed: Array
    """Prior variances (p,) that do not."""
    healthy_mean: Array
    """Prior means (p,) at level 1."""
    not_seen: tuple[str, ...] = ()
    """Effects invisible at any fault size."""
    constants_apart: bool = False
    """True if constants of the arm have separate widths, as for touches."""
    turned: tuple[float, ...] = ()
    """Turns of joints."""
    _products: WeakKeyDictionary[Response, tuple[bytes, Array]] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False
    )
    _among_values: dict[tuple[int, bytes], tuple[Array, Array]] = field(default_factory=dict, init=False, repr=False)
    _residuals: dict[int, tuple[Array, Response]] = field(default_factory=dict, init=False, repr=False)
    _uneven: dict[tuple[int, bytes], Array] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def among(self) -> dict[str, float]:
        """Number of forms of each effect, by weight."""
        among = dict.fromkeys((form.name for form in self.forms), 0.0)
        for form in self.forms:
            among[form.name] += form.weight
        return among

    @cached_property
    def likelihoods(self) -> Array:
        """Likelihood of each form (n,) among the forms of its effect in a healthy arm."""
        return _likelihoods(self.forms)

    @cached_property
    def sizes(self) -> Array:
        """Size (f,), in healthy sizes, at which each form column was computed."""
        return np.repeat([form.size for form in self.forms], [len(form.columns) for form in self.forms])

    @cached_property
    def name_of_column(self) -> NDArray[np.int64]:
        """Index (p,) of the name of each column, -1 for columns that are not forms."""
        numbers = {name: k for k, name in enumerate(self.among)}
        of_forms = [numbers[form.name] for form in self.forms for _ in form.columns]
        return np.array(of_forms + [-1] * (self.X.shape[1] - len(of_forms)), dtype=np.int64)

    @cached_property
    def curves(self) -> CurveColumns:
        """Columns that are waves of joint angles."""
        effects = [effect for form in self.forms for effect in form.effects]
        return curve_columns(effects, self.turned, apart=self.constants_apart)

    @cached_property
    def rows(self) -> list[NDArray[np.int64]]:
        return [np.flatnonzero(self.band == b) for b in range(len(self.count))]

    @cached_property
    def count(self) -> NDArray[np.int64]:
        return np.bincount(self.band)

    @cached_property
    def parts(self) -> list[Array]:
        return [self.X] if len(self.rows) == 1 else [self.X[rows] for rows in self.rows]

    @cached_property
    def K(self) -> Array:  # noqa: N802 - a matrix
        """Lower triangles (b, t) of the Gram matrices of the whitened columns in each band."""
        p = self.X.shape[1]
        triangles = np.empty((len(self.parts), p * (p + 1) // 2))
        for part, triangle in zip(self.parts, triangles, strict=True):
            triangle[:] = lower_triangle(part.T @ part)
        return triangles

    @cached_property
    def gram(self) -> Array:
        return symmetric(self.K.sum(axis=0))

    def weighted_gram(self, weight: Array) -> Array:
        """X'WX (p, p) for weights (N,), from the Gram matrices of the bands."""
        weights = self.by_band(weight)
        even = weights.scale.copy()
        even[weights.uneven] = 0.0
        gram: Array = even @ self.K
        for band in weights.uneven:
            gram += self._uneven_gram(band, weights)
        return symmetric(gram)

    def weighted_spent(self, weight: Array, covariance: Array) -> Array:
        """Weighted energy of each band (b,) that a covariance (p, p) of the coefficients hides, for weights (N,)."""
        weights, doubled = self.by_band(weight), double_triangle(covariance)
        spent: Array = weights.scale * (self.K @ doubled)
        for band in weights.uneven:
            spent[band] = self._uneven_gram(band, weights) @ doubled
        return spent

    def _uneven_gram(self, band: int, weights: BandWeights) -> Array:
        """Lower triangle (t,) of the weighted products of a band with unequal weights, from the few entries with
        reduced weight.

        Cached, because a search for the noise strength scales all weights of a band equally.
        """
        shape = weights.shape[self.rows[band]]

        def compute() -> Array:
            reduced = np.flatnonzero(shape != 1)
            part = np.sqrt(1 - shape[reduced])[:, None] * self.parts[band][reduced]
            return np.asarray(self.K[band] - lower_triangle(part.T @ part), dtype=float)

        gram = recent(self._uneven, (band, shape.tobytes()), compute, _UNEVEN)
        return np.asarray(weights.scale[band] * gram, dtype=float)

    def by_band(self, weight: Array) -> BandWeights:
        scale = np.zeros(len(self.count))
        np.maximum.at(scale, self.band, weight)
        shape = np.round(weight / scale[self.band], WEIGHT_DIGITS)
        return BandWeights(scale, shape, np.unique(self.band[shape != 1]).tolist())

    def response_of(self, residual: Array) -> Response:
        return recent(self._residuals, id(residual), lambda: (residual, Response(residual[:, None])), _RESIDUALS)[1]

    def weighted_products(self, responses: Sequence[Response], weights: BandWeights) -> Array:
        """Weighted products (k, p) of whitened responses with all columns, cached with each response."""
        key = weights.shape.tobytes()
        new = [response for response in responses if self._products.get(response, (b"",))[0] != key]
        if new:
            columns = weights.shape[:, None] * np.concatenate([response.columns for response in new], axis=1)
            together = np.stack([columns[rows].T @ part for rows, part in zip(self.rows, self.parts, strict=True)])
            ends = np.cumsum([response.columns.shape[1] for response in new])[:-1]
            each = map(np.ascontiguousarray, np.split(together, ends, axis=1))
            self._products.update((response, (key, products)) for response, products in zip(new, each, strict=True))
        by_band = [self._products[response][1] for response in responses]
        return np.concatenate([np.tensordot(weights.scale, products, axes=1) for products in by_band])

    def products_among(self, values: Array, weights: BandWeights) -> Array:
        """Weighted products (k, k) of whitened values (N, k), cached by band for the latest values."""

        def compute() -> tuple[Array, Array]:
            whole = values if (weights.shape == 1).all() else np.sqrt(weights.shape)[:, None] * values
            return values, np.stack([part.T @ part for part in (whole[rows] for rows in self.rows)])

        by_band = recent(self._among_values, (id(values), weights.shape.tobytes()), compute, _AMONG)[1]
        return np.tensordot(weights.scale, by_band, axes=1)

    def level_indices(self, level: Level) -> NDArray[np.int64]:
        """Index (p,) of the level of each column in `level.values`."""
        return self._indices_apart if level.apart else np.zeros(len(self.healthy), dtype=np.int64)

    @cached_property
    def _indices_apart(self) -> NDArray[np.int64]:
        of_forms = [HEALTHY_APART.index(form.effect) for form in self.forms for _ in form.columns]
        return np.array(of_forms + [0] * (self.X.shape[1] - len(of_forms)), dtype=np.int64)

    def levels(self, level: Level) -> Array:
        """Level (p,) of each column."""
        return level.values[self.level_indices(level)]

    def variance(self, level: Level, curves: JointCurves | None = None) -> Array:
        """Prior variance (p,) of the coefficients at a level; waves of joints have that of the `curves`, if given."""
        variance: Array = self.levels(level) ** 2 * self.healthy + self.fixed
        if curves is not None:
            variance[self.curves.columns] = self.curves.variance(curves)
        return variance

    def usual_variance(self, level: Level) -> Array:
        """Largest usual variance (p,) of the coefficients at a level, in healthy sizes squared.

        A width inferred from a single large constant would equal this constant, and make any fault usual. Constants
        with separate widths are therefore limited to a healthy arm's.
        """
        usual = np.full(len(self.healthy), np.inf)
        constants = self.curves.columns[self.curves.joint >= MOST_AXES]
        usual[constants] = level.others**2 * self.healthy[constants]
        return usual

    def mean(self, level: Level) -> Array:
        return self.levels(level) * self.healthy_mean


def columns_for(linear: Linearisation, candidates: Sequence[Candidate]) -> Columns:
    """Compute the columns of the visible candidates, of set-ups and of scatter."""
    every = in_each_shape(candidates)
    sizes = np.repeat([candidate.size for candidate in every], [len(candidate.effects) for candidate in every])
    columns = linear.columns([effect for candidate in every for effect in candidate.effects]) / sizes
    widths, sigma = [len(candidate.effects) for candidate in every], LARGEST_FAULT * np.linalg.norm(columns, axis=0)
    shows = [bool(sigmas.max() > SURE_SIGMA) for sigmas in np.split(sigma, np.cumsum(widths)[:-1])]
    forms = forms_of([candidate for candidate, is_shown in zip(every, shows, strict=True) if is_shown])
    seen, columns = {form.name for form in forms}, columns[:, np.repeat(shows, widths)]
    # Every joint of a healthy arm has some backlash, with an unknown position at the start of a run.
    plays = [healthy(candidate.effect) for candidate in candidates if is_play(candidate.effect)]
    begins = initial_play_columns(linear, list({name_of(play): play for play in plays}.values()))
    present = {name_of(effect) for block in linear.blocks for effect in block.model.effects}
    random = np.concatenate([linear.Z, linear.stamps, begins], axis=1)
    share, set_ups, scattered = healthy_shares(forms, present), linear.U.shape[1], random.shape[1]
    placed_mm = np.full(set_ups, _BALL_MM)
    placed_mm[sorted(linear.terms_of_poses)] = _PLACED_MM
    return Columns(
        np.concatenate([columns, linear.U, random], axis=1),
        forms,
        slice(len(share), len(share) + set_ups),
        np.unique(linear.band, return_inverse=True)[1],
        np.concatenate([share, np.zeros(set_ups + scattered)]),
        np.concatenate([np.zeros(len(share)), placed_mm**2, np.ones(scattered)]),
        np.concatenate([healthy_means(forms, present), np.zeros(set_ups + scattered)]),
        tuple(dict.fromkeys(candidate.name for candidate in every if candidate.name not in seen)),
        constants_apart(linear.blocks),
        _scope(linear.blocks).turned,
    )


def in_each_shape(candidates: Sequence[Candidate]) -> list[Candidate]:
    return [
        replace(candidate, effects=effects, shaped=(), weight=candidate.weight if k else 1.0)
        for candidate in candidates
        for k, effects in enumerate((candidate.effects, *((shape,) for shape in candidate.shaped)))
    ]


def forms_of(every: Sequence[Candidate]) -> tuple[Form, ...]:
    first, forms = 0, []
    for form in every:
        columns = tuple(range(first, first := first + len(form.effects)))
        forms.append(Form(**vars(form), columns=columns))
    return tuple(forms)


def healthy_shares(forms: Sequence[Form], present: Collection[str] = ()) -> Array:
    """Prior variance (p,) of form columns in a healthy arm, in healthy sizes squared, distributed over the forms of
    each effect. `present`: effects already in the model.
    """
    whole = np.array([1 - _MEAN**2 if _is_magnitude(form, present) else 1.0 for form in forms])
    width = np.array([len(form.columns) for form in forms], dtype=np.int64)
    return np.repeat(whole * _likelihoods(forms) / np.maximum(width, 1), width)


def remaining_variance_shares(forms: Sequence[Form], effect: Effect) -> Array:
    """Share of healthy variance that each form (n,) keeps if an effect is named: zero for forms of the same name.

    A gear may have further waves, which are hard to separate if the joint moves little. Most orders are integers, like
    numbers of teeth, so the named wave takes the share of a single order from its nearest form.
    """
    name = name_of(effect)
    keeps = np.array([form.name != name for form in forms], dtype=float)
    indices = np.flatnonzero(keeps == 0)
    orders = np.array([order_of(forms[k].effect) for k in indices.tolist()])
    if _is_ordered(orders):
        width, k = np.gradient(np.sort(orders)), int(np.argmin(np.abs(orders - order_of(effect))))
        keeps[indices] = 1.0
        keeps[indices[k]] = 1 - min(1.0, 1 / float(width[np.searchsorted(np.sort(orders), orders[k])]))
    return keeps


def remaining_column_shares(forms: Sequence[Form], effect: Effect, count: int) -> Array:
    """`remaining_variance_shares` for each of `count` columns (p,); columns after those of the forms keep their
    variance.
    """
    shares = np.ones(count)
    of_forms = np.repeat(remaining_variance_shares(forms, effect), [len(form.columns) for form in forms])
    shares[: len(of_forms)] = of_forms
    return shares


def order_of(effect: Effect) -> float:
    return float(getattr(effect, "order", np.nan))


def _is_ordered(orders: Array) -> bool:
    return len(orders) > 1 and len(np.unique(orders[np.isfinite(orders)])) == len(orders)


def _likelihoods(forms: Sequence[Form]) -> Array:
    """Likelihood of each form (n,) among the forms of its effect: by weight, and equal for each octave of gear orders,
    which are ratios of stages.
    """
    likely, names = np.array([form.weight for form in forms]), np.array([form.name for form in forms])
    for name in dict.fromkeys(names.tolist()):
        indices = np.flatnonzero(names == name)
        orders = np.array([order_of(forms[k].effect) for k in indices.tolist()])
        if _is_ordered(orders):
            likely[indices[np.argsort(orders)]] = np.gradient(np.log(np.sort(orders)))
        likely[indices] /= likely[indices].sum()
    return likely


def healthy_means(forms: Sequence[Form], present: Collection[str] = ()) -> Array:
    """Prior mean (p,) of form columns in a healthy arm, in healthy sizes: a size that cannot be negative is positive on
    average.

    The mean belongs to the expected shape at a healthy size, because the response to backlash is not proportional to
    the width. `present`: names in the model, whose remaining error may have either sign.
    """
    means = np.zeros(sum(len(form.columns) for form in forms))
    nearest: dict[str, Form] = {}
    for form in forms:  # other shapes follow the expected shape
        if form.name not in nearest or abs(np.log(form.size)) < abs(np.log(nearest[form.name].size)):
            nearest[form.name] = form
    for form in nearest.values():
        if _is_magnitude(form, present):
            means[list(form.columns)] = _MEAN
    return means


def _is_magnitude(form: Form, present: Collection[str]) -> bool:
    return form.one_sided and form.name not in present
