"""Responses: contributions of effects to the readings of blocks, in standard deviations of the noise and in µm."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.evidence.blocks import Block, SharedBlock, SimulatedBlock, recent
from analysis.diagnosis.evidence.known_distances import KnownDistances, known_distances_of
from analysis.diagnosis.evidence.observation import GRID, ORDER_OF
from analysis.diagnosis.evidence.setups import columns_of, moved_setup, tool_shift, without_origin
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.predict import ModelScene, SetUp, SetUps
from rigs.effects import Effect
from rigs.schema.effect import PHASE, Payload, name_of

# ----------------------------------------------------------------------------------------------------------------------
# Contributions of effects to the whitened readings, as objects with an identity: results computed from a response are
# cached with it.

_Kind = TypeVar("_Kind", bound=np.generic)
_KEPT = 2
"""Number of responses cached for each kind and effect, at some 4 MB each with their products: the latest two."""


@dataclass(frozen=True, eq=False)
class Response:
    """Whitened columns (N, k) of several terms, with an identity: products with other columns are cached with it."""

    columns: Array


@dataclass(frozen=True, eq=False)
class NearResponses:
    """The latest responses of effects, each also used for similar effects."""

    _kept: dict[tuple[str, str], list[tuple[Effect, Response]]] = field(default_factory=dict, init=False, repr=False)

    def of(self, kind: str, effect: Effect, steps: Mapping[str, float], compute: Callable[[], Array]) -> Response:
        """The latest response of this kind for an effect whose parameters differ by at most `steps`, else that of
        `compute`. Parameters not listed must be equal.
        """
        after = dict[str, Any](effect)

        def is_near(earlier: Effect) -> bool:
            for name, value in dict[str, Any](earlier).items():
                if name == "found" or value == after[name]:
                    continue
                if name not in steps:
                    return False
                apart = abs(value - after[name])  # for phases the smaller angle
                if (min(apart % 360, -apart % 360) if name == PHASE else apart) > steps[name]:
                    return False
            return True

        kept = self._kept.setdefault((kind, name_of(effect)), [])
        near = next((response for response in kept if is_near(response[0])), None)
        if near is None:
            near = (effect, Response(compute()))
        else:
            kept.remove(near)
        kept.insert(0, near)
        del kept[_KEPT:]
        return near[1]


# ----------------------------------------------------------------------------------------------------------------------
# Linearisation: contributions of effects to the residuals of blocks, in standard deviations of the noise, either singly
# as columns or all together on the simulator.

_INDISTINCT = {"ball": 0.05, "poses": 0.005}
"""Singular value of a combination of set-up terms, relative to the largest, below which the combination stays fixed.

A shift of the ball along the normal of the circle has a thousandth of the influence of a shift in the plane. If it were
free, other errors would move the ball by millimetres. Other terms have at least a tenth; instrument and tool of poses
have a hundredth if each axis turns by 0.3 rad in both directions.
"""
_STEPS, _NEAR_MM = 6, 0.05
"""Largest number of steps in a fit of set-ups, and length of a step below which the fit ends.

A length error of 8 mm moves the ball as far, and the first step ends 0.5 mm from the final position. Over 0.05 mm, a
circle of 70 mm radius is nonlinear by less than 0.02 µm.
"""
_NEAR_BALL_MM = 0.3
"""Distance of a ball from the linearisation point within which readings are linear, to 0.7 µm at a radius of 70 mm."""
_BENT = 0.3
"""Largest rms nonlinearity over a move of instrument and target, in noise standard deviations. Chosen: it adds a tenth
to the variance of the noise.
"""
_FAR_MM = 1.0
"""Displacement of the tool above which a ball that did not follow is also tried: a circle of 70 mm is then nonlinear by
7 µm.
"""


_FITS = 16
"""Number of cached residuals of effects, at some 40 kB each."""


@dataclass(frozen=True)
class Linearisation:
    """Blocks simulated about a model and its set-ups, with the residual `y_mm` (n,) of each block.

    N counts the entries of all blocks, followed by the known distances of sockets, in standard deviations of the noise.
    `near` caches results of fits; `unlimited` names effects without a size limit in fits.
    """

    simulated: tuple[SimulatedBlock, ...]
    y_mm: tuple[Array, ...]
    unlimited: frozenset[str] = frozenset()
    near: NearResponses = field(default_factory=NearResponses, init=False, repr=False)
    _fits: dict[tuple[Effect, ...], tuple[Array, Array]] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        return tuple(simulated.block for simulated in self.simulated)

    @cached_property
    def setups(self) -> dict[str, SetUp]:
        return {simulated.block.setup: simulated.setup for simulated in self.simulated}

    @cached_property
    def y(self) -> Array:
        """The residual (N,) with the reference effects."""
        white = [block.white(y_mm) for block, y_mm in zip(self.blocks, self.y_mm, strict=True)]
        return self.at_entries(white, self.distances.residual(self.setups))

    @property
    def axes(self) -> int:
        return self.blocks[0].model.arm.axes

    @property
    def payload(self) -> Payload:
        return self.blocks[0].model.load.payload

    @property
    def reference(self) -> tuple[Effect, ...]:
        """Effects of the model in addition to the effects of the rig file."""
        return self.simulated[0].reference

    @cached_property
    def distances(self) -> KnownDistances:
        """Known distances of sockets; their entries follow the entries of the blocks."""
        return known_distances_of(self.blocks)

    def at_entries(self, parts: Sequence[NDArray[_Kind]], of_distances: Array | float = 0.0) -> NDArray[_Kind]:
        """Join values of the entries (n, …) of each block to (N, …), followed by those of the known distances, which an
        error of the arm does not change.
        """
        added = np.zeros((len(self.distances.pairs), *parts[0].shape[1:]), dtype=parts[0].dtype)
        added[...] = of_distances
        return np.concatenate([*parts, added])

    @cached_property
    def rows(self) -> list[slice]:
        """Entries of each block."""
        ends = np.cumsum([0, *(len(block.y_mm) for block in self.blocks)]).tolist()
        return [slice(begin, end) for begin, end in pairwise(ends)]

    @property
    def of_distances(self) -> slice:
        return slice(self.rows[-1].stop, None)

    @cached_property
    def band(self) -> Integers:
        """Index (N,) of the band of each entry; known distances have their own."""
        return self.at_entries(
            bands := [block.band for block in self.blocks], 1 + max(int(band.max()) for band in bands)
        )

    @cached_property
    def terms(self) -> dict[str, list[int]]:
        """Columns of U for each set-up."""
        return columns_of({block.setup: block.table for block in self.blocks})

    @cached_property
    def U(self) -> Array:  # noqa: N802 - a matrix
        columns = np.zeros((len(self.y), 1 + max(map(max, self.terms.values()))))
        for simulated, rows in zip(self.simulated, self.rows, strict=True):
            columns[rows, self.terms[simulated.block.setup]] = simulated.by_setup
        columns[self.of_distances] = self.distances.by_setup(self.setups, self.terms, columns.shape[1])
        return columns

    @cached_property
    def Z(self) -> Array:  # noqa: N802 - a matrix
        """Change (N, c) for a standard deviation of the scatter between runs, and of each known distance."""
        scatter = self._side_by_side([block.white(block.scatter_mm) for block in self.blocks])
        of_distances = self.distances.scatter
        columns = np.zeros((len(self.y), of_distances.shape[1]))
        columns[self.of_distances] = of_distances
        return np.concatenate([scatter, columns], axis=1)

    @cached_property
    def stamps(self) -> Array:
        """Change (N, s) for a standard deviation of late stamps during fast changes of the readings."""
        return self._side_by_side([block.white(block.stamps_mm) for block in self.blocks])

    def _side_by_side(self, parts: Sequence[Array]) -> Array:
        ends = np.cumsum([0, *(part.shape[1] for part in parts)])
        columns = np.zeros((len(self.y), int(ends[-1])))
        for part, rows, begin, end in zip(parts, self.rows, ends, ends[1:], strict=False):
            columns[rows, begin:end] = part
        return columns

    @cached_property
    def _best_moves(self) -> Array:
        moves = np.zeros(self.U.T.shape)
        poses = sorted(self.terms_of_poses)
        balls = [terms for terms in self.terms.values() if not self.terms_of_poses.issuperset(terms)]
        for terms in balls:
            moves[terms] = np.linalg.pinv(self.U[:, terms], rcond=_INDISTINCT["ball"])
        if poses:  # placements share the tool
            moves[poses] = np.linalg.pinv(self.U[:, poses], rcond=_INDISTINCT["poses"])
        return moves

    @cached_property
    def terms_of_poses(self) -> set[int]:
        poses = [block.setup for block in self.blocks if block.facts.of_places]
        return {term for name in poses for term in self.terms[name]}

    def is_straight(self, moves: Array) -> bool:
        """Whether readings are nearly linear over moves of set-ups (s,) mm.

        A ball is judged by its displacement. An instrument and its target are judged by the readings: if the last axis
        has few directions, both may move far while the readings hardly change.
        """
        poses = self.terms_of_poses
        balls = [term for terms in self.terms.values() for term in terms[:3] if term not in poses]
        if balls and float(np.abs(moves[balls]).max()) >= _NEAR_BALL_MM:
            return False
        if not poses:
            return True
        of_poses = np.where(np.isin(np.arange(len(moves)), sorted(poses)), moves, 0.0)
        scenes = self._scenes(())
        moved, unmoved = (
            self._residual_in((), scenes, self.setups_moved_by(terms)) for terms in (of_poses, np.zeros_like(of_poses))
        )
        entries = sum(len(block.y_mm) for block in self.blocks if block.facts.of_places)
        return bool(np.linalg.norm(moved - unmoved + self.U @ of_poses) <= _BENT * np.sqrt(entries))

    @cached_property
    def _basis(self) -> Array:
        return basis_of(self.U)

    def columns(self, effects: Sequence[Effect]) -> Array:
        """Responses (N, p) of the whitened readings to the effects."""
        if not effects:
            return np.empty((len(self.y), 0))
        return self.at_entries([simulated.columns(effects) for simulated in self.simulated])

    def residual(self, effects: Sequence[Effect]) -> Array:
        """Whitened residual (N,) with `effects` in place of the reference effects, all simulated together.

        A large effect moves the ball by a millimetre, over which readings are not linear. They are therefore simulated
        with the best-fitting set-ups, and converted to those of this linearisation along their slopes.
        """
        return self._best_fit(effects)[0]

    def contributions(self, effects: Sequence[Effect], residual: Array) -> list[Array]:
        """Additional contribution of each effect, (N,) each, given the residual (N,) with all effects."""
        return [self.residual([*effects[:k], *effects[k + 1 :]]) - residual for k in range(len(effects))]

    def moves_with(self, effects: Sequence[Effect]) -> Array:
        """Terms of the set-ups (s,) mm that fit the readings best with `effects` in place of the reference effects.
        Hardly visible combinations of terms follow the tool.
        """
        return self._best_fit(effects)[1].copy()

    def _best_fit(self, effects: Sequence[Effect]) -> tuple[Array, Array]:
        """`residual` and `moves_with`, cached because fits, searches and verdicts need both."""

        def compute() -> tuple[Array, Array]:
            scenes = self._scenes(effects)
            starts = [self._moves_with_tool(scenes)]
            if np.abs(starts[0]).max() > _FAR_MM:
                # After a collision, and in simulated runs, the ball has not moved.
                starts.append(np.zeros_like(starts[0]))
            fits = []
            for start in starts:
                moves = start
                residual = self._residual_in(effects, scenes, self.setups_moved_by(moves))
                for _ in range(_STEPS):
                    step = self._best_moves @ residual
                    if np.abs(step).max() < _NEAR_MM:
                        break
                    nearer = self._residual_in(effects, scenes, self.setups_moved_by(moves + step))
                    if nearer @ nearer >= residual @ residual:
                        break
                    moves, residual = moves + step, nearer
                fits.append((residual, moves))
            residual, moves = min(fits, key=lambda fit: float(np.sum(self.without_set_up(fit[0]) ** 2)))
            return residual + self.U @ moves, moves

        return recent(self._fits, tuple(map(without_origin, effects)), compute, _FITS)

    def _scenes(self, effects: Sequence[Effect]) -> list[ModelScene]:
        return [simulated.scene_with(effects) for simulated in self.simulated]

    def _moves_with_tool(self, scenes: Sequence[ModelScene]) -> Array:
        """Changes (s,) mm of the set-ups if each ball is displaced as far as the tool in new scenes."""
        moves, count = np.zeros(self.U.shape[1]), Counter(simulated.block.setup for simulated in self.simulated)
        for simulated, scene in zip(self.simulated, scenes, strict=True):
            seen = simulated.block
            if not seen.facts.of_places:
                moves[self.terms[seen.setup][:3]] += tool_shift(seen, simulated.scene, scene) / count[seen.setup]
        return moves

    def responses(self, effects: Sequence[Effect], setups: SetUps | None = None) -> list[Array]:
        """Contribution of `effects`, in place of the reference effects, to the entries (N,) mm of each block. By
        default each ball follows the tool.
        """
        scenes = self._scenes(effects)
        return self._responses(effects, scenes, setups or self.setups_moved_by(self._moves_with_tool(scenes)))

    def _responses(self, effects: Sequence[Effect], scenes: Sequence[ModelScene], setups: SetUps) -> list[Array]:
        both = zip(self.simulated, scenes, strict=True)
        return [
            simulated.block.entries(simulated.read(effects, scene, setups[simulated.block.setup]) - simulated.base)
            for simulated, scene in both
        ]

    def _residual_in(self, effects: Sequence[Effect], scenes: Sequence[ModelScene], setups: SetUps) -> Array:
        added = zip(self.blocks, self._responses(effects, scenes, setups), strict=True)
        apart = self.distances.residual(self.setups) - self.distances.residual(setups)
        return self.y - self.at_entries([block.white(entries) for block, entries in added], apart)

    def simulated_with(self, effects: Sequence[Effect]) -> Linearisation:
        """The same runs with noise-free readings simulated with `effects` in place of the reference effects."""
        return replace(self, y_mm=tuple(self.responses(effects)))

    def without_set_up(self, values: Array) -> Array:
        """Remove the part of whitened values (N, …) that set-ups could absorb."""
        return values - self._basis @ (self._basis.T @ values)

    def setups_moved_by(self, change: Array) -> dict[str, SetUp]:
        """Set-ups with their terms moved by (s,) mm."""
        tables = {block.setup: block.table for block in self.blocks}
        return {name: moved_setup(self.setups[name], table, change[self.terms[name]]) for name, table in tables.items()}

    def in_mm(self, residual: Array) -> list[Array]:
        return [(residual[rows].T * block.sd_mm).T for rows, block in zip(self.rows, self.blocks, strict=True)]

    def by_joint(self, axis: int, off: Callable[[Block], Array]) -> Array:
        """Change (N, c) of the whitened readings for errors (n, c) rad of a joint (1 … 6) at the samples of each
        block's path.
        """
        return self.at_entries([simulated.by_joint(axis, off(simulated.block)) for simulated in self.simulated])

    def retimed(self, effect: Effect) -> Array:
        """Change (N, c + 1) of the whitened readings if each of c timing effects delays the joint errors of an effect,
        and if sample times scatter.
        """
        return self.at_entries([simulated.retimed(effect) for simulated in self.simulated])

    def by_gauge(self, shares: Sequence[float], off: Callable[[Block], Array]) -> Array:
        """Change (N, c) of the whitened readings for gauge errors: `shares` (2,) times (n, c) mm at the samples of each
        circle.
        """
        parts = []
        for block in self.blocks:
            each = np.array(shares) if block.sampling else np.zeros(block.values.shape[1])
            parts.append(block.whitened(each[:, None] * off(block)[block.samples, None]))
        return self.at_entries(parts)

    def jolt(self, k: int, axis: int, sample: int, angle_deg: float) -> Array:
        """Change (N,) of the whitened readings for an error in degrees of a joint (1 … 6) at a single sample of block
        k.
        """
        off = np.zeros((len(self.blocks[k].path.q), 1))
        off[sample] = np.radians(angle_deg)
        whole = np.zeros(len(self.y))
        whole[self.rows[k]] = self.simulated[k].by_joint(axis, off)[:, 0]
        return whole


def linearise(
    blocks: Sequence[Block],
    setups: SetUps,
    effects: Sequence[Effect] = (),
    unlimited: frozenset[str] = frozenset(),
) -> Linearisation:
    """Linearise blocks about set-ups. `effects`, found in earlier rounds, join the rig file's; the residuals exclude
    them.
    """
    simulated = tuple(SimulatedBlock(block, tuple(effects), setups[block.setup]) for block in blocks)
    return Linearisation(simulated, tuple(block.y_mm for block in blocks), unlimited)


def extend_linearisation(shared: Sequence[SharedBlock], blocks: Sequence[Block], setups: SetUps) -> Linearisation:
    """Linearise shared blocks together with further blocks."""
    simulated = (*shared, *(SimulatedBlock(block, (), setups[block.setup]) for block in blocks))
    return Linearisation(simulated, tuple(each.block.y_mm for each in simulated))


def basis_of(columns: Array) -> Array:
    """Orthonormal basis (N, r) of columns (N, s), ignoring zero columns."""
    basis, _ = np.linalg.qr(columns[:, np.linalg.norm(columns, axis=0) > 0])
    return basis


# ----------------------------------------------------------------------------------------------------------------------
# Worth of a name in µm: the rms change of the readings beyond the part that a set-up could absorb.

LEAST_MATERIAL_UM = 3.0
"""Smallest material change: the resolution of the best gauges of such a link."""


@dataclass(frozen=True)
class RmsByBlock:
    """Root mean square in µm, by block (b,), of a change of the readings."""

    um: Array

    @property
    def whole_um(self) -> float:
        return float(np.sqrt(np.mean(self.um**2)))

    def is_material(self, limits_um: Array) -> bool:
        return bool((self.um > limits_um).any())


def rms_by_block(linear: Linearisation, change: Array) -> RmsByBlock:
    """RMS of a change (N,) of whitened readings beyond what set-ups fitted to it absorb."""
    return plain_rms_by_block(linear, linear.without_set_up(change))


def plain_rms_by_block(linear: Linearisation, change: Array) -> RmsByBlock:
    """RMS of a change (N,) of whitened readings, with the set-ups held fixed."""
    return RmsByBlock(np.array([rms_um(*both) for both in zip(linear.blocks, linear.in_mm(change), strict=True)]))


def limits_um(linear: Linearisation) -> Array:
    """Changes (b,) µm from which a named effect is material: the scatter of a run without stamp noise."""
    return np.maximum(_scatter_um(linear, [block.steady_mm for block in linear.blocks]), LEAST_MATERIAL_UM)


def noise_um(linear: Linearisation) -> Array:
    """RMS difference (b,) µm of a run from the mean of many, including stamp noise. At targets it is that of a median
    target, because a few scatter many times as much.
    """
    return _scatter_um(linear, [block.apart_mm for block in linear.blocks])


def _scatter_um(linear: Linearisation, deviations: Sequence[Array]) -> Array:
    """RMS difference (b,) µm of a run from the mean of many: of repeated circles as their deviations (n, N) mm show,
    else from noise and scatter.
    """
    # Contribution of noise and scatter, with the set-up fitted to it.
    whole = linear.in_mm(np.sqrt(1 + (linear.without_set_up(linear.Z) ** 2).sum(axis=1)))
    squares = np.empty(len(linear.blocks))
    shown: dict[str, list[float]] = {}
    for k, (block, entries, apart) in enumerate(zip(linear.blocks, whole, deviations, strict=True)):
        usual = entries if block.sampling else np.full(len(entries), np.median(entries))
        squares[k] = rms_um(block, np.sqrt(block.count) * usual) ** 2
        if block.sampling and apart.any():
            single = [rms_um(block, each) ** 2 for each in apart]
            shown.setdefault(block.setup, []).append(sum(single) / (len(single) - 1))
    for k, block in enumerate(linear.blocks):
        if block.sampling and deviations[k].any():
            squares[k] = np.mean(shown[block.setup])
    return np.sqrt(squares)


def rms_um(block: Block, entries_mm: Array) -> float:
    """RMS in µm of a block's entries (N,) mm: per reading of a gauge, and per distance of poses."""
    if block.sampling:
        energy, count = float((entries_mm[: len(ORDER_OF)] ** 2).sum()), 2 * GRID
    else:
        energy = float((entries_mm**2).sum())
        count = len(entries_mm) // (3 if block.facts.of_places else 1)
    return 1e3 * float(np.sqrt(energy / count))
