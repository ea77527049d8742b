"""Common part of the five grammars: draft files, random targets and names, line ends and encodings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from tests.worlds.languages.arms import Array, branches, cell, chain, frame

_Any = TypeVar("_Any")
_HALF_DEG = (18, 12, 12, 18, 12, 25)
PREFIXES = (
    "get", "set", "read", "is", "write", "request", "str", "pose", "socket", "to", "wait", "move", "set_tcp", "path",
    "conf", "pdisp", "clear", "stop", "bas", "open", "text", "popup", "force", "rtde", "modbus", "step", "sync", "tp",
    "t", "home", "abs", "call", "rel",
)  # fmt: skip
NOUNS = ("part", "down", "home", "tray", "tool", "box", "up", "go", "side", "off", "on", "safe", "back", "station")
WORDS = ("movel(p[0.1, 0.2, 0.3, 0, 0, 0])", "MoveL p10,v100,fine,tool0;", "LIN {X 1.0, Y 2.0, Z 3.0}",
         "J P[1] 100% FINE", "set_tcp(p[0,0,0,0,0,0])", "$TOOL = {X 1}",
         "Greifer auf, dann weiter", "end", "ENDPROC")  # fmt: skip


Kinds = Sequence[tuple[float, Callable[[Any], list[str]]]]
"""Weights, and functions that write lines for the state of a program."""


@dataclass(frozen=True)
class Draft:
    """A random program: its files, the main file, the files to correct, and the statements of the user about the
    controller.
    """

    dialect: str
    files: dict[str, bytes]
    main: str
    given: tuple[str, ...]
    tools: dict[str, Array] = field(default_factory=dict)
    frames: dict[str, Array] = field(default_factory=dict)
    plain: bool = False


class Pen:
    """Generator of random numbers, names and texts: the base of the grammars. A plain program has one tool and frame.

    texts: of the routines; routines: their names, with the kind or the text of each.
    """

    dialect: ClassVar[str]

    def __init__(self, seed: int, *, plain: bool) -> None:
        self.plain = plain
        self.rng = np.random.default_rng([seed, sum(map(ord, self.dialect)), int(plain)])
        self.here = cell(self.dialect)
        self.texts: list[str] = []
        self.routines: list[tuple[str, str]] = []
        self.count = 0
        self._names: set[str] = set()

    def draft(self) -> Draft:
        raise NotImplementedError

    def maybe(self, share: float) -> bool:
        """True with this probability."""
        return bool(self.rng.random() < share)

    def pick(self, items: Sequence[_Any]) -> _Any:
        return items[int(self.rng.integers(len(items)))]

    def whole(self, low: int, high: int) -> int:
        return int(self.rng.integers(low, high + 1))

    def near(self) -> Array:
        """Return joint angles (6,) rad in the middle of the work area."""
        return self.here.centre + np.radians(self.rng.uniform(-1, 1, 6) * _HALF_DEG)

    def astray(self) -> Array:
        """Return joint angles (6,) rad in a different posture."""
        ways = branches(self.dialect)
        q = ways[self.whole(1, len(ways) - 1)] + np.radians(self.rng.uniform(-5, 5, 6))
        return np.clip(q, self.here.limits[:, 0] + 0.02, self.here.limits[:, 1] - 0.02)

    def flange(self, q: Array) -> Array:
        """Nominal flange (4, 4)."""
        return chain(self.here, q)[0]

    def tool(self) -> Array:
        """A gripper (4, 4)."""
        place = self.rng.uniform((-60, -60, 40), (60, 60, 220)).round(1)
        return frame(place, Rotation.from_euler("xyz", self.rng.uniform(-40, 40, 3).round(1), degrees=True))

    def user_frame(self) -> Array:
        """A work frame (4, 4)."""
        place = self.rng.uniform((-300, -300, -100), (300, 300, 150)).round(1)
        return frame(place, Rotation.from_euler("z", round(float(self.rng.uniform(-60, 60)), 1), degrees=True))

    def small(self) -> Array:
        """A shift (3,) mm between stations."""
        return self.rng.uniform(-40, 40, 3).round(1)

    def name(self) -> str:
        """A new routine name that resembles a built-in name, in the style of the dialect."""
        while True:
            name = f"{self.pick(PREFIXES)}_{self.pick(NOUNS)}"
            if name not in self._names:
                self._names.add(name)
                if self.dialect == "abb":
                    return name.title().replace("_", "")
                return name.upper() if self.dialect in ("fanuc", "yaskawa") else name

    def stated(self, frames: dict[int, Array], share: float) -> dict[str, Array]:
        """Numbered tools or frames that the user states: all for a plain program, else each with this probability."""
        return {str(k): T for k, T in frames.items() if self.plain or self.maybe(share)}

    def inside(self, share: float, head: str, lines: list[str], end: str, indent: str = "  ") -> list[str]:
        """The lines, with this probability inside a condition."""
        return [head, *(indent + one for one in lines), end] if self.maybe(share) else lines

    def coded(self, text: str, *, crlf: bool = False) -> bytes:
        """Encode text: with the line ends of a plain program, or with random line ends."""
        end = "\r\n" if crlf else "\n"
        if not self.plain:
            end = self.pick([end, end, end, "\r\n", "\n", "\r"])
        coding = "latin-1" if self.plain or self.maybe(0.6) else "utf-8"
        data = text.replace("\n", end).encode(coding, "replace")
        return b"\xef\xbb\xbf" + data if coding == "utf-8" and self.maybe(0.1) else data

    def drawn(self, state: Any, plain: Kinds, wild: Kinds) -> list[str]:
        """Lines of a randomly chosen kind, by weight; wild kinds only in programs that are not plain."""
        kinds = plain if self.plain else [*plain, *wild]
        weights = np.array([weight for weight, _ in kinds])
        return kinds[int(self.rng.choice(len(kinds), p=weights / weights.sum()))][1](state)


def stated(T: Array) -> str:
    """Format a frame (4, 4) for `--tool` and `--frame`."""
    angles = Rotation.from_matrix(T[:3, :3]).as_euler("xyz", degrees=True)
    return ",".join(f"{value:.6f}" for value in (*T[:3, 3], *angles))
