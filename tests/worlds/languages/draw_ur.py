"""Random URScript programs in the style of PolyScope and of hand-written code, including everything that changes a
tool, posture or point.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from tests.worlds.languages.arms import Array, frame, placed
from tests.worlds.languages.drawing import WORDS, Draft, Pen


@dataclass
class _Scope:
    """Assumptions of the program author at a line."""

    tool: Array
    points: list[str] = field(default_factory=list)
    depth: int = 1


def _numbers(values: Array, digits: int = 9) -> str:
    return ", ".join(f"{value:.{digits}f}".rstrip("0").rstrip(".") for value in values)


def pose(T: Array) -> str:
    """Return p[…] of a frame (4, 4)."""
    return f"p[{_numbers(np.array([*(T[:3, 3] / 1e3), *Rotation.from_matrix(T[:3, :3]).as_rotvec()]))}]"


class Writer(Pen):
    """Generator of a program."""

    dialect = "ur"

    def draft(self) -> Draft:
        tool = self.tool()
        scope = _Scope(tool)
        body = self._opening(scope)
        if self.plain:
            for name, on in (("gripper_open", False), ("gripper_close", True)):
                self.routines.append((name, "still"))
                self.texts.append(f"def {name}():\n  set_tool_digital_out(0, {on})\n  sleep(0.5)\nend")
        for _ in range(0 if self.plain else self.whole(0, 3)):
            self._routine(scope)
        for _ in range(self.whole(4, 9)):
            body += self.line(scope)
        stated = {}
        if not body[0].startswith("set_tcp(p[") or (not self.plain and self.maybe(0.1)):
            stated = {"tcp": tool}
        name = self.pick(["prog", "Program_1", "pick_and_place"])
        lines = [f"def {name}():", *("  " + one for one in body), "end"]
        if self.maybe(0.5):
            lines.insert(1, "\n".join("  " + one for text in self.texts for one in text.split("\n")))
        else:
            lines = [*self.texts, *lines]
        if self.maybe(0.5):
            lines.append(f"{name}()")
        text = "\n".join(line for line in lines if line) + "\n"
        return Draft(
            self.dialect, {"prog.script": self.coded(text)}, "prog.script", ("prog.script",), stated, {}, self.plain
        )

    def _opening(self, scope: _Scope) -> list[str]:
        begin = [f"set_tcp({pose(scope.tool)})"]
        if not self.plain and self.maybe(0.3):
            begin = self.pick(
                [
                    [],
                    [f"tcp_1 = {pose(scope.tool)}", "set_tcp(tcp_1)"],
                    ["if get_standard_digital_in(1):", f"  set_tcp({pose(scope.tool)})", "end"],
                    [f"movej([{_numbers(self.near())}], a=1.4, v=1.05)", f"set_tcp({pose(scope.tool)})"],
                ]
            )
        elif self.plain and self.maybe(0.3):
            begin = []
        return [*begin, "set_payload(1.5, [0, 0, 0.05])", f"movej([{_numbers(self.near())}], a=1.4, v=1.05)"]

    def _routine(self, scope: _Scope) -> None:
        name = self.name()
        kind = self.pick(["still", "moves", "moves", "tool", "mixed", "value", "point"])
        inner = _Scope(scope.tool, [], 2)
        lines = {
            "still": ["set_tool_digital_out(0, True)", "sleep(0.2)"],
            "moves": [f"movej([{_numbers(self.astray())}], a=1.4, v=1.05)"],
            "tool": [f"set_tcp({pose(self.tool())})"],
            "mixed": [],
            "value": [f"movej([{_numbers(self.astray())}])", "return True"],
            "point": [],
        }[kind]
        if kind == "mixed":
            lines = [one for _ in range(3) for one in self.line(inner)]
        arguments = ""
        if kind == "point":
            shift = f"p[{_numbers(self.small() / 1e3, 4)}, 0, 0, 0]"
            arguments, lines = self.pick(
                [
                    ("goal", ["movel(goal, a=1.2, v=0.25)"]),
                    ("goal", ["movej(goal, a=1.4, v=1.05)"]),
                    ("goal", [f"movel(pose_trans(goal, {shift}), a=1.2)", "movel(goal, a=1.2)"]),
                    ("goal", [f"above = pose_trans(goal, {shift})", "movel(above)", "movel(goal)", "movel(above)"]),
                    ("goal", ["movel(goal, a=1.2)", f"movel(pose_add(goal, {shift}), a=1.2)"]),
                    ("goal, speed", ["movel(goal, a=1.2, v=speed)"]),
                    ("goal", ["goal[2] = goal[2] + 0.01", "movel(goal, a=1.2)"]),
                    (
                        "goal",
                        ["if get_standard_digital_in(5):", "  goal = get_actual_tcp_pose()", "end", "movel(goal)"],
                    ),
                    ("goal", [f"set_tcp({pose(self.tool())})", "movel(goal, a=1.2)"]),
                ]
            )
        self.texts.append("\n".join([f"def {name}({arguments}):", *("  " + one for one in lines), "end"]))
        self.routines.append((name, kind))

    def line(self, scope: _Scope) -> list[str]:
        """Return one or more statements."""
        plain = [
            (3.0, self.move),
            (1.5, self.joints),
            (1.0, self.named),
            (0.4, self.arc),
            (1.0, lambda _: self.harmless()),
            (0.8, lambda scope: [*self.call(scope), *self.move(scope)]),
            (0.5, self.block),
        ]
        wild = [
            (0.7, self.new_tool),
            (0.6, self.computed),
            (0.5, self.changed),
            (0.4, self.shifted),
            (0.3, lambda _: self.unknown()),
            (0.3, self.inverse),
            (0.5, self.waypoint),
            (0.4, self.turning_arc),
            (0.2, lambda _: self.to_joints()),
            (0.2, self.other_program),
            (0.8, self.approach),
            (0.3, self.plane),
        ]
        return self.drawn(scope, plain, wild)

    def _target(self, scope: _Scope) -> str:
        return pose(self.flange(self.near()) @ scope.tool)

    def move(self, scope: _Scope) -> list[str]:
        how = self.pick(
            [
                "movel({}, a=1.2, v=0.25)",
                "movel({}, a=1.2, v=0.25, r=0.002)",
                "movep({}, a=1.2, v=0.25)",
                "movel({}, 1.2, 0.25, 0, 0)",
            ]
        )
        if self.maybe(0.15):
            how = "movel({},\n    a=1.2, v=0.25)" if self.maybe(0.5) else "movel(pose={}, a=1.2)"
        if not self.plain and self.maybe(0.15):
            how = "movej({}, a=1.4, v=1.05)"
        return how.format(self._target(scope)).split("\n")

    def joints(self, scope: _Scope) -> list[str]:
        q = self.near() if self.plain or self.maybe(0.8) else self.astray()
        if not self.plain and self.maybe(0.1):
            return [f"movej([{', '.join(f'd2r({value:.3f})' for value in np.degrees(q))}])"]
        return [f"movej([{_numbers(q)}], a=1.4, v=1.05)"]

    def named(self, scope: _Scope) -> list[str]:
        if scope.points and self.maybe(0.4):
            return [f"movel({self.pick(scope.points)}, a=1.2, v=0.25)"]
        self.count += 1
        name = f"{self.pick(['Waypoint', 'p', 'P', 'target', 'home_p'])}_{self.count}"
        scope.points.append(name)
        begin = "global " if self.maybe(0.5) and scope.depth == 1 else ""
        return [f"{begin}{name} = {self._target(scope)}", f"movel({name}, a=1.2, v=0.25)"]

    def arc(self, scope: _Scope) -> list[str]:
        return [f"movec({self._target(scope)}, {self._target(scope)}, a=1.2, v=0.25, mode=0)"]

    def waypoint(self, scope: _Scope) -> list[str]:
        """Return moves to a waypoint with its taught joint angles, after a move to a random posture."""
        self.count += 1
        name, q = f"Waypoint_{self.count}", self.near()
        lines = [f"{name}_p = {pose(self.flange(q) @ scope.tool)}", f"{name}_q = [{_numbers(q)}]"]
        by_angles = f"movej(get_inverse_kin({name}_p, qnear={name}_q), a=1.4, v=1.05)"
        before = [f"movej([{_numbers(self.astray() if self.maybe(0.5) else self.near())}], a=1.4, v=1.05)"]
        lines += self.pick([before, before, [by_angles], [by_angles, *before], []])
        return [*lines, self.pick([f"movel({name}_p, a=1.2, v=0.25)"] * 2 + [f"movej({name}_p, a=1.4, v=1.05)"])]

    def turning_arc(self, scope: _Scope) -> list[str]:
        """An arc of mode 1, with orientations as required by the mode or random."""
        q = self.near()
        begin = self.flange(q) @ scope.tool
        centre = begin[:3, 3] + 50 * begin[:3, 0]
        ends = []
        for degrees in (25, 50):
            turn = Rotation.from_rotvec(np.radians(degrees) * begin[:3, 2])
            R = turn.as_matrix() @ begin[:3, :3]
            if self.maybe(0.4):
                R = R @ Rotation.from_rotvec(self.rng.uniform(-0.3, 0.3, 3)).as_matrix()
            ends.append(pose(placed(centre + turn.apply(begin[:3, 3] - centre), R)))
        mode = self.pick(["mode=1", "r=0, mode=1", "mode=0"])
        before = [f"movej([{_numbers(q)}], a=1.4, v=1.05)"] if self.maybe(0.8) else []
        after = self.move(scope) if self.maybe(0.5) else []
        return [*before, f"movec({ends[0]}, {ends[1]}, a=1.2, v=0.25, {mode})", *after]

    def to_joints(self) -> list[str]:
        """A straight line to joint angles, which uses only their pose."""
        before = [f"movej([{_numbers(self.astray())}], a=1.4, v=1.05)"] if self.maybe(0.4) else []
        return [*before, f"movel([{_numbers(self.near())}], a=1.2, v=0.25)"]

    def other_program(self, scope: _Scope) -> list[str]:
        call = self.pick(["ok = camera.find(1)", "camera.start()", "if camera.is_ready():\n  sleep(0.1)\nend"])
        return ['camera = rpc_factory("xmlrpc", "http://127.0.0.1:33000/RPC2")', *call.split("\n"), *self.move(scope)]

    def harmless(self) -> list[str]:
        return [
            self.pick(
                [
                    "set_standard_digital_out(1, True)",
                    "sleep(0.5)",
                    f'textmsg("{self.pick(WORDS)}")',
                    f"# {self.pick(WORDS)}",
                    "set_tool_digital_out(0, False)",
                    "sync()",
                    "speed_ms = 0.25",
                    "set_tool_voltage(24)",
                    'modbus_add_signal("192.168.0.7", 255, 129, 3, "RX74", False)',
                    "stopj(2.0)",
                    "write_output_boolean_register(3, True)",
                    'popup("weiter?", title="Frage", blocking=True)',
                    '$ 3 "Waypoint_1 p[0, 0, 0, 0, 0, 0]" "breakAfter"',
                ]
            )
        ]

    def call(self, scope: _Scope) -> list[str]:
        if not self.routines:
            return self.harmless()
        name, kind = self.pick(self.routines)
        if kind == "point":
            given = self.pick(scope.points) if scope.points and self.maybe(0.5) else self._target(scope)
            has_speed = any(text.startswith(f"def {name}(goal, speed)") for text in self.texts)
            return [f"{name}({given}{', 0.2' if has_speed else ''})"]
        if kind == "value":
            return self.pick([[f"ok = {name}()"], [f"if {name}():", "  sleep(0.1)", "end"], [f"{name}()"]])
        return [f"{name}()"]

    def approach(self, scope: _Scope) -> list[str]:
        """Return moves above a point, given as an offset in the tool or in the base, and mostly to the point."""
        if not scope.points:
            return self.named(scope)
        self.count += 1
        name, k, shift = self.pick(scope.points), self.count, self.small() / 1e3
        turned = _numbers(self.rng.uniform(-0.2, 0.2, 3), 3) if self.maybe(0.3) else "0, 0, 0"
        d = _numbers(shift, 4)
        made, begin = self.pick(
            [
                (f"pose_trans({name}, p[{d}, {turned}])", []),
                (f"pose_add({name}, p[{d}, 0, 0, 0])", []),
                (f"pose_add({name}, p[{d}, 0, 0, 0.1])", []),
                (f"pose_trans({name}, p[0, 0, -h_{k}, 0, 0, 0])", [f"h_{k} = {abs(shift[2]):.4f}"]),
                (f"pose_trans({name}, p[0, 0, 2 * h_{k} - 0.01, 0, 0, d2r(5)])", [f"h_{k} = {abs(shift[2]):.4f}"]),
                (f"pose_trans({name}, o_{k})", [f"o_{k} = p[{d}, {turned}]"]),
                (f"pose_trans({name}, o_{k})", [f"o_{k} = p[{d}, {turned}]", f"o_{k}[2] = 0.01"]),
                (
                    f"p[{name}[0] + {shift[0]:.4f}, {name}[1], {name}[2]+h_{k}, {name}[3], {name}[4], {name}[5]]",
                    [f"h_{k} = {shift[2]:.4f}"],
                ),
                (f"p[{name}[0], {name}[1], {name}[2] - 0.01, {name}[3], {name}[4], {name}[4]]", []),
            ]
        )
        move = self.pick(["movel({}, a=1.2, v=0.25)", "movel({}, a=1.2)", "movej(get_inverse_kin({}), a=1.4)"])
        if self.maybe(0.4):
            begin = [*begin, f"above_{k} = {made}"]
            made = f"above_{k}"
            if self.maybe(0.15):
                begin.append(f"{made}[0] = {made}[0] + 0.002")
        return [*begin, move.format(made), *([f"movel({name})", move.format(made)] if self.maybe(0.6) else [])]

    def plane(self, scope: _Scope) -> list[str]:
        """Return moves to points in a plane."""
        self.count += 1
        name, flange = f"plane_{self.count}", self.flange(self.near()) @ scope.tool
        turn = Rotation.from_rotvec(self.rng.uniform(-0.5, 0.5, 3))
        plane = frame(self.rng.uniform(-300, 300, 3), turn)
        inside = pose(np.linalg.inv(plane) @ flange)
        lines = [f"{name} = {pose(plane)}", f"movel(pose_trans({name}, {inside}), a=1.2, v=0.25)"]
        if self.maybe(0.3):
            lines[1:] = [f"w_{self.count} = {inside}", f"movel(pose_trans({name}, w_{self.count}), a=1.2)"]
        if self.maybe(0.2):
            lines.append(f"movel({name}, a=1.2)")
        if self.maybe(0.2):
            lines.insert(1, f"{name}[2] = {name}[2] + 0.004")
        return lines

    def block(self, scope: _Scope) -> list[str]:
        if scope.depth > 2:
            return self.harmless()
        inner = _Scope(scope.tool, list(scope.points), scope.depth + 1)
        body = ["  " + one for _ in range(self.whole(1, 3)) for one in self.line(inner)]
        head = self.pick(
            [
                "if get_standard_digital_in(0):",
                "while i < 3:",
                "if (read_input_integer_register(0) > 2):",
                "while get_standard_digital_in(3) == False:",
            ]
        )
        if head.startswith("while i"):
            return ["i = 0", head, *body, "  i = i + 1", "end"]
        if head.startswith("if") and self.maybe(0.4):
            other = _Scope(scope.tool, list(scope.points), scope.depth + 1)
            body += ["else:", *("  " + one for one in self.line(other))]
        return [head, *body, "end"]

    def new_tool(self, scope: _Scope) -> list[str]:
        tool = self.tool()
        how = self.pick(["literal", "if", "computed", "variable", "else", "part"])
        if how in ("literal", "variable", "part"):
            scope.tool = tool
        self.count += 1
        name = f"tcp_{self.count}"
        return {
            "literal": [f"set_tcp({pose(tool)})"],
            "variable": [f"{name} = {pose(tool)}", f"set_tcp({name})"],
            "part": [f"{name} = {pose(tool)}", f"{name}[2] = {name}[2] + 0.03", f"set_tcp({name})"],
            "if": ["if get_standard_digital_in(2):", f"  set_tcp({pose(tool)})", "end"],
            "else": ["if get_standard_digital_in(2):", "  sleep(0.1)", "else:", f"  set_tcp({pose(tool)})", "end"],
            "computed": [f"set_tcp(pose_trans({pose(tool)}, p[0, 0, 0.02, 0, 0, 0]))"],
        }[how]

    def computed(self, scope: _Scope) -> list[str]:
        point = self.pick(scope.points) if scope.points and self.maybe(0.6) else self._target(scope)
        shift = _numbers(self.small() / 1e3, 4)
        return [
            self.pick(
                [
                    f"movel(pose_trans({point}, p[{shift}, 0, 0, 0]), a=1.2, v=0.25)",
                    f"movel(pose_add({point}, p[{shift}, 0, 0, 0]), a=1.2, v=0.25)",
                    f"movel(pose_trans(p[{shift}, 0, 0, 0.1], {point}), a=1.2, v=0.25)",
                    f"movel(pose_add(get_actual_tcp_pose(), p[{shift}, 0, 0, 0]), a=1.2, v=0.25)",
                    f"movel(pose_trans(get_actual_tcp_pose(), p[{shift}, 0, 0, 0]), a=1.2, v=0.25)",
                ]
            )
        ]

    def changed(self, scope: _Scope) -> list[str]:
        if not scope.points:
            return self.named(scope)
        name = self.pick(scope.points)
        return [
            *self.pick(
                [
                    [f"{name}[2] = {name}[2] + 0.02"],
                    [f"{name} = {self._target(scope)}"],
                    [f"{name} = pose_add({name}, p[0, 0, 0.02, 0, 0, 0])"],
                    ["if get_standard_digital_in(4):", f"  {name} = {self._target(scope)}", "end"],
                    ["if get_standard_digital_in(4):", f"  {name}[0] = 0.02 + {name}[0]", "end"],
                ]
            ),
            f"movel({name}, a=1.2, v=0.25)",
        ]

    def shifted(self, scope: _Scope) -> list[str]:
        on, off = self.pick(
            [
                ("track_conveyor_linear(p[1, 0, 0, 0, 0, 0], 500.0)", "stop_conveyor_tracking()"),
                ("path_offset_enable()", "path_offset_disable()"),
                ("path_offset_enable()\npath_offset_set(p[0.01, 0, 0, 0, 0, 0], 2)", "path_offset_disable()"),
                ('force_mode(p[0, 0, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 5.0, 0, 0, 0], 2, [0.1, 0.1, 0.1, 0.1, 0.1, 0.1])', "end_force_mode()"),
                ("freedrive_mode()\nsleep(5)", "end_freedrive_mode()"),
            ]
        )  # fmt: skip
        return [*on.split("\n"), *self.move(scope), *([off] if self.maybe(0.8) else []), *self.move(scope)]

    def unknown(self) -> list[str]:
        return [self.pick([f"{self.name()}()", f"ok = {self.name()}(1)", f"rq_{self.pick(['close', 'open'])}()"])]

    def inverse(self, scope: _Scope) -> list[str]:
        near = f", qnear=[{_numbers(self.near(), 4)}]"
        if self.maybe(0.3):
            near = ""
        return [f"movej(get_inverse_kin({self._target(scope)}{near}), a=1.4, v=1.05)"]
