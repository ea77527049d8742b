"""Responses: what effects add to the readings of blocks, in standard deviations of the noise and in µm."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.evidence.blocks import Block, SharedBlock, SimulatedBlock, recent
from analysis.diagnosis.evidence.known_distances import KnownDistances, known_distances_of
from analysis.diagnosis.evidence.observation import GRID, ORDER_OF
from analysis.diagnosis.evidence.setups import columns_of, moved_setup, tool_shift, without_origin
from analysis.procedures.facts import facts_of
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.model.predict import SetUp
from analysis.robot.model.scene import Scene
from rigs.effects import Effect
from rigs.schema.effect import PHASE, name_of

# ----------------------------------------------------------------------------------------------------------------------
# What effects add to the whitened readings, as objects that can be recognised: what was computed from one is kept.

_Kind = TypeVar("_Kind", bound=np.generic)
_KEPT = 4
"""Responses that are kept for each kind and name, at some 4 MB each with their products: about as many as the fits of
one round begin from."""


@dataclass(frozen=True, eq=False)
class Response:
    """What some terms add to the whitened readings: columns (N, k). Its products with other columns are kept for as
    long as it is."""

    columns: Array


@dataclass(frozen=True, eq=False)
class NearResponses:
    """The latest responses of effects, of which each stands for those of all effects near its own: derivatives and
    departures change little over a small part of a size."""

    _kept: dict[tuple[str, str], list[tuple[Effect, Response]]] = field(default_factory=dict, init=False, repr=False)

    def of(self, kind: str, effect: Effect, steps: Mapping[str, float], compute: Callable[[], Array]) -> Response:
        """Return the response of one kind of the latest effect whose parameters differ by at most `steps`, in their
        units, or compute its whitened columns (N, k). Parameters without a step do not differ."""
        after = dict[str, Any](effect)

        def is_near(earlier: Effect) -> bool:
            for name, value in dict[str, Any](earlier).items():
                if name == "found" or value == after[name]:
                    continue
                if name not in steps:
                    return False
                apart = abs(value - after[name])  # of phases the smaller way round
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
# The linearisation: what effects add to the residuals of blocks, in standard deviations of the noise, either one by
# one as columns or all together on the simulator.

_INDISTINCT = {"ball": 0.05, "poses": 0.005}
"""Singular value of a combination of terms of set-ups, as a share of the largest, below which it is not moved. A ball
along the normal of its circle shows a thousandth of what it shows across, and a fiftieth where the circle is eccentric
by 1 mm, so other errors would move it by millimetres; its other terms show a tenth, those of a hemisphere 0.29.
Instrument and tool of poses show a hundredth where each axis turns by 0.3 rad either way."""
_STEPS, _NEAR_MM = 6, 0.05
"""Largest number of steps in which set-ups are fitted, and the length of a step after which no further one is taken:
over 0.05 mm a circle of 70 mm radius bends by less than 0.02 µm. An arm whose length is 8 mm wrong moves the ball by as
much, and the first step ends 0.5 mm beside the place."""
_NEAR_BALL_MM = 0.3
"""Length by which a ball may move from the place about which readings are linear. Over 0.3 mm a circle of 70 mm radius
bends by less than 0.7 µm."""
_BENT = 0.3
"""Root mean square, in standard deviations of the noise, by which readings may bend over a move of instrument and
target. Chosen: it adds a tenth to the variance of the noise."""
_FAR_MM = 1.0
"""Way of a tool from which a ball that stays behind is tried too. Over 1 mm a circle of 70 mm radius bends by 7 µm."""


_FITS = 16
"""Residuals of effects that are kept, at some 40 kB each."""


@dataclass(frozen=True)
class Linearisation:
    """Blocks simulated about a model and its set-ups, and the residual `y_mm` (n,) of each; N counts the entries of all
    blocks and then the known distances of sockets, in standard deviations of the noise. `near` keeps what fits have
    computed of effects, and `unlimited` names the effects whose size a fit does not limit."""

    simulated: tuple[SimulatedBlock, ...]
    y_mm: tuple[Array, ...]
    unlimited: frozenset[str] = frozenset()
    near: NearResponses = field(default_factory=NearResponses, init=False, repr=False)
    _fits: dict[tuple[Effect, ...], tuple[Array, Array]] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The blocks."""
        return tuple(simulated.block for simulated in self.simulated)

    @cached_property
    def setups(self) -> dict[str, SetUp]:
        """The set-ups by their names."""
        return {simulated.block.setup: simulated.setup for simulated in self.simulated}

    @cached_property
    def y(self) -> Array:
        """The residual (N,) with the reference effects."""
        white = [block.white(y_mm) for block, y_mm in zip(self.blocks, self.y_mm, strict=True)]
        return self.at_entries(white, self.distances.residual(self.setups))

    @property
    def axes(self) -> int:
        """The number of joints of the arm."""
        return self.blocks[0].model.arm.axes

    @property
    def payload_kg(self) -> float:
        """What the rig file states to hang at the flange, 0 where it does not."""
        return self.blocks[0].model.load.payload_kg

    @property
    def reference(self) -> tuple[Effect, ...]:
        """The effects beside those of the rig file that are part of the model."""
        return self.simulated[0].reference

    @cached_property
    def distances(self) -> KnownDistances:
        """The known distances of sockets, whose entries follow those of the blocks."""
        return known_distances_of(self.blocks)

    def at_entries(self, parts: Sequence[NDArray[_Kind]], of_distances: Array | float = 0.0) -> NDArray[_Kind]:
        """Return values of the entries (n, …) of each block, in any unit, as those of all entries (N, …), with values
        (t, …) of the known distances after them; an error of the arm changes none of these."""
        added = np.zeros((len(self.distances.pairs), *parts[0].shape[1:]), dtype=parts[0].dtype)
        added[...] = of_distances
        return np.concatenate([*parts, added])

    @cached_property
    def rows(self) -> list[slice]:
        """The entries of each block."""
        ends = np.cumsum([0, *(len(block.y_mm) for block in self.blocks)]).tolist()
        return [slice(begin, end) for begin, end in pairwise(ends)]

    @property
    def of_distances(self) -> slice:
        """The entries of the known distances of sockets."""
        return slice(self.rows[-1].stop, None)

    @cached_property
    def band(self) -> Integers:
        """The number (N,) of the band of each entry; known distances have one of their own."""
        return self.at_entries(
            bands := [block.band for block in self.blocks], 1 + max(int(band.max()) for band in bands)
        )

    @cached_property
    def terms(self) -> dict[str, list[int]]:
        """The columns of U that belong to each set-up."""
        return columns_of({block.setup: block.table for block in self.blocks})

    @cached_property
    def U(self) -> Array:  # noqa: N802 - a matrix
        """The change (N, s) for a mm of each set-up term."""
        columns = np.zeros((len(self.y), 1 + max(map(max, self.terms.values()))))
        for simulated, rows in zip(self.simulated, self.rows, strict=True):
            columns[rows, self.terms[simulated.block.setup]] = simulated.by_setup
        columns[self.of_distances] = self.distances.by_setup(self.setups, self.terms, columns.shape[1])
        return columns

    @cached_property
    def Z(self) -> Array:  # noqa: N802 - a matrix
        """The change (N, c) for one standard deviation of the scatter between runs, and for one standard uncertainty of
        each known distance."""
        scatter = self._side_by_side([block.white(block.scatter_mm) for block in self.blocks])
        of_distances = self.distances.scatter
        columns = np.zeros((len(self.y), of_distances.shape[1]))
        columns[self.of_distances] = of_distances
        return np.concatenate([scatter, columns], axis=1)

    @cached_property
    def stamps(self) -> Array:
        """The change (N, s) for one standard deviation of the scatter of stamps, where readings change quickly."""
        return self._side_by_side([block.white(block.stamps_mm) for block in self.blocks])

    def _side_by_side(self, parts: Sequence[Array]) -> Array:
        """Return columns (N, c) with the columns of each block in its own rows."""
        ends = np.cumsum([0, *(part.shape[1] for part in parts)])
        columns = np.zeros((len(self.y), int(ends[-1])))
        for part, rows, begin, end in zip(parts, self.rows, ends, ends[1:], strict=False):
            columns[rows, begin:end] = part
        return columns

    @cached_property
    def _best_moves(self) -> Array:
        """The terms of the set-ups (s, N) mm that fit whitened readings best."""
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
        """The columns of U that belong to placements of poses."""
        poses = [block.setup for block in self.blocks if facts_of(block.table.test).of_places]
        return {term for name in poses for term in self.terms[name]}

    def is_straight(self, moves: Array) -> bool:
        """Return whether readings hardly bend over moves of set-ups (s,) mm.

        A ball is judged by its way; in the zeros of gauges readings are linear. An instrument and its target are
        judged by the readings: where the last axis points in few directions both move far, and the readings hardly.
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
        entries = sum(len(block.y_mm) for block in self.blocks if facts_of(block.table.test).of_places)
        return bool(np.linalg.norm(moved - unmoved + self.U @ of_poses) <= _BENT * np.sqrt(entries))

    @cached_property
    def _basis(self) -> Array:
        """An orthonormal basis (N, s) of what set-ups could absorb."""
        return basis_of(self.U)

    def columns(self, effects: Sequence[Effect]) -> Array:
        """Return the responses (N, p) of the whitened readings to the effects."""
        if not effects:
            return np.empty((len(self.y), 0))
        return self.at_entries([simulated.columns(effects) for simulated in self.simulated])

    def residual(self, effects: Sequence[Effect]) -> Array:
        """Return the whitened residual (N,) with `effects` in place of the reference ones, all of them on the simulator
        together.

        A large effect moves the ball by a millimetre, over which readings are not linear. So they are simulated where
        the set-ups fit best with these effects, and taken back to the set-ups of this linearisation along their slopes.
        """
        return self._best_fit(effects)[0]

    def contributions(self, effects: Sequence[Effect], residual: Array) -> list[Array]:
        """Return what each of some effects adds to the whitened readings beside the others, (N,) each, given the
        residual (N,) with all of them."""
        return [self.residual([*effects[:k], *effects[k + 1 :]]) - residual for k in range(len(effects))]

    def moves_with(self, effects: Sequence[Effect]) -> Array:
        """Return the terms of the set-ups (s,) mm that fit the readings best with `effects` in place of the reference
        ones. Combinations of terms that hardly show go where the tool goes."""
        return self._best_fit(effects)[1].copy()

    def _best_fit(self, effects: Sequence[Effect]) -> tuple[Array, Array]:
        """Return `residual` and `moves_with`, which fits, searches and verdicts ask of the same effects in turn."""

        def compute() -> tuple[Array, Array]:
            scenes = self._scenes(effects)
            starts = [self._moves_with_tool(scenes)]
            if np.abs(starts[0]).max() > _FAR_MM:
                # After a collision, and where runs are simulated, the ball stands where it stood.
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

    def _scenes(self, effects: Sequence[Effect]) -> list[Scene]:
        """Return the scene of each block up to the tool with `effects` in place of the reference ones."""
        return [simulated.scene_with(effects) for simulated in self.simulated]

    def _moves_with_tool(self, scenes: Sequence[Scene]) -> Array:
        """Return the terms of the set-ups (s,) mm with each ball moved as far as the tool is moved in new scenes."""
        moves, count = np.zeros(self.U.shape[1]), Counter(simulated.block.setup for simulated in self.simulated)
        for simulated, scene in zip(self.simulated, scenes, strict=True):
            seen = simulated.block
            if not facts_of(seen.table.test).of_places:
                moves[self.terms[seen.setup][:3]] += tool_shift(seen, simulated.scene, scene) / count[seen.setup]
        return moves

    def responses(self, effects: Sequence[Effect], setups: Mapping[str, SetUp] | None = None) -> list[Array]:
        """Return what `effects`, in place of the reference ones, add to the entries (N,) mm of each block, in given
        set-ups or, without these, with each ball moved as far as the tool."""
        scenes = self._scenes(effects)
        return self._responses(effects, scenes, setups or self.setups_moved_by(self._moves_with_tool(scenes)))

    def _responses(
        self, effects: Sequence[Effect], scenes: Sequence[Scene], setups: Mapping[str, SetUp]
    ) -> list[Array]:
        """Return what `effects` add to the entries (N,) mm of each block, given the scenes with them."""
        both = zip(self.simulated, scenes, strict=True)
        return [
            simulated.block.entries(simulated.read(effects, scene, setups[simulated.block.setup]) - simulated.base)
            for simulated, scene in both
        ]

    def _residual_in(self, effects: Sequence[Effect], scenes: Sequence[Scene], setups: Mapping[str, SetUp]) -> Array:
        """Return the whitened residual (N,) with `effects` in given set-ups."""
        added = zip(self.blocks, self._responses(effects, scenes, setups), strict=True)
        apart = self.distances.residual(self.setups) - self.distances.residual(setups)
        return self.y - self.at_entries([block.white(entries) for block, entries in added], apart)

    def simulated_with(self, effects: Sequence[Effect]) -> Linearisation:
        """Return the linearisation of the same runs with readings simulated with `effects` in place of the reference
        ones and without noise; y is (N,)."""
        return replace(self, y_mm=tuple(self.responses(effects)))

    def without_set_up(self, values: Array) -> Array:
        """Return whitened values (N, …) with the part removed that set-ups could absorb."""
        return values - self._basis @ (self._basis.T @ values)

    def setups_moved_by(self, change: Array) -> dict[str, SetUp]:
        """Return the set-ups with their terms moved by (s,) mm."""
        tables = {block.setup: block.table for block in self.blocks}
        return {name: moved_setup(self.setups[name], table, change[self.terms[name]]) for name, table in tables.items()}

    def in_mm(self, residual: Array) -> list[Array]:
        """Return whitened values (N, …) as the entries of each block in mm."""
        return [(residual[rows].T * block.sd_mm).T for rows, block in zip(self.rows, self.blocks, strict=True)]

    def by_joint(self, axis: int, off: Callable[[Block], Array]) -> Array:
        """Return the change (N, c) of the whitened readings for errors (n, c) rad of a joint (1 … 6) at the samples of
        each block's path."""
        return self.at_entries([simulated.by_joint(axis, off(simulated.block)) for simulated in self.simulated])

    def late(self, effect: Effect) -> Array:
        """Return the change (N, c) of the whitened readings if the errors of joints that an effect makes come as much
        later as each of c effects of the stamps has everything, at its healthy size."""
        return self.at_entries([simulated.late(effect) for simulated in self.simulated])

    def scattered(self, effect: Effect) -> Array:
        """Return the change (N, 1) of the whitened readings if the errors of joints that an effect makes are on average
        those of stamps that scatter."""
        return self.at_entries([simulated.scattered(effect) for simulated in self.simulated])

    def by_gauge(self, shares: Sequence[float], off: Callable[[Block], Array]) -> Array:
        """Return the change (N, c) of the whitened readings for errors of the gauges: `shares` (2,) times (n, c) mm at
        the samples of each circle's path, and zero for other tests."""
        parts = []
        for block in self.blocks:
            each = np.array(shares) if block.sampling else np.zeros(block.values.shape[1])
            parts.append(block.whitened(each[:, None] * off(block)[block.samples, None]))
        return self.at_entries(parts)

    def jolt(self, k: int, axis: int, sample: int, angle_deg: float) -> Array:
        """Return the change (N,) of the whitened readings for an error of one joint (1 … 6) at a single sample of one
        block's path."""
        off = np.zeros((len(self.blocks[k].path.q), 1))
        off[sample] = np.radians(angle_deg)
        whole = np.zeros(len(self.y))
        whole[self.rows[k]] = self.simulated[k].by_joint(axis, off)[:, 0]
        return whole


def linearise(
    blocks: Sequence[Block],
    setups: Mapping[str, SetUp],
    effects: Sequence[Effect] = (),
    unlimited: frozenset[str] = frozenset(),
) -> Linearisation:
    """Return the linearisation of blocks about set-ups. `effects` are those found so far, which the model
    contains beside those of its rig file, so that the residuals (N,) of the blocks do not contain them. The sizes of
    effects of `unlimited` names have no limit."""
    simulated = tuple(SimulatedBlock(block, tuple(effects), setups[block.setup]) for block in blocks)
    return Linearisation(simulated, tuple(block.y_mm for block in blocks), unlimited)


def beside(shared: Sequence[SharedBlock], blocks: Sequence[Block], setups: Mapping[str, SetUp]) -> Linearisation:
    """Return the linearisation of blocks that other linearisations share, and of more blocks after them, N entries in
    all, about set-ups."""
    simulated = (*shared, *(SimulatedBlock(block, (), setups[block.setup]) for block in blocks))
    return Linearisation(simulated, tuple(each.block.y_mm for each in simulated))


def basis_of(columns: Array) -> Array:
    """Return an orthonormal basis (N, r) of columns (N, s), of which those equal to zero are ignored."""
    basis, _ = np.linalg.qr(columns[:, np.linalg.norm(columns, axis=0) > 0])
    return np.asarray(basis, dtype=float)


# ----------------------------------------------------------------------------------------------------------------------
# The worth of a name in µm: the change of the readings that it causes beyond what a set-up could absorb.

LEAST_MATERIAL_UM = 3.0
"""Smallest change that is material anywhere, which is the resolution of the best gauges of such a link."""


@dataclass(frozen=True)
class Worth:
    """Root mean square in µm, by block (b,), of a change of the readings."""

    um: Array

    @property
    def whole_um(self) -> float:
        """The root mean square over all blocks, each with the same weight."""
        return float(np.sqrt(np.mean(self.um**2)))

    def is_material(self, limits_um: Array) -> bool:
        """Return whether the readings of any block change by more than its limit (b,) µm."""
        return bool((self.um > limits_um).any())


def worth(linear: Linearisation, change: Array) -> Worth:
    """Return the worth of a change (N,) of whitened readings, with set-ups fitted to it."""
    return plain_worth(linear, linear.without_set_up(change))


def plain_worth(linear: Linearisation, change: Array) -> Worth:
    """Return the worth of a change (N,) of whitened readings, without fitting set-ups."""
    return Worth(np.array([rms_um(*both) for both in zip(linear.blocks, linear.in_mm(change), strict=True)]))


def limits_um(linear: Linearisation, own_um: Mapping[str, float] = MappingProxyType({})) -> Array:
    """Return the changes (b,) µm from which a name is material: the scatter of one run without `own_um`, the part that
    the name makes in each set-up.

    Few repeats show the scatter of one run within a fifth or worse, so the limit is computed from its mean square less
    the standard uncertainty of that. A single difference of two runs shows no uncertainty.
    """
    of_name = np.array([own_um.get(block.setup, 0.0) for block in linear.blocks])
    squares, relative = _scatter_squares(linear, [block.steady_mm for block in linear.blocks])
    least = np.maximum((squares - of_name**2) * (1 - relative), LEAST_MATERIAL_UM**2)
    return np.asarray(np.sqrt(least), dtype=float)


def scatter_um(linear: Linearisation) -> Array:
    """Return the rms difference (b,) µm of one run from the mean of many; at targets that of a median target, because a
    few scatter many times as much. What stamps add where readings change quickly is not counted.

    Repeated circles show it themselves, together in all directions of a set-up; elsewhere it is that of the noise.
    """
    return np.asarray(np.sqrt(_scatter_squares(linear, [block.steady_mm for block in linear.blocks])[0]), dtype=float)


def noise_um(linear: Linearisation) -> Array:
    """Return the same rms difference (b,) µm with what stamps added to repeated circles."""
    return np.asarray(np.sqrt(_scatter_squares(linear, [block.apart_mm for block in linear.blocks])[0]), dtype=float)


def _scatter_squares(linear: Linearisation, deviations: Sequence[Array]) -> tuple[Array, Array]:
    """Return the mean square (b,) µm² of the difference of one run from the mean of many, and its relative standard
    uncertainty (b,), which is zero where repeats do not show it. `deviations` (n, N) mm of repeated runs are those of
    each block."""
    # What noise and scatter make, with the set-up fitted to it.
    whole = linear.in_mm(np.sqrt(1 + (linear.without_set_up(linear.Z) ** 2).sum(axis=1)))
    squares, relative = np.empty(len(linear.blocks)), np.zeros(len(linear.blocks))
    for k, (block, entries) in enumerate(zip(linear.blocks, whole, strict=True)):
        usual = entries if block.sampling else np.full(len(entries), np.median(entries))
        squares[k] = rms_um(block, np.sqrt(block.count) * usual)
    squares **= 2
    repeated = [k for k, block in enumerate(linear.blocks) if block.sampling and deviations[k].any()]
    for setup in {linear.blocks[k].setup for k in repeated}:
        members, shown = [k for k in repeated if linear.blocks[k].setup == setup], list[float]()
        for k in members:
            # The independent differences of the runs, one fewer than these.
            contrasts = np.linalg.svd(np.ones((1, len(deviations[k]))))[2][1:]
            shown += [rms_um(linear.blocks[k], contrast) ** 2 for contrast in contrasts @ deviations[k]]
        squares[members] = np.mean(shown)
        if len(shown) > 1:
            relative[members] = min(1.0, float(np.std(shown, ddof=1)) / np.sqrt(len(shown)) / float(np.mean(shown)))
    return squares, relative


def rms_um(block: Block, entries_mm: Array) -> float:
    """Return the root mean square in µm of a block's entries (N,) mm: per reading of a gauge, and per distance of
    poses."""
    if block.sampling:
        energy, count = float((entries_mm[: len(ORDER_OF)] ** 2).sum()), 2 * GRID
    else:
        energy = float((entries_mm**2).sum())
        count = len(entries_mm) // (3 if facts_of(block.table.test).of_places else 1)
    return 1e3 * float(np.sqrt(energy / count))
