"""Common part of the five interpreters: execution paths, values unknown to a program, and positions of the arm.

A program is a flat list of steps. A fork is a condition that cannot be evaluated from the text. Each alternative is
executed, and a loop at most twice. External values (registers, sensors, tools taught by the user, routines without
text) are constant in each world, before and after the correction.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from tests.worlds.languages.arms import Array, Cell, branches, chain, frame, placed, solved, turn_of
from tests.worlds.languages.expressions import NotUnderstood

Place = tuple[str, int]
"""File and line."""
_STEPS, _DEPTH, _AGAIN, _MOST_KEPT = 600, 8, 2, 20_000

_NEAR_RAD, _PARTS = 0.9, 40
"""Joint angles closer than this belong to one posture; number of steps along a line in which a posture is followed."""


@dataclass(frozen=True)
class Line:
    place: Place
    text: str


def first_word(text: str) -> str:
    """Word in capitals at the begin of a statement, or an empty string."""
    return re.match(r"\$?\w*", text.strip())[0].upper()  # type: ignore[index]


class LineBlocks:
    """Program text as lines with blocks, each statement on a line of its own."""

    _lines: list[Any]
    _at = 0

    def _statement(self, line: Any) -> list[Any]:
        raise NotImplementedError

    def _block(self, *ends: str) -> list[Any]:
        """Statements up to a line that begins with one of these words, or to the last line without ends."""
        nodes: list[Any] = []
        while self._at < len(self._lines):
            line = self._lines[self._at]
            if first_word(line.text) in ends:
                return nodes
            self._at += 1
            nodes += self._statement(line)
        if ends:
            raise NotUnderstood("a block has no end")
        return nodes

    def _body(self, *ends: str) -> tuple[list[Any], str]:
        """Statements of a block, and the word that ends it."""
        nodes = self._block(*ends)
        self._at += 1
        return nodes, first_word(self._lines[self._at - 1].text)

    def _bodies(self, between: Sequence[str], *ends: str) -> tuple[list[list[Any]], list[str]]:
        """Blocks up to a line that begins with one of the ends, and the word that ends each."""
        bodies, words = [], [""]
        while words[-1] not in ends:
            body, word = self._body(*between, *ends)
            bodies.append(body)
            words.append(word)
        return bodies, words


class Ended(Exception):
    """The controller stops: the program has ended or is refused from here on."""


def stop(_: Any) -> None:
    raise Ended


@dataclass(frozen=True)
class Step:
    """A step. `act` executes it. Execution continues with the next step or one of `to`; `loop`: a fork back into a
    loop.
    """

    place: Place
    act: Callable[[Any], Any] | None = None
    to: tuple[int, ...] = ()
    ends: bool = False


@dataclass
class Ways:
    """Choices of an execution path: first the given ones, then the first alternative of each fork."""

    given: Sequence[int] = ()
    rng: np.random.Generator | None = None
    taken: list[int] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)

    def choose(self, count: int) -> int:
        """Choice among `count` alternatives."""
        k = len(self.taken)
        if k < len(self.given):
            one = min(self.given[k], count - 1)
        else:
            one = int(self.rng.integers(count)) if self.rng is not None else 0
        self.taken.append(one)
        self.counts.append(count)
        return one


def every_way(most: int, seed: int) -> Iterator[Ways]:
    """Yield all execution paths, up to `most`; the caller executes each before requesting the next. After half of
    `most` in order, the others are random.
    """
    given: list[int] = []
    for _ in range(most // 2):
        ways = Ways(given)
        yield ways
        taken, counts = ways.taken, ways.counts
        while taken and taken[-1] + 1 >= counts[len(taken) - 1]:
            taken = taken[:-1]
        if not taken:
            return
        given = [*taken[:-1], taken[-1] + 1]
    rng = np.random.default_rng(seed)
    for _ in range(most - most // 2):
        yield Ways((), rng)


def _rng(seed: int, name: str) -> np.random.Generator:
    digest = hashlib.blake2b(f"{seed}:{name}".encode(), digest_size=8).digest()
    return np.random.default_rng(int.from_bytes(digest))


@lru_cache(maxsize=_MOST_KEPT)
def _number(seed: int, name: str, low: float, high: float) -> float:
    return float(_rng(seed, name).uniform(low, high))


@lru_cache(maxsize=_MOST_KEPT)
def _shift(seed: int, name: str) -> Array:
    rng = _rng(seed, name)
    T = frame(rng.uniform(-60, 60, 3), Rotation.from_rotvec(rng.uniform(-0.2, 0.2, 3)))
    T.setflags(write=False)
    return T


def copied(value: Any) -> Any:
    """A copy of a value whose lists and records are not shared with another variable."""
    if isinstance(value, list | tuple):
        return type(value)(map(copied, value))
    return {key: copied(item) for key, item in value.items()} if isinstance(value, dict) else value


@dataclass(frozen=True)
class World:
    """Values unknown to programs, the same for the same name within a world. `stated`: tools and frames stated by
    the user, by kind and name.
    """

    seed: int
    stated: Mapping[tuple[str, str], Array] = field(default_factory=dict)

    def rng(self, name: str) -> np.random.Generator:
        return _rng(self.seed, name)

    def number(self, name: str, low: float = -40.0, high: float = 40.0) -> float:
        return _number(self.seed, name, low, high)

    def shift(self, name: str) -> Array:
        """A random frame (4, 4) near the identity for a name: some centimetres and degrees."""
        return _shift(self.seed, name)


@dataclass(frozen=True)
class Reached:
    """End of a move: its place in the text, the places of the numbers it used, the flange (4, 4) requested by the
    text, the relevant point (3,) of the flange, and the joint angles (6,) rad chosen by the controller.
    """

    place: Place
    sources: frozenset[Place]
    F: Array
    point: Array
    q: Array


class Robot:
    """An arm as driven by its controller, and the poses it has reached."""

    _cache: ClassVar[dict[Any, Any]] = {}

    def __init__(self, dialect: str, here: Cell, world: World, ways: Ways) -> None:
        self.dialect, self.here, self.world, self.ways = dialect, here, world, ways
        self._cell = (dialect, here.controller)
        self.q = here.centre.copy()
        self.rail_mm = 0.0
        """Position of the track that carries the arm along y."""
        self.reached: list[Reached] = []
        self.steps = 0

    def joints(
        self, q: Array, tool: Array, place: Place, sources: frozenset[Place], meant: Array | None = None
    ) -> None:
        """Move to joint angles q (6,) rad. meant (4, 4): flange that the text means, by default of the data sheet."""
        if not np.isfinite(q).all() or np.abs(q).max() > 7:
            raise Ended
        self.q = np.array(q, dtype=float)
        F = self.meant(self.q) if meant is None else meant
        self.reached.append(Reached(place, sources, F, tool[:3, 3], self.q))

    def pose(
        self,
        F: Array,
        point: Array,
        place: Place,
        sources: frozenset[Place],
        chosen: Callable[[Array], bool] | None = None,
        *,
        straight: bool = False,
        meant: Array | None = None,
    ) -> None:
        """Move the flange to F (4, 4), with the solution nearest to the current angles or the one accepted by `chosen`.

        On a straight line the arm keeps its posture. meant (4, 4): flange that the text means, by default F.
        """
        if straight and chosen is None:
            q = self._once((self._cell, F.tobytes(), self.q.tobytes(), "line"), lambda: self._along(F))
        else:
            q = self.solve(F, self.q, chosen)
        if q is None:
            raise Ended
        self.q = q
        self.reached.append(Reached(place, sources, F if meant is None else meant, point, q))

    def solve(self, F: Array, near: Array, chosen: Callable[[Array], bool] | None = None) -> Array | None:
        """Return joint angles (6,) rad for a flange F (4, 4), or None."""
        key = (self._cell, F.tobytes(), near.tobytes(), chosen)
        return self._once(key, lambda: self._solved(F, near, chosen))

    def flange(self, q: Array) -> Array:
        """Flange (4, 4) that the controller computes at joint angles q (6,) rad."""
        return self._once((self._cell, q.tobytes()), lambda: chain(self.here, q)[0])

    def meant(self, q: Array) -> Array:
        """Flange (4, 4) that a joint target q (6,) rad means: of the data sheet."""
        key = (self.dialect, "data_sheet")
        return self._once((key, q.tobytes()), lambda: chain(self.here.sheet, q)[0])

    def _once(self, key: Any, make: Callable[[], Any]) -> Any:
        """Cached value for a key, because execution paths repeat positions."""
        if key not in self._cache:
            if len(self._cache) > _MOST_KEPT:
                self._cache.clear()
            self._cache[key] = make()
        return self._cache[key]

    def _solved(self, F: Array, near: Array, chosen: Callable[[Array], bool] | None) -> Array | None:
        q = solved(self.here, F, near)
        chosen = chosen or self.here.allows
        if q is not None and self.here.allows(q) and np.abs(q - near).max() < _NEAR_RAD and chosen(q):
            return q
        ways = [] if q is None else [q]
        others = self._once(
            (self._cell, F.tobytes()), lambda: [solved(self.here, F, seed) for seed in branches(self.dialect)]
        )
        for other in others:
            if other is not None:
                ways.append(near + (other - near + np.pi) % (2 * np.pi) - np.pi)
                ways.append(other)
        ways = [way for way in ways if self.here.allows(way) and chosen(way)]
        return min(ways, key=lambda way: float(np.abs(way - near).max())) if ways else None

    def _along(self, F: Array) -> Array | None:
        """Return joint angles (6,) rad at the end of a line, followed from the current angles."""
        near = self.solve(F, self.q)
        if near is not None and np.abs(near - self.q).max() < _NEAR_RAD:
            return near
        begin = self.flange(self.q)
        shares = np.linspace(0, 1, _PARTS + 1)[1:, None]
        turns = Rotation.from_rotvec(shares * turn_of(F[:3, :3] @ begin[:3, :3].T)).as_matrix() @ begin[:3, :3]
        places = begin[:3, 3] + shares * (F[:3, 3] - begin[:3, 3])
        q = self.q
        for share, place, R in zip(shares[:, 0], places, turns, strict=True):
            one = solved(self.here, F if share == 1 else placed(place, R), q)
            if one is None or np.abs(one - q).max() > _NEAR_RAD or not self.here.allows(one):
                return None
            q = one
        return q

    def begin_on_rail(self) -> None:
        """Start at the track position left by the previous program, in every second world."""
        self.rail_mm = self.world.number("rail", 50, 150) if self.world.seed % 2 else 0.0

    def go_astray(self, name: str) -> None:
        """Move to a different posture, as caused by something outside the program."""
        others = branches(self.dialect)
        self.q = others[int(self.world.rng(name).integers(len(others)))].copy()

    def pose_now(self, tool: Array) -> Array:
        """Tool pose (4, 4) in the base as computed by the controller."""
        return self.flange(self.q) @ tool


@dataclass(frozen=True)
class Do:
    """An instruction; `ends` returns from the routine with its value."""

    place: Place
    act: Callable[[Any], Any]
    ends: bool = False


@dataclass(frozen=True)
class Branch:
    """Alternative bodies; without `otherwise` possibly none is executed. `act` evaluates the conditions."""

    place: Place
    bodies: Sequence[Sequence[Any]]
    otherwise: bool
    act: Callable[[Any], Any] | None = None


@dataclass(frozen=True)
class Loop:
    """A body executed zero, one or two times, or at least once; `act` evaluates the condition."""

    place: Place
    body: Sequence[Any]
    at_least_once: bool = False
    act: Callable[[Any], Any] | None = None


@dataclass(frozen=True)
class Leave:
    """Leave or continue the enclosing loop."""

    place: Place
    again: bool = False


@dataclass(frozen=True)
class Label:
    """Target of a jump."""

    name: str


@dataclass(frozen=True)
class Goto:
    """A jump to one of several labels, or possibly none. The controller stops at a jump to a missing label."""

    place: Place
    names: tuple[str, ...]
    perhaps: bool


def steps_of(nodes: Sequence[Any]) -> list[Step]:
    """Flat steps of nested instructions."""
    steps: list[Step] = []
    labels: dict[str, int] = {}
    jumps: list[tuple[int, Goto]] = []

    def put(place: Place, act: Callable[[Any], Any] | None = None) -> int:
        steps.append(Step(place, act))
        return len(steps) - 1

    def lead(k: int, *to: int) -> None:
        steps[k] = Step(steps[k].place, steps[k].act, to)

    def body(nodes: Sequence[Any], loop: tuple[int, list[int]] | None) -> None:
        for node in nodes:
            match node:
                case Do():
                    steps.append(Step(node.place, node.act, (), node.ends))
                case Branch():
                    fork, begins, leaves = put(node.place, node.act), [], []
                    for one in node.bodies:
                        begins.append(len(steps))
                        body(one, loop)
                        leaves.append(put(node.place))
                    end = len(steps)
                    lead(fork, *begins, *([] if node.otherwise else [end]))
                    for k in leaves:
                        lead(k, end)
                case Loop():
                    out: list[int] = []
                    if node.at_least_once:
                        begin = len(steps)
                        again = put(node.place)
                        lead(again, begin + 1)
                        body(node.body, (begin, out))
                        fork = put(node.place, node.act)
                        lead(fork, begin, fork + 1)
                    else:
                        fork = put(node.place, node.act)
                        body(node.body, (fork, out))
                        lead(put(node.place), fork)
                        lead(fork, fork + 1, len(steps))
                    for k in out:
                        lead(k, len(steps))
                case Leave():
                    k = put(node.place)
                    if loop is None:
                        lead(k, k + 1)
                    elif node.again:
                        lead(k, loop[0])
                    else:
                        loop[1].append(k)
                case Label():
                    labels[node.name] = len(steps)
                case Goto():
                    jumps.append((put(node.place), node))

    body(nodes, None)
    for k, goto in jumps:
        to = [labels.get(name, len(steps) + 1) for name in goto.names]
        lead(k, *to, *([k + 1] if goto.perhaps else []))
    return steps


def run_steps(machine: Any, steps: Sequence[Step], depth: int = 0) -> Any:
    """Execute a routine and return the value of the final act.

    A step is executed only a few times. A fork then takes its last alternative, which leaves a loop.
    """
    if depth > _DEPTH:
        raise Ended
    robot, visits = machine.robot, [0] * len(steps)
    k = 0
    while k < len(steps):
        step = steps[k]
        visits[k] += 1
        robot.steps += 1
        if robot.steps > _STEPS or visits[k] > 3 * _AGAIN:
            raise Ended
        value = step.act(machine) if step.act else None
        if step.ends:
            return value
        if not step.to:
            k += 1
        elif len(step.to) == 1 or visits[k] > _AGAIN:
            k = step.to[-1]
        else:
            k = step.to[robot.ways.choose(len(step.to))]
        if k > len(steps):
            raise Ended
    return None
