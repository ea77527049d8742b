"""Interpreter of URScript, written from the Script Manual.

Indentation is ignored and a block ends with `end`. A pose is p[x, y, z, rx, ry, rz] in metres and a rotation vector.
The tool (TCP) and variables outside functions are global. A move to a pose uses the solution nearest to the current
angles or to qnear.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tests.worlds.languages.arms import Array, chain, placed
from tests.worlds.languages.execution import (
    Branch,
    Do,
    Ended,
    Leave,
    LineBlocks,
    Loop,
    Place,
    Step,
    Ways,
    World,
    first_word,
    run_steps,
    steps_of,
    stop,
)
from tests.worlds.languages.expressions import UR, NotUnderstood, Tree, arithmetic
from tests.worlds.languages.frames import inverted, moved, of_vector, vector_of
from tests.worlds.languages.machines import NOWHERE, Value, ValueMachine

_STILL = re.compile(
    r"(set_(standard|configurable|tool)_(digital|analog)_out|set_(digital|analog)_out|set_flag|set_gravity|set_payload"
    r"|set_payload_mass|set_payload_cog|set_target_payload|set_tool_voltage|textmsg|popup|sleep|sync|write_output_\w+"
    r"|write_port_\w+|socket_\w+|rtde_set_watchdog|modbus_\w+|enter_critical|exit_critical|stopj|stopl|request_\w+"
    r"|set_runstate_\w+|assert|set_\w+_actions?|set_input_actions_to_default|halt|run|kill|join|tool_contact"
    r"|set_analog_\w+|set_tool_\w+|step_log|get_\w+|is_\w+|read_\w+|norm|length|size|floor|ceil|sqrt|random|str_\w+|to_num|to_str"
    r"|interpolate_pose|rpc_factory|wait|force|powerdown|sin|cos|tan|asin|acos|atan|atan2|log|pow|point_dist|pose_dist|inv|binary_list_to_integer|integer_to_binary_list)"
)
"""Names of the manual that neither move nor influence a pose. A routine of the program with such a name has
priority.
"""


class Pose(list[float]):
    """Six numbers of a pose: metres and a rotation vector."""

    def matrix(self) -> Array:
        """Frame (4, 4) in mm."""
        x, y, z, *vector = map(float, self)
        return of_vector(1e3 * x, 1e3 * y, 1e3 * z, *vector)


class Solved(list[float]):
    """Joint angles that the controller computed for a pose: they mean this pose."""


def as_pose(T: Array) -> Pose:
    """Pose of a frame (4, 4)."""
    return Pose([*(T[:3, 3] / 1e3).tolist(), *vector_of(T)])


@dataclass(frozen=True)
class _Line:
    places: tuple[Place, ...]
    text: str


@dataclass
class _Routine:
    parameters: tuple[str, ...]
    steps: list[Step] = field(default_factory=list)


def logical_lines(name: str, text: str) -> list[_Line]:
    """Statements of a text with their lines, without comments."""
    lines, open_, places, words = [], 0, [], ""  # type: ignore[var-annotated]
    for number, raw in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        bare = ""
        for part in re.finditer(r'"[^"]*"|#.*|[^"#]+|"', raw):
            if part[0][0] == "#":
                break
            bare += part[0]
            marks = "" if part[0][0] == '"' else part[0]
            open_ += sum(marks.count(c) for c in "([") - sum(marks.count(c) for c in ")]")
        words += " " + bare.strip()
        if bare.strip():
            places.append((name, number))
        if open_ > 0 and words.strip():
            continue
        if words.strip() and not words.strip().startswith("$"):
            lines.append(_Line(tuple(places), words.strip()))
        words, places, open_ = "", [], 0
    return lines


class Program(LineBlocks):
    """A parsed program: routines and global statements."""

    def __init__(self, files: Mapping[str, str], main: str) -> None:
        self.routines: dict[str, _Routine] = {}
        self.written: dict[str, set[Place]] = {}
        self._lines = logical_lines(main, files[main])
        self._depth = 0
        self.last = ""
        self.begin = steps_of(self._block())

    def _statement(self, line: _Line) -> list[Any]:
        place = line.places[0]
        match word := first_word(line.text).lower():
            case "def" | "thread" | "sec":
                head = re.match(r"\w+\s+(\w+)\s*\(([^)]*)\)\s*:", line.text)
                if not head:
                    raise NotUnderstood(line.text)
                parameters = tuple(one.split("=")[0].strip() for one in head[2].split(",") if one.strip())
                routine = self.routines[head[1]] = _Routine(parameters)
                self._depth += 1
                routine.steps = steps_of(self._body("END")[0])
                self._depth -= 1
                if not self._depth:
                    self.last = head[1]
                if word == "thread":
                    self.routines.pop(head[1])
                return []
            case "if":
                bodies, closings = self._bodies(("ELIF", "ELSE", "ELSEIF"), "END")
                return [Branch(place, bodies, "ELSE" in closings, self._condition(line, "if"))]
            case "while":
                endless = bool(re.match(r"while\s*\(?\s*True", line.text))
                return [Loop(place, self._body("END")[0], endless, self._condition(line, "while"))]
            case "break" | "continue":
                return [Leave(place, word == "continue")]
            case "return":
                rest = line.text[len("return") :].strip()
                tree = UR.tree(UR.tokens(rest)) if rest else None
                return [Do(place, lambda m: m.evaluate(tree, line) if tree else None, ends=True)]
            case "halt":
                return [Do(place, stop)]
            case "global" | "local":
                return [self._do(line, line.text[len(word) :].strip())]
        return [self._do(line, line.text)]

    @staticmethod
    def _condition(line: _Line, word: str) -> Any:
        text = line.text[len(word) :].rstrip(": ")
        tree = UR.tree(UR.tokens(text))
        return lambda m: m.evaluate(tree, line)

    def _do(self, line: _Line, text: str) -> Do:
        tokens = UR.tokens(text)
        tree = UR.tree(tokens)
        if tokens.peek() == "=":
            tokens.take()
            value = UR.tree(tokens)
            name = tree[1][1] if tree[0] == "index" else tree[1]
            self.written.setdefault(name, set()).update(line.places)
            return Do(line.places[0], lambda m: m.assign(tree, m.evaluate(value, line), line))
        return Do(line.places[0], lambda m: m.evaluate(tree, line))


class Machine(ValueMachine):
    """A controller that executes a program along one execution path."""

    dialect = "ur"

    def __init__(self, program: Program, world: World, ways: Ways) -> None:
        super().__init__(program, world, ways)
        stated = world.stated.get(("tool", "tcp"))
        self.tool = world.shift("tcp") if stated is None else stated
        self.shifted = np.eye(4)

    def run(self) -> None:
        """Execute the program."""
        run_steps(self, self.program.begin)
        if not any(step.act for step in self.program.begin) and self.program.last:
            self.run_routine(self.program.last, {})

    def assign(self, target: Tree, value: Value, line: _Line) -> None:
        """Assign to a variable or an element."""
        match target:
            case ("name", name):
                scope = self._scope(name)
                scope[name] = (value[0], value[1] | scope.get(name, value)[1])
            case ("index", ("name", name), index):
                old, src = self.read(name)
                k = int(self.evaluate(index, line)[0])
                new = type(old)(old) if isinstance(old, list) else [0.0] * 6
                new[k % len(new)] = value[0]
                self._scope(name)[name] = (new, src | value[1])
            case _:
                raise NotUnderstood(str(target))

    def _scope(self, name: str) -> dict[str, Value]:
        return next((scope for scope in reversed(self.scopes) if name in scope), self.scopes[0])

    def read(self, name: str) -> Value:
        if stored := self.stored(name, self.scopes[::-1]):
            return stored
        if name in ("True", "False"):
            return name == "True", NOWHERE
        return self._outside(name), NOWHERE

    def _outside(self, name: str) -> Any:
        """A variable of the installation, with a kind determined by its name."""
        if re.search(r"(_p|pose|plane|frame|tcp)", name):
            near = self.robot.pose_now(self.tool) if "tcp" not in name else np.eye(4)
            return as_pose(near @ self.world.shift(name) if "tcp" in name else near)
        return self.world.number(name)

    def evaluate_own(self, tree: Tree, line: _Line) -> Value:
        match tree:
            case ("pose" | "list" as kind, items):
                values = [self.evaluate(one, line) for one in items]
                made = [value for value, _ in values]
                src = frozenset(line.places).union(*(src for _, src in values))
                return (Pose(made) if kind == "pose" else made), src
            case ("index", one, index):
                value, src = self.evaluate(one, line)
                k = int(self.evaluate(index, line)[0])
                return (value[k % len(value)] if isinstance(value, list) and value else 0.0), src
            case ("field", one, name):
                return self.world.number(f"{one}.{name}"), NOWHERE
            case ("call", name, arguments):
                values = [(key, self.evaluate(one, line)) for key, one in arguments]
                return self._function(name, values, line)
            case ("method", handle, name, _):  # of a different program, which responds
                return self.world.number(f"{handle}.{name}"), NOWHERE
        raise NotUnderstood(str(tree))

    def binary(self, operator: str, a: Any, b: Any) -> Any:
        if isinstance(a, list) and isinstance(b, list) and operator in "+-":
            sign = 1 if operator == "+" else -1
            return type(a)(x + sign * y for x, y in zip(a, b, strict=False))
        if isinstance(a, list) and operator == "*":
            return type(a)(x * b for x in a)
        return arithmetic(operator, a, b)

    def _function(self, name: str, values: list[tuple[str, Value]], line: _Line) -> Value:
        if name in self.program.routines:
            parameters = self.program.routines[name].parameters
            return self.run_routine(name, dict(zip(parameters, (value for _, value in values), strict=False)))
        keyed = {key: value for key, value in values if key}
        plain = [value for key, value in values if not key]
        src = NOWHERE.union(*(value[1] for _, value in values))
        if name in ("movej", "movel", "movep", "movec", "servoj", "servoc", "optimovej", "optimovel"):
            self._move(name, keyed, plain, line)
            return None, NOWHERE
        first = plain[0][0] if plain else next(iter(keyed.values()))[0] if keyed else None
        match name:
            case "set_tcp":
                self.tool = Pose(first).matrix()
            case "get_inverse_kin":
                return self._inverse(keyed, plain), src
            case "get_forward_kin":
                q = self.robot.q if first is None else np.array(first)
                tool = plain[1][0].matrix() if len(plain) > 1 else self.tool
                return as_pose(chain(self.robot.here, q)[0] @ tool), src
            case "pose_trans":
                return as_pose(Pose(first).matrix() @ Pose(plain[1][0]).matrix()), src
            case "pose_add":
                return as_pose(moved(Pose(first).matrix(), Pose(plain[1][0]).matrix())), src
            case "pose_sub":
                A, B = Pose(first).matrix(), Pose(plain[1][0]).matrix()
                return as_pose(placed(A[:3, 3] - B[:3, 3], A[:3, :3] @ B[:3, :3].T)), src
            case "pose_inv":
                return as_pose(inverted(Pose(first).matrix())), src
            case "d2r":
                return float(np.radians(first)), src
            case "r2d":
                return float(np.degrees(first)), src
            case "get_actual_tcp_pose" | "get_target_tcp_pose":
                return as_pose(self.robot.pose_now(self.tool)), src
            case "get_actual_joint_positions" | "get_target_joint_positions":
                return [float(one) for one in self.robot.q], src
            case "get_tcp_offset":
                return as_pose(self.tool), src
            case "track_conveyor_linear" | "track_conveyor_circular" | "path_offset_enable":
                self.shifted = self.world.shift(name)
            case "path_offset_set":
                self.shifted = Pose(first).matrix() if isinstance(first, list) else self.world.shift(name)
            case "stop_conveyor_tracking" | "path_offset_disable":
                self.shifted = np.eye(4)
            case "speedj" | "speedl" | "freedrive_mode" | "force_mode" | "teach_mode" | "move_until_contact":
                self.robot.go_astray(name)
            case "end_force_mode" | "end_freedrive_mode" | "end_teach_mode" | "conveyor_pulse_decode":
                pass
            case _ if _STILL.fullmatch(name):
                return self.world.number(name), src
            case _:
                self.unknown(name)
                return self.world.number(name), src
        return None, src

    def _inverse(self, keyed: dict[str, Value], plain: list[Value]) -> list[float]:
        X = Pose(keyed["x"][0] if "x" in keyed else plain[0][0])
        near = keyed.get("qnear", plain[1] if len(plain) > 1 else None)
        tool = keyed["tcp"][0].matrix() if "tcp" in keyed else self.tool
        q = self.robot.solve(X.matrix() @ inverted(tool), self.robot.q if near is None else np.array(near[0]))
        if q is None:
            raise Ended
        return Solved(float(one) for one in q)

    def _move(self, name: str, keyed: dict[str, Value], plain: list[Value], line: _Line) -> None:
        targets = plain[: 2 if name == "movec" else 1] + [
            keyed[k] for k in ("q", "pose", "pose_via", "pose_to") if k in keyed
        ]
        mode = keyed["mode"][0] if "mode" in keyed else plain[5][0] if len(plain) > 5 else 0.0
        straight = name[4] in "lpc"
        frames = []
        for value, _ in targets:
            if not isinstance(value, list):
                raise Ended
            joints = not isinstance(value, Pose)
            F = self.robot.flange(np.array(value, dtype=float)) if joints else value.matrix() @ inverted(self.tool)
            frames.append(F if joints else self.shifted @ F)
        if name == "movec" and mode:
            frames = turned_on_arc(self.robot.pose_now(self.tool), [F @ self.tool for F in frames], self.tool)
        for (value, src), F in zip(targets, frames, strict=True):
            sources = src | frozenset(line.places)
            if isinstance(value, Pose) or straight:  # a line to joint angles uses only their pose
                of_sheet = None if isinstance(value, Pose | Solved) else self.robot.meant(np.array(value, dtype=float))
                place, point = line.places[0], self.tool[:3, 3]
                self.robot.pose(F, point, place, sources, straight=straight, meant=of_sheet)
            else:
                q = np.array(value, dtype=float)
                meant = self.robot.flange(q) if isinstance(value, Solved) else None
                self.robot.joints(q, self.tool, line.places[0], sources, meant)

    def changed_by(self, name: str) -> None:
        self.tool = self.tool @ self.world.shift(name)


def turned_on_arc(begin: Array, poses: list[Array], tool: Array) -> list[Array]:
    """Flanges (4, 4) at the points of an arc in mode 1, with the tool fixed to the arc like a rigid body."""
    if len(poses) != 2:
        raise Ended
    a, b, c = begin[:3, 3], poses[0][:3, 3], poses[1][:3, 3]
    normal = np.cross(b - a, c - a)
    if np.linalg.norm(normal) < 1e-3:
        raise Ended
    axis = normal / np.linalg.norm(normal)
    # The centre is in the plane of the three points, at equal distance from each.
    rows = np.array([2 * (b - a), 2 * (c - a), axis])
    centre = np.linalg.solve(rows, [b @ b - a @ a, c @ c - a @ a, axis @ a])
    x = (a - centre) / np.linalg.norm(a - centre)
    y = np.cross(axis, x)
    flanges = []
    for place in (b, c):
        angle = np.arctan2((place - centre) @ y, (place - centre) @ x) % (2 * np.pi)
        R = Rotation.from_rotvec(axis * angle).as_matrix() @ begin[:3, :3]
        flanges.append(placed(place, R) @ inverted(tool))
    return flanges
