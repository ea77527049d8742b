"""What tests can and cannot tell apart, before anything is measured, and which further test parts what is alike.

The tests are simulated without noise; each effect's signature is whitened by the assumed noise, less what the set-up
could do as well. Two names are alike where one, at a plausible size, is so near to what the other can do at any size
that the odds between them stay within 20 to 1. A further test has a set-up of its own, so products of signatures
simply add: those of the tests planned and those of the further one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any

import numpy as np

from analysis.diagnose.blocks import blocks_of
from analysis.diagnose.candidates import Candidate, candidates_for, name_of
from analysis.diagnose.diagnosis import ODDS
from analysis.diagnose.evidence import DETECTABLE, LARGEST
from analysis.diagnose.linear import Linear
from analysis.diagnose.observed import see
from analysis.kinematics.arm import Array, transform
from analysis.model.predict import SetUp, model_of, nominal_setup
from analysis.model.simulate import simulate
from analysis.reading.tables import CircleTable, Table
from rigs.effects import Effect, JointOffset, healthy_size, one_sided, size_field
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.tests import Circle
from rigs.vocabulary import TestName

ALIKE = float(np.sqrt(2 * np.log(ODDS)))
"""Sigmas below which the odds between two names stay within those at which a diagnosis dismisses a rival."""
_CIRCLES: tuple[TestName, ...] = ("yaw", "roll")
_RADII_MM = (140.0, 50.0)
_ASIDE_MM = 100.0
_FASTER = 4
_OFF_AXIS_MM = 40.0
_OWN_SHARE = 0.02
"""Of a signature that no set-up could do; less is what the straight lines of a linearisation leave of curved ones."""
_NOTHING = 1e-3
"""Sigmas that are none."""
_ON_AXIS = 0.02
"""An axis that moves the readings by less than this share of what the strongest does goes through the ball."""
_SMALL = 1e-3
"""Of a healthy size: signatures of rivals are taken there."""
_PLAYS = ("backlash", "gauge_dead_band")
_IDLE = {
    "backlash": "axis {} does not turn back",
    "reversal_spike": "axis {} does not turn back",
    "compliance": "gravity does not load axis {}",
    "link_bending": "gravity does not bend the link after axis {}",
}


@dataclass(frozen=True)
class Parting:
    """A further test in words, the sigma by which it, beside the tests there are, parts the two nearest of some rivals,
    and why it does."""

    test: str
    sigma: float
    why: str


@dataclass(frozen=True)
class Sight:
    """How one name shows. effect: at a healthy size; sigma: of that; limit: the size that shows at 7 sigma, in the
    effect's own unit; hidden: why it is not seen, empty where it is; further: tests by the sigma of a healthy size."""

    name: str
    effect: Effect
    sigma: float
    limit: float
    hidden: str
    further: tuple[Parting, ...] = ()


@dataclass(frozen=True)
class Pair:
    """Two names that are alike, a gear with the order at which it is most. sigma: by which one, at a plausible size, is
    parted from the other at any; others: how many other forms of them (orders, widths) are alike too."""

    names: tuple[str, str]
    sigma: float
    others: int
    further: tuple[Parting, ...]


@dataclass(frozen=True)
class Gain:
    """What a further test adds: how many of the pairs that are alike it parts, how many hidden names it shows."""

    test: str
    why: str
    parts: int
    shows: int


@dataclass(frozen=True)
class Plan:
    """What tests can and cannot tell apart. gains: of further tests, the one that adds most first; impossible: tests
    that this arm cannot drive, each with the reason."""

    tests: tuple[TestName, ...]
    runs: int
    sights: tuple[Sight, ...]
    groups: tuple[tuple[str, ...], ...]
    pairs: tuple[Pair, ...]
    gains: tuple[Gain, ...]
    impossible: tuple[tuple[str, str], ...]

    @property
    def hidden(self) -> tuple[Sight, ...]:
        """The names that these tests cannot show."""
        return tuple(sight for sight in self.sights if sight.hidden)


def parting(rig: Rig, effects: Sequence[Effect], tests: Sequence[TestName], runs: int = 3) -> list[Parting]:
    """For rival effects at their sizes, each possible further test with the sigma by which it parts the two nearest.

    tests: those there are already, a pose test left out, for it has no program; all are taken as driven `runs` times in
    each direction. Best first; empty for fewer than two effects. Raises FileError where the arm cannot do `tests`.
    """
    if len(effects) < 2:
        return []
    asked = _Signatures([_phases(_small(effect)) for effect in effects], np.array([_smaller(one) for one in effects]))
    programmed = [test for test in tests if test != "pose"]
    known = asked.products(_View(rig, programmed, runs)) if programmed else np.array(0.0)
    found = []
    for answer in _answers(rig, tests, runs, asked)[0]:
        products = known + answer.products
        apart = asked.apart(products, asked.lengths(products))
        nearest = min(float(apart[i, j]) for i, j in permutations(range(len(effects)), 2))
        found.append(Parting(answer.test, nearest, answer.why))
    return list(_best_first(found))


def plan(rig: Rig, tests: Sequence[TestName], runs: int = 3) -> Plan:
    """What tests of a rig, each driven `runs` times in each direction, can and cannot tell apart.

    Noise is that of a good cell; the ball is as far off as the rig file's eccentricity_mm has it. The plausible size of
    an effect is a healthy arm's, or that of 7 sigma where this is larger. Raises FileError where the arm cannot do a
    test.
    """
    view = _View(rig, tests, runs)
    candidates = candidates_for(view.linear)
    labels = [label_of(one.effect) for one in candidates]
    signatures = _Signatures([one.effects for one in candidates], np.array([one.size for one in candidates]))
    products = signatures.products(view)
    sigma = signatures.lengths(products)
    sights = _sights(labels, candidates, sigma, view)
    alike = _alike(candidates, signatures.apart(products, np.maximum(sigma, DETECTABLE)), sigma)
    hidden = [sight for sight in sights if sight.hidden]

    rivals = [candidates[k] for near in alike.values() for k in near.candidates]
    forms = [one.effects for one in rivals] + [(sight.effect,) for sight in hidden]
    asked = _Signatures(forms, np.array([one.size for one in rivals] + [1.0] * len(hidden)))
    known = asked.products(view)
    further, gains, impossible = _helps(_answers(rig, tests, runs, asked), asked, known, len(alike))
    helped = iter(further[len(alike) :])
    return Plan(
        tuple(tests),
        runs,
        tuple(replace(sight, further=next(helped)) if sight.hidden else sight for sight in sights),
        _groups(list(alike)),
        tuple(_pair(near, candidates, found) for near, found in zip(alike.values(), further, strict=False)),
        gains,
        impossible,
    )


def parts(sigma: float) -> bool:
    """Whether two names so far apart are told apart."""
    return sigma >= ALIKE


def shows(sigma: float) -> bool:
    """Whether a name is seen that has so many sigmas at a healthy size."""
    return LARGEST * sigma >= DETECTABLE


def tests_named(rig: Rig, names: str | None) -> tuple[TestName, ...]:
    """Tests by their names with commas, None for those the rig is set up for. Raises FileError for an unknown one."""
    if names is None:
        circle: tuple[TestName, ...] = _CIRCLES if rig.tests.circle else ()
        return (*circle, "radial") if rig.tests.hemisphere else circle or _CIRCLES
    known: tuple[TestName, ...] = (*_CIRCLES, "radial", "repeatability")
    asked = [name.strip() for name in names.split(",")]
    for name in asked:
        if name not in known:
            raise FileError("--tests", f"knows no {name!r}", f"give some of {','.join(known)}")
    return tuple(name for name in known if name in asked)


class _View:
    """What effects add to the readings of some tests of a rig, each repeated, in standard deviations."""

    def __init__(self, rig: Rig, tests: Sequence[TestName], runs: int) -> None:
        model = model_of(rig)
        seen = [see(model, table, rig.name) for table in _tables(rig, tests)]
        setups = {run.one.setup: _setup(rig, run.one.table) for run in seen}
        self.linear = Linear(blocks_of(seen, setups)[0], setups)
        self._repeats = np.sqrt(runs)

    def columns(self, effects: Sequence[Effect]) -> tuple[Array, Array]:
        """Signatures (N, p), zero where the set-up takes them up, and their lengths (p,) before it does."""
        raw = self.linear.raw(effects)
        own, whole = self.linear.projected(raw), np.linalg.norm(raw, axis=0)
        own[:, np.linalg.norm(own, axis=0) < _OWN_SHARE * whole] = 0.0
        return self._repeats * own, self._repeats * whole


def _tables(rig: Rig, tests: Sequence[TestName]) -> list[Table]:
    """The tests as driven; their readings do not matter, nothing is measured yet. Yaw and roll are one motion, and a cw
    program drives the joint angles of the acw one back."""
    tables = [simulate(rig, test, None, None) for test in tests if test not in _CIRCLES]
    if "yaw" in tests or "roll" in tests:
        acw = simulate(rig, "yaw", "acw", None)
        assert isinstance(acw, CircleTable)  # noqa: S101 - what simulate makes of a circle
        cw = replace(acw, direction="cw", t_s=acw.t_s[-1] - acw.t_s[::-1], q=acw.q[::-1])
        tables += [acw, cw] if "yaw" in tests else []
        tables += [replace(lap, test="roll") for lap in (acw, cw)] if "roll" in tests else []
    return tables


def _setup(rig: Rig, table: Table) -> SetUp:
    setup = nominal_setup(rig, table)
    if isinstance(table, CircleTable) and rig.tests.circle:
        return replace(setup, ball=setup.ball + np.array(rig.tests.circle.eccentricity_mm))
    return setup


class _Signatures:
    """Items to tell apart: each one effect, or two where a phase is free. sizes (n,): of each, in the size that is
    meant (a healthy one, say); all results are for the size that is meant."""

    def __init__(self, forms: Sequence[tuple[Effect, ...]], sizes: Array) -> None:
        self._effects = [effect for form in forms for effect in form]
        ends = np.cumsum([len(form) for form in forms])
        self._columns = [np.arange(end - len(form), end) for form, end in zip(forms, ends, strict=True)]
        self._sizes = np.repeat(sizes, [len(form) for form in forms])
        self._one_sided = np.array([len(form) == 1 and one_sided(form[0]) for form in forms], dtype=bool)

    def products(self, view: _View) -> Array:
        """Products (p, p) of all signatures in a view."""
        columns = view.columns(self._effects)[0] / self._sizes
        products: Array = columns.T @ columns
        return products

    def lengths(self, products: Array) -> Array:
        """Sigmas (n,) of each item, in the phase that shows most."""
        squares = np.diag(products)
        lengths: Array = np.sqrt(np.array([squares[own].max() for own in self._columns]))
        return lengths

    def apart(self, products: Array, lengths: Array) -> Array:
        """Sigmas (n, n) between item i, as long as lengths (n,) says, and what item j can do at any size or phase."""
        first, second = np.zeros((2, len(products), len(self._columns)))
        for k, own in enumerate(self._columns):
            most, *rest = own[np.argsort(-np.diag(products)[own])]
            first[most, k] = 1 / _length(products[most, most])
            for other in rest:
                along = products[other, most] / _length(products[most, most]) ** 2
                across = _length(products[other, other] - along * products[other, most])
                second[[other, most], k] = [1 / across, -along / across]
        shadow = first.T @ products
        cosine = shadow @ first
        # Two widths cannot stand in for each other with opposite signs.
        cosine[np.logical_and.outer(self._one_sided, self._one_sided) & (cosine < 0)] = 0.0
        sine: Array = np.sqrt(np.clip(1 - cosine**2 - (shadow @ second) ** 2, 0.0, 1.0))
        return lengths[:, None] * sine


def _length(square: float) -> float:
    return max(float(np.sqrt(max(square, 0.0))), _NOTHING)


def _small(effect: Any) -> Effect:
    """An effect so small that its signature is straight; the set-up would take up what bends of a large one. A play is
    not twice itself, and stays."""
    small: Effect = effect.model_copy(
        update={size_field(effect): _smaller(effect) * getattr(effect, size_field(effect))}
    )
    return small


def _smaller(effect: Any) -> float:
    size = abs(getattr(effect, size_field(effect)))
    return 1.0 if effect.effect in _PLAYS or size == 0 else _SMALL * healthy_size(effect) / size


def _phases(effect: Any) -> tuple[Effect, ...]:
    """An effect, and the same a quarter of a wave on where its phase is free."""
    if not hasattr(effect, "phase_deg"):
        return (effect,)
    return effect, effect.model_copy(update={"phase_deg": (effect.phase_deg + 90.0) % 360.0})


def label_of(effect: Effect) -> str:
    """The name of an effect; gears by order, which are many of one name."""
    order = getattr(effect, "order", None)
    return name_of(effect) if order is None else f"{name_of(effect)} order {order:g}"


def _sights(labels: Sequence[str], candidates: Sequence[Candidate], sigma: Array, view: _View) -> list[Sight]:
    """How each label shows, in the middle one of its variants."""
    zeros = view.columns([_healthy(JointOffset(axis=axis)) for axis in range(1, 7)])[1]
    sights = []
    for label in dict.fromkeys(labels):
        variants = sorted((k for k, other in enumerate(labels) if other == label), key=lambda k: sigma[k])
        k = variants[len(variants) // 2]
        effect = _healthy(candidates[k].effect)
        limit = healthy_size(effect) * DETECTABLE / sigma[k] if sigma[k] > 0 else np.inf
        hidden = "" if shows(sigma[k]) else _reason(effect, sigma[k] > 0, float(view.columns([effect])[1][0]), zeros)
        sights.append(Sight(label, effect, float(sigma[k]), float(limit), hidden))
    return sights


def _healthy(effect: Any) -> Effect:
    healthy: Effect = effect.model_copy(update={size_field(effect): healthy_size(effect)})
    return healthy


def _reason(effect: Any, own: bool, whole: float, zeros: Array) -> str:
    """Why an effect is not seen. own: whether some of it no set-up could do; whole: its sigmas were the set-up known;
    zeros (6,): those of each joint's zero."""
    axis = getattr(effect, "axis", None)
    through_ball = axis is not None and zeros[axis - 1] < _ON_AXIS * zeros.max()
    if whole > _NOTHING and not own:
        return "the set-up takes it up: the ball's place and the gauges' zeros, which are always fitted"
    if through_ball:
        return f"the ball lies on axis {axis}"
    if LARGEST * whole < _NOTHING:
        return _IDLE.get(effect.effect, "nothing in these tests moves it").format(axis)
    return f"too small: even {LARGEST:g} times a healthy arm's stays below {DETECTABLE:g} sigma"


@dataclass(frozen=True)
class _Near:
    """Two candidates by number, the nearest of two names; how near, and how many others of these names are too."""

    sigma: float
    candidates: tuple[int, int]
    others: int


def _alike(candidates: Sequence[Candidate], apart: Array, sigma: Array) -> dict[tuple[str, str], _Near]:
    """Pairs of names nearer than ALIKE either way. Orders of one gear are no rivals of each other."""
    seen = np.array([shows(one) for one in sigma])
    near = np.minimum(apart, apart.T)
    alike: dict[tuple[str, str], _Near] = {}
    places = np.argwhere(np.triu(near < ALIKE, 1) & np.outer(seen, seen))
    for i, j in places[np.argsort(near[tuple(places.T)])].tolist():
        names = candidates[i].name, candidates[j].name
        first = alike.get(names)
        if first:
            alike[names] = replace(first, others=first.others + 1)
        elif names[0] != names[1]:
            alike[names] = _Near(float(near[i, j]), (i, j), 0)
    return alike


def _pair(near: _Near, candidates: Sequence[Candidate], further: tuple[Parting, ...]) -> Pair:
    first, second = (label_of(candidates[k].effect) for k in near.candidates)
    return Pair((first, second), near.sigma, near.others, further)


def _groups(pairs: Sequence[tuple[str, str]]) -> tuple[tuple[str, ...], ...]:
    """Names that hang together by pairs."""
    groups: list[list[str]] = []
    for pair in pairs:
        joined = [group for group in groups if set(group) & set(pair)]
        groups = [group for group in groups if group not in joined]
        groups.append(list(dict.fromkeys([name for group in joined for name in group] + list(pair))))
    return tuple(tuple(group) for group in groups)


def _best_first(found: Sequence[Parting]) -> tuple[Parting, ...]:
    return tuple(sorted(found, key=lambda one: -one.sigma))


@dataclass(frozen=True)
class _Further:
    """A test beyond those there are. choices: rigs set up for it, with the words for each; the first that the arm can
    drive is taken."""

    tests: tuple[TestName, ...]
    why: str
    choices: tuple[tuple[str, Rig], ...]


@dataclass(frozen=True)
class _Answer:
    """A further test in words, why it may help, and the products (p, p) of what is asked in it."""

    test: str
    why: str
    products: Array


def _answers(
    rig: Rig, tests: Sequence[TestName], runs: int, asked: _Signatures
) -> tuple[list[_Answer], list[tuple[str, str]]]:
    """Of each further test that the arm can drive, what it shows; and those that it cannot, with the reason."""
    answers, impossible = [], []
    for further in _further(rig, tests):
        refused = ""
        for words, moved in further.choices:
            try:
                view = _View(moved, further.tests, runs)
            except FileError as error:
                refused = refused or error.what
                continue
            answers.append(_Answer(words, further.why, asked.products(view)))
            break
        else:
            impossible.append((further.choices[0][0], refused))
    return answers, impossible


def _helps(
    answers: tuple[list[_Answer], list[tuple[str, str]]], asked: _Signatures, known: Array, pairs: int
) -> tuple[list[tuple[Parting, ...]], tuple[Gain, ...], tuple[tuple[str, str], ...]]:
    """What further tests do for the items asked: both of each pair first, then the hidden ones. Returns for each pair
    and each hidden one the tests, best first; what each test gains, the most first; and the impossible ones."""
    plausible = np.maximum(1.0, DETECTABLE / np.maximum(asked.lengths(known), _NOTHING))
    gains = []
    further: list[list[Parting]] = []
    for answer in answers[0]:
        length = asked.lengths(known + answer.products)
        apart = asked.apart(known + answer.products, length * plausible)
        parted = [float(min(apart[k, k + 1], apart[k + 1, k])) for k in range(0, 2 * pairs, 2)]
        shown = length[2 * pairs :].tolist()
        further.append([Parting(answer.test, sigma, answer.why) for sigma in (*parted, *shown)])
        gains.append(Gain(answer.test, answer.why, sum(map(parts, parted)), sum(map(shows, shown))))
    questions = range(len(asked.lengths(known)) - pairs)
    return (
        [_best_first([of_test[k] for of_test in further]) for k in questions],
        tuple(sorted(gains, key=lambda gain: -(gain.parts + gain.shows))),
        tuple(answers[1]),
    )


def _further(rig: Rig, tests: Sequence[TestName]) -> list[_Further]:
    """Tests that are not among `tests`, set-ups that the rig file does not have among them."""
    missing = tuple(test for test in _CIRCLES if test not in tests)
    found = []
    if missing and rig.tests.circle:
        words = f"{' and '.join(missing)} on the circle"
        found.append(_Further(missing, "the tool's other tilt", ((words, rig),)))
    if rig.tests.hemisphere:
        if "radial" not in tests:
            found.append(_Further(("radial",), "many postures, by distance alone", (("hemisphere (radial)", rig),)))
        if "repeatability" not in tests:
            found.append(_Further(("repeatability",), "the same places from both sides", (("repeatability", rig),)))
    # Of tests that add as much, the first is told: those of the rig file before set-ups of their own.
    return found + (_other_circles(rig, rig.tests.circle, tests) if rig.tests.circle else [])


def _other_circles(rig: Rig, circle: Circle, tests: Sequence[TestName]) -> list[_Further]:
    circles = tuple(test for test in _CIRCLES if test in tests) or _CIRCLES
    places = _places(rig, circle)
    found = []
    for radius in _RADII_MM:
        if abs(np.log(radius / circle.radius_mm)) > 0.2:
            words = f"circle of radius {radius:g} mm"
            choices = [(words, _with(rig, circle, radius_mm=radius))]
            choices += [(f"{words}, {w}", _with(rig, circle, radius_mm=radius, centre_mm=at)) for w, at in places]
            found.append(_Further(circles, "what an angle does grows with the radius, a length's not", tuple(choices)))
    elsewhere = tuple((f"circle {words}", _with(rig, circle, centre_mm=at)) for words, at in places)
    found.append(_Further(circles, "the posture is another, and with it what each joint and link does", elsewhere))
    speed = _FASTER * circle.speed_mm_s
    faster = ((f"circle at {speed:g} mm/s", _with(rig, circle, speed_mm_s=speed)),)
    found.append(_Further(circles, "what is late grows with the speed, a play or a length does not", faster))
    x, y, z = rig.robot.tool.xyz_mm
    if np.hypot(x, y) < _OFF_AXIS_MM / 2:
        tool = rig.robot.tool.model_copy(update={"xyz_mm": (x + _OFF_AXIS_MM, y, z)})
        beside = rig.model_copy(update={"robot": rig.robot.model_copy(update={"tool": tool})})
        words = f"circle with the ball {_OFF_AXIS_MM:g} mm off axis 6"
        found.append(_Further(circles, "the ball moves when axis 6 turns", ((words, beside),)))
    return found


def _with(rig: Rig, circle: Circle, **changed: Any) -> Rig:
    tests = rig.tests.model_copy(update={"circle": circle.model_copy(update=changed)})
    return rig.model_copy(update={"tests": tests})


def _places(rig: Rig, circle: Circle) -> list[tuple[str, tuple[float, ...]]]:
    """Centres aside of the circle's, in words: to axis 1 and away from it, along it down and up."""
    T, centre = transform(rig.robot.base), np.array(circle.centre_mm)
    up, out = T[:3, 2], centre - T[:3, 3]
    out = out - (out @ up) * up
    out /= max(float(np.linalg.norm(out)), 1e-9)
    ways = {"nearer to axis 1": -out, "lower": -up, "further from axis 1": out, "higher": up}
    return [(f"{_ASIDE_MM:g} mm {words}", tuple((centre + _ASIDE_MM * way).tolist())) for words, way in ways.items()]
