"""Controllers as far as two or three languages agree: variables with expressions, and jobs with numbered positions."""

from __future__ import annotations

from typing import Any, ClassVar

from tests.worlds.languages.arms import Array, cell, links
from tests.worlds.languages.execution import Place, Robot, Ways, World, run_steps
from tests.worlds.languages.expressions import Tree

Value = tuple[Any, frozenset[Place]]
"""A value and the lines of its numbers."""
NOWHERE: frozenset[Place] = frozenset()


class Machine:
    """A controller that executes a program along one execution path."""

    dialect: ClassVar[str]

    def __init__(self, program: Any, world: World, ways: Ways) -> None:
        self.program, self.world = program, world
        self.robot = Robot(self.dialect, cell(self.dialect), world, ways)

    def unknown(self, name: str) -> None:
        """Execute a routine without text: it does nothing, or changes the position and what later moves depend on."""
        if self.robot.ways.choose(2):
            self.robot.go_astray(name)
            self.changed_by(name)

    def changed_by(self, name: str) -> None:
        """Change what later moves depend on, as a routine without text may."""
        raise NotImplementedError


class ValueMachine(Machine):
    """A controller of a language with variables in scopes; the first scope is global."""

    def __init__(self, program: Any, world: World, ways: Ways) -> None:
        super().__init__(program, world, ways)
        self.scopes: list[dict[str, Value]] = [{}]
        self.left: dict[str, Value] = {}
        """Variables of the routine that ended last."""
        self.armed: list[str] = []
        """Handlers that may interrupt a move."""

    def run_routine(self, name: str, variables: dict[str, Value]) -> Value:
        """Call a routine of the program with its arguments as variables."""
        self.scopes.append(variables)
        try:
            value = run_steps(self, self.program.routines[name].steps, len(self.scopes))
        finally:
            self.left = self.scopes.pop()
        return (self.world.number(name), NOWHERE) if value is None else value

    def interruption(self) -> str | None:
        """A handler that interrupts here, if any does; it is armed no more."""
        for handler in self.armed:
            if self.robot.ways.choose(2):
                self.armed.remove(handler)
                return handler
        return None

    def stored(self, name: str, scopes: list[dict[str, Value]]) -> Value | None:
        """Value of a variable, with the lines that assign to it; None if no scope has it."""
        for scope in scopes:
            if name in scope:
                return scope[name][0], scope[name][1] | self.program.written.get(name, set())
        return None

    def evaluate(self, tree: Tree, where: Any) -> Value:
        match tree:
            case ("number" | "text", value):
                return value, NOWHERE
            case ("name", name):
                return self.read(name)
            case ("unary", operator, one):
                value, src = self.evaluate(one, where)
                return (not value if operator.upper() == "NOT" else -value if operator == "-" else value), src
            case ("binary", operator, one, other):
                (a, src), (b, more) = self.evaluate(one, where), self.evaluate(other, where)
                return self.binary(operator, a, b), src | more
        return self.evaluate_own(tree, where)

    def read(self, name: str) -> Value:
        raise NotImplementedError

    def binary(self, operator: str, a: Any, b: Any) -> Any:
        raise NotImplementedError

    def evaluate_own(self, tree: Tree, where: Any) -> Value:
        """Expressions that only this language has."""
        raise NotImplementedError


class JobMachine(Machine):
    """A controller of jobs, whose positions refer to numbered tools and frames."""

    def __init__(self, program: Any, world: World, ways: Ways) -> None:
        super().__init__(program, world, ways)
        self.frames: dict[tuple[str, int], Array] = {}
        self.running: list[str] = []

    def run(self) -> None:
        """Execute the main job."""
        self.call(self.program.main)

    def call(self, name: str) -> None:
        if name not in self.program.routines:
            self.unknown(name)
            return
        self.running.append(name)
        try:
            run_steps(self, self.program.routines[name].steps, len(self.running) - 1)
        finally:
            self.running.pop()

    def frame(self, kind: str, number: int) -> Array:
        """A tool or frame (4, 4): set by the program, stated by the user, or unknown."""
        if (kind, number) in self.frames:
            return self.frames[kind, number]
        stated = self.world.stated.get((kind, str(number)))
        return self.world.shift(f"{kind}{number}") if stated is None else stated

    def shift_frames(self, name: str, numbers: tuple[int, ...]) -> None:
        """Change tools and frames as a job without text may."""
        for kind in ("tool", "frame"):
            for number in numbers:
                self.frames[kind, number] = self.frame(kind, number) @ self.world.shift(f"{name}{kind}{number}")


def elbow_up_and_front(dialect: str, q: Array) -> tuple[bool, bool]:
    """True if the elbow is above the line from shoulder to wrist, and if the arm faces the front."""
    first, shoulder, elbow, _, wrist, *_ = links(cell(dialect), q)
    reach, bend = wrist[:3, 3] - shoulder[:3, 3], elbow[:3, 3] - shoulder[:3, 3]
    above = bend - (bend @ reach) / (reach @ reach) * reach
    return bool(above @ first[:3, 2] > 0), bool((wrist[:3, 3] - first[:3, 3]) @ first[:3, 0] > 0)
