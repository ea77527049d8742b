"""Unknown causes: smooth random functions that compete with the named effects.

Such a cause is an error that varies smoothly with a quantity: angle, load, direction, speed, posture, time, or place.
Its functions are columns with normally distributed coefficients (a Gaussian process) and a common amplitude, over which
the evidence is averaged (Kennedy and O'Hagan 2001). The last kind is friction in the ball joint, a constant of each
circle.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.fit.background import CoefficientPosterior, cavity_evidence
from analysis.diagnosis.fit.responses import Linearisation, Response
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import Array, forward
from analysis.robot.predict import pull
from rigs.effects import changed

_UNIT_RAD, _UNIT_MM = np.radians(1e-3), 1e-3
"""Units of the columns: a thousandth of a degree and of a millimetre."""
_PRIOR = -2.0
"""Log prior odds of an unknown cause. Chosen: names of cells with known truth are equally likely from -3 to 0."""
_AMPLITUDES: Array = 2.0 ** np.arange(-3.0, 10.0)
"""Amplitudes in these units, from an eighth of a µm to half a millimetre."""
_WAVES = 24
"""Half waves over the range of a quantity, with an amplitude inversely proportional to the order, as for a random walk.
Chosen: fine enough for features of a few degrees.
"""
_POSTURE_RAD = (0.02, 0.3, 0.8, 2.0)
"""Lengths over which an error changes with the posture. Chosen: from each target by itself to half the range."""
_PLACE = (0.1, 0.3)
"""Lengths over which an error changes with the place, relative to the largest extent of the places. Chosen."""
_NEGLIGIBLE = 1e-3
"""Variance of a function relative to the largest below which it is omitted."""
_MOST = 100
"""Largest number of functions of postures or places for each coordinate. Chosen: some hundred places are usual."""
_SLOW = np.radians(0.2)
"""Speed in rad/s below which the direction of a joint is unclear. Chosen: a fraction of the slowest joint's."""

_Functions = Callable[[Block], Array]


@dataclass(frozen=True)
class UnknownCause:
    """A cause that rig does not know, at its likeliest amplitude."""

    kind: str
    """The quantity with which the error varies, as a noun phrase."""
    columns: Array
    """Columns (N, c) in standard deviations of the noise."""
    gain: float
    """Log evidence that it gains, after its price."""


@dataclass(frozen=True)
class UnknownCauses:
    """Kinds of unknown causes that runs may show, each with its response (N, c) at unit amplitude."""

    responses: dict[str, Response]
    at_rest: frozenset[str] = frozenset()
    """Kinds that only readings at rest show."""

    @classmethod
    def in_runs(cls, linear: Linearisation) -> Self:
        of_places = dict(_of_places(linear))
        kinds = dict([*_of_joints(linear), *_of_circles(linear)]) | of_places
        responses = {kind: Response(columns) for kind, columns in kinds.items() if np.any(columns)}
        return cls(responses, frozenset(of_places))

    def of_circles(self) -> Self:
        return type(self)({kind: each for kind, each in self.responses.items() if kind not in self.at_rest})

    @property
    def price(self) -> float:
        """Log evidence that a cause must gain to be likely: for the choice of kind and amplitude, and against the
        prior.
        """
        return float(np.log(len(self.responses) * len(_AMPLITUDES))) - _PRIOR

    def gains(self, posterior: CoefficientPosterior) -> dict[str, Array]:
        """Log evidence (a,) that each kind gains in addition to a state, with each amplitude."""
        return self.gains_of(posterior.cavities_within_limits([*self.responses.values()]))

    def gains_of(self, cavities: Sequence[tuple[Array, Array]]) -> dict[str, Array]:
        """The same, given the information of the readings about the columns of each kind."""
        gains = {}
        for kind, (products, slope) in zip(self.responses, cavities, strict=True):
            power, turn = np.linalg.eigh(products)
            seen = (turn.T @ slope) ** 2
            gains[kind] = cavity_evidence(np.maximum(power, 0.0), seen, np.square(_AMPLITUDES)[:, None])
        return gains

    def likeliest(self, posterior: CoefficientPosterior, excluded: Collection[str] = ()) -> UnknownCause | None:
        gains = {kind: gain for kind, gain in self.gains(posterior).items() if kind not in excluded}
        kind = likeliest_kind(gains)
        if kind is None:
            return None
        return UnknownCause(kind, self.likeliest_columns(kind, gains[kind]), float(gains[kind].max()) - self.price)

    def likeliest_columns(self, kind: str, gains: Array) -> Array:
        return np.asarray(_AMPLITUDES[np.argmax(gains)] * self.responses[kind].columns, dtype=float)


def likeliest_kind(gains: Mapping[str, Array]) -> str | None:
    return max(gains, key=lambda kind: float(gains[kind].max()), default=None)


def total_gain(gains: Mapping[str, Array]) -> float:
    """Log evidence of an unknown cause of any kind and amplitude after its prior odds; minus infinity without kinds."""
    if not gains:
        return -np.inf
    each = np.concatenate([*gains.values()])
    return _PRIOR + float(np.logaddexp.reduce(each) - np.log(len(each)))


def _of_joints(linear: Linearisation) -> Iterator[tuple[str, Array]]:
    """Errors of each joint that vary with its angle, load, direction or speed, or with the other angles."""
    q = np.concatenate([block.drives.q for block in linear.blocks])
    low, span = q.min(axis=0), np.maximum(np.ptp(q, axis=0), 1e-9)
    rests = not any(block.sampling for block in linear.blocks)

    def angle(joint: int, block: Block) -> Array:
        return _half_waves((block.drives.q[:, joint] - low[joint]) / span[joint], _UNIT_RAD)

    def direction(joint: int, block: Block) -> Array:
        ways, sides = np.zeros(block.drives.q.shape), block.table.sides
        if block.sampling:  # the direction of motion
            ways = np.tanh(_drive_rates(block) / _SLOW)
        elif sides is not None:  # that of the approach
            ways = np.repeat(sides * 1.0, len(ways) // len(sides), axis=0)
        return np.concatenate([_UNIT_RAD * ways, ways[:, [joint]] * angle(joint, block)[:, :8]], axis=1)

    joints = range(linear.axes)
    for joint in joints:
        by_joint, error = partial(linear.by_joint, joint + 1), f"an error of axis {joint + 1}"
        yield f"{error} over its angle", by_joint(partial(angle, joint))
        yield f"{error} over its load", by_joint(partial(_load, joint))
        yield f"{error} that depends on the directions of motion", by_joint(partial(direction, joint))
        yield f"{error} over its speed", by_joint(partial(_speed, joint))
        if rests:
            others = [by_joint(partial(angle, other))[:, :12] for other in joints if other != joint]
            yield f"{error} over the angles of other axes", np.concatenate(others, axis=1)
            yield f"an axis {joint + 1} that wanders while it turns", _wander(linear, joint, partial(angle, joint))


def _wander(linear: Linearisation, joint: int, angle: _Functions) -> Array:
    """Displacements and tilts (N, c) of a joint axis over its angle, as by its bearing, for runs at rest."""
    axes = [axis for axis in (joint + 1, joint + 2) if axis <= linear.axes]
    constants = [changed(axis, key, 0.1) for axis in axes for key in ("a_mm", "alpha_deg", "d_mm")]
    moved = linear.columns(constants) / 100  # of a micrometre or a thousandth of a degree
    samples = [angle(block)[block.samples, :8] / _UNIT_RAD for block in linear.blocks]
    waves = linear.at_entries([np.repeat(each, block.values.shape[1], axis=0)
                               for block, each in zip(linear.blocks, samples, strict=True)])  # fmt: skip
    return np.asarray((moved[:, :, None] * waves[:, None]).reshape(len(moved), -1), dtype=float)


def _load(joint: int, block: Block) -> Array:
    torque = torque_share(block, joint)
    return _half_waves((torque + 1) / 2, _UNIT_RAD)[:, :8] * torque.any()


def torque_share(block: Block, joint: int) -> Array:
    """Torque of gravity (n,) of a joint at the samples of a block's path, relative to its largest."""
    torque: Array = pull(block.model.arm, block.model.load, block.path.q).torque[:, joint]
    return torque / max(float(np.abs(torque).max()), 1e-12)


def _speed(joint: int, block: Block) -> Array:
    rate = np.abs(_drive_rates(block)[:, [joint]])
    return np.asarray(_UNIT_RAD * (rate / max(float(rate.max()), 1e-12)) ** np.array([0.5, 1.0, 2.0]), dtype=float)


def _of_circles(linear: Linearisation) -> Iterator[tuple[str, Array]]:
    """Errors of the gauges that vary with time, errors of the ball, and friction of the ball joint."""
    circles = [k for k, block in enumerate(linear.blocks) if block.sampling]
    if circles:
        both = [linear.by_gauge(shares, _times_of_lap) for shares in ((1.0, 0.0), (0.0, 1.0))]
        yield "a change of the gauges over time", np.concatenate(both, axis=1)
        of_ball = linear.by_gauge((1.0, 1.0), _circle_waves)
        yield "an error of the ball that varies with the position of the link", of_ball
        friction = np.zeros((len(linear.y), 2 * len(circles)))
        for column, k in enumerate(circles):
            constant = np.broadcast_to(_UNIT_MM * np.eye(2), (len(linear.blocks[k].values), 2, 2))
            friction[linear.rows[k], 2 * column : 2 * column + 2] = linear.blocks[k].whitened(constant)
        yield "friction in the ball joint", friction


def _of_places(linear: Linearisation) -> Iterator[tuple[str, Array]]:
    """Errors of readings at rest that vary with time, posture or place."""
    blocks = [block for block in linear.blocks if not block.sampling]
    if not blocks:
        return

    def order(block: Block) -> Array:
        return _half_waves(np.linspace(0, 1, len(block.path.q)), _UNIT_RAD)[:, :8] * (not block.sampling)

    by_order = [linear.by_joint(axis, order) for axis in range(1, linear.axes + 1)]
    yield "a change with time", np.concatenate(by_order, axis=1)
    for length in _POSTURE_RAD:
        postures = [block.table.q[block.rows] for block in blocks]
        yield f"an error that varies with the posture over {length:g} rad", _smooth(linear, postures, length)
    places = [block.values for block in blocks]
    if len(blocks) == len(linear.blocks) and all(block.facts.of_tracker for block in blocks):
        extent = max(float(np.ptp(place, axis=0).max()) for place in places)
        for share in _PLACE:
            kind = f"an error that varies with the place over {100 * share:.0f} % of the work"
            yield kind, _smooth(linear, places, share * extent)


def _smooth(linear: Linearisation, at: Sequence[Array], length: float) -> Array:
    """Functions (N, c) of each coordinate that change over a length of the points `at` (n, d) of each block at rest."""
    points = np.concatenate(at)
    squares = np.sum((points[:, None] - points[None]) ** 2, axis=2)
    values, turn = np.linalg.eigh(np.exp(-0.5 * squares / length**2))
    is_used = values > max(_NEGLIGIBLE * values[-1], np.sort(values)[-_MOST:][0] * (1 - 1e-9))
    functions = iter(np.split(_UNIT_MM * turn[:, is_used] * np.sqrt(values[is_used]), np.cumsum([*map(len, at)])[:-1]))
    most = max(block.values.shape[1] for block in linear.blocks)
    parts = []
    for block in linear.blocks:
        errors = np.zeros((len(block.y_mm), most * int(is_used.sum())))
        if not block.sampling:
            coordinates = np.eye(block.values.shape[1], most)
            errors = np.einsum("nc,ij->nijc", next(functions), coordinates)
            errors = block.whitened(errors.reshape(*block.values.shape, -1))
        parts.append(errors)
    return linear.at_entries(parts)


def _times_of_lap(block: Block) -> Array:
    t = block.path.t_s
    return _half_waves((t - t[0]) / (t[-1] - t[0]), _UNIT_MM) if block.sampling else np.zeros((len(t), _WAVES))


def _circle_waves(block: Block) -> Array:
    q = block.path.q
    if not block.sampling:
        return np.zeros((len(q), 2 * _WAVES))
    tool = forward(block.model.arm, q)[:, :3, 3]
    turned = frame_of(circle_of(block.model.rig)).angle(tool)[:, None] * np.arange(1, _WAVES + 1)
    waves = np.concatenate([np.cos(turned), np.sin(turned)], axis=1)
    return _UNIT_MM * waves / np.tile(np.arange(1, _WAVES + 1), 2)


def _half_waves(share: Array, unit: float) -> Array:
    number = np.arange(1, _WAVES + 1)
    return unit * np.cos(np.pi * number * np.clip(share, 0, 1)[:, None]) / number


def _drive_rates(block: Block) -> Array:
    drives = block.drives
    return np.gradient(drives.q, drives.t_s, axis=0) if block.sampling else np.zeros_like(drives.q)
