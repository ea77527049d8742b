"""Random RAPID modules in the style of RobotStudio and of hand-written code, including everything that changes a
tool, work object, displacement or posture.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from tests.worlds.languages.arms import Array, frame
from tests.worlds.languages.drawing import WORDS, Draft, Pen
from tests.worlds.languages.rapid import confdata

_EXTERNAL = "[9E9,9E9,9E9,9E9,9E9,9E9]"


@dataclass
class _Scope:
    """Assumptions of the program author at a line."""

    displaced: Array
    depth: int = 0
    points: list[str] = field(default_factory=list)


def _text(values: Array, digits: int) -> str:
    return "[" + ",".join(f"{value:.{digits}f}".rstrip("0").rstrip(".") for value in values) + "]"


def pose(T: Array, digits: int = 3) -> str:
    """Return [[x,y,z],[q1,q2,q3,q4]] of a frame (4, 4)."""
    quaternion = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)
    return f"[{_text(T[:3, 3], digits)},{_text(quaternion, 9)}]"


class Writer(Pen):
    """Generator of a program."""

    dialect = "abb"

    def __init__(self, seed: int, *, plain: bool) -> None:
        super().__init__(seed, plain=plain)
        self.declared: list[str] = []
        self.tools = {"tGrip": self.tool()}
        self.wobjs = {"wTable": self.user_frame()}
        if not self.plain:
            self.tools["tPen"] = self.tool()
            self.wobjs["wobj0"] = np.eye(4)
            self.wobjs["wPart"] = self.user_frame()
        self.indent = self.pick(["  ", "    ", "\t"])

    def draft(self) -> Draft:
        stated_tools, stated_frames, elsewhere = {}, {}, []
        for name, T in self.tools.items():
            line = f"PERS tooldata {name}:=[TRUE,{pose(T, 4)},[1.2,[0,0,60],[1,0,0,0],0,0,0]];"
            if self.maybe(0.15):
                stated_tools[name] = T
            elif not self.plain and self.maybe(0.2):
                elsewhere.append(line)
                if self.maybe(0.5):
                    stated_tools[name] = T
            else:
                self.declared.append(line)
        for name, T in self.wobjs.items():
            if name == "wobj0":
                continue
            pair = f"{pose(T, 4)},[[0,0,0],[1,0,0,0]]"
            if self.maybe(0.3):
                half = frame(T[:3, 3] / 2, Rotation.from_matrix(T[:3, :3]))
                pair = f"{pose(half, 6)},{pose(np.linalg.inv(half) @ T, 6)}"
            line = f'PERS wobjdata {name}:=[FALSE,TRUE,"",{pair}];'
            if self.maybe(0.15):
                stated_frames[name] = T
            else:
                self.declared.append(line)
        scope = _Scope(np.eye(4))
        if self.plain:
            for name, on in (("gripper_open", 0), ("GripClose", 1)):
                self._put(name, [f"SetDO doGrip,{on};", "WaitTime 0.3;"], "still")
        for _ in range(0 if self.plain else self.whole(0, 3)):
            self._routine(scope)
        body = self._joint(self.near())
        if self.plain and self.maybe(0.15):  # typical start of a post-processor's output
            body = ["ConfL \\Off;", "ConfJ \\Off;", *body]
        elif self.maybe(0.4):
            body = [f"{self.pick(['ConfJ', 'ConfL'])}\\On;", *body]
        for _ in range(self.whole(4, 9)):
            body += self.line(scope)
        self._put("main", body, "")
        order = self.texts[::-1] if self.maybe(0.5) else self.texts
        other = ""
        if not self.plain and (elsewhere or self.maybe(0.3)):
            last = order.pop(0) if len(order) > 1 and "main()" not in order[0] else ""
            other = "\n".join(["MODULE Other", *elsewhere, last, "ENDMODULE"]) + "\n"
        text = (
            "\n".join(["MODULE MainModule", *(self.indent + one for one in self.declared), *order, "ENDMODULE"]) + "\n"
        )
        if self.maybe(0.5):
            text = "%%%\n  VERSION:1\n  LANGUAGE:ENGLISH\n%%%\n" + text
        files = {"Main.mod": self.coded(text, crlf=True)}
        if other:
            files["Other.mod"] = self.coded(other, crlf=True)
        given = tuple(files) if self.maybe(0.3) else ("Main.mod",)
        return Draft(self.dialect, files, "Main.mod", given, stated_tools, stated_frames, self.plain)

    def _put(self, name: str, lines: list[str], kind: str, arguments: str = "") -> None:
        body = [self.indent * 2 + one for one in lines]
        self.texts.append("\n".join([f"{self.indent}PROC {name}({arguments})", *body, f"{self.indent}ENDPROC"]))
        if kind:
            self.routines.append((name, kind))

    def _routine(self, scope: _Scope) -> None:
        name, kind = self.name(), self.pick(["moves", "tool", "wobj", "disp", "mixed", "point", "conf"])
        inner = _Scope(scope.displaced, 1)
        lines = {
            "moves": self._joint(self.astray()),
            "tool": self._part("tool"),
            "wobj": self._part("wobj"),
            "disp": [f"PDispSet {pose(frame(self.small(), Rotation.identity()))};"],
            "conf": ["ConfL\\Off;", "ConfJ\\Off;", *self._joint(self.astray())],
            "mixed": [],
            "point": ["MoveL goal,v100,fine,tGrip\\WObj:=wTable;"],
        }[kind]
        if kind == "mixed":
            lines = [one for _ in range(3) for one in self.line(inner)]
        self._put(name, lines, kind, "robtarget goal" if kind == "point" else "")

    def line(self, scope: _Scope) -> list[str]:
        """Return one or more instructions."""
        plain = [
            (3.0, self.move),
            (1.0, lambda _: self._joint(self.near())),
            (0.6, self.again),
            (0.4, self.arc),
            (0.8, self.approach),
            (1.0, lambda _: self.harmless()),
            (0.8, lambda scope: [*self.call(), *self.move(scope)]),
            (0.5, self.block),
        ]
        wild = [
            (0.8, self.offset),
            (0.5, lambda _: self._part(self.pick(["tool", "wobj"]))),
            (0.6, self.displace),
            (0.5, self.changed),
            (0.3, self.posture),
            (0.3, lambda _: self.unknown()),
            (0.2, self.array),
            (0.12, self.track),
        ]
        return self.drawn(scope, plain, wild)

    def _ends(self) -> tuple[str, str, str]:
        """A tool, a work object, and the remaining arguments of a move."""
        tool, wobj = self.pick(list(self.tools)), self.pick(list(self.wobjs))
        if self.plain:
            tool, wobj = "tGrip", "wTable"
        zone = self.pick(["fine", "z10", "z50"])
        rest = f",v{self.pick([50, 100, 500])},{zone},{tool}" + ("" if wobj == "wobj0" else f"\\WObj:={wobj}") + ";"
        return tool, wobj, rest

    def target(self, tool: str, wobj: str, scope: _Scope) -> str:
        """A robtarget near the middle of the work area."""
        q = self.near()
        X = np.linalg.inv(self.wobjs[wobj] @ scope.displaced) @ self.flange(q) @ self.tools[tool]
        conf = "[" + ",".join(f"{int(value)}" for value in confdata(q)) + "]"
        external = _EXTERNAL
        if not self.plain and self.maybe(0.05):
            external = "[150,9E9,9E9,9E9,9E9,9E9]"
        return pose(X, 4)[:-1] + f",{conf},{external}]"

    def _point(self, tool: str, wobj: str, scope: _Scope, *, named: bool = False) -> str:
        """Name of a declared point, or its numbers."""
        text = self.target(tool, wobj, scope)
        if self.maybe(0.25) and not named:
            return text
        self.count += 1
        name = f"{self.pick(['p', 'Target_', 'pPick'])}{self.count * 10}"
        kind = self.pick(
            ["CONST", "CONST", "PERS", "LOCAL CONST"] if self.plain else ["CONST", "PERS", "VAR", "LOCAL CONST"]
        )
        if self.maybe(0.1):
            text = text.replace("],[", "],\n    [", 1)
        self.declared.append(f"{kind} robtarget {name}:={text};")
        scope.points.append(f"{name} {tool} {wobj}")
        return name

    def move(self, scope: _Scope) -> list[str]:
        tool, wobj, rest = self._ends()
        kind = self.pick(["MoveJ", "MoveL", "MoveL"])
        return [f"{kind} {self._point(tool, wobj, scope)}{rest}"]

    def again(self, scope: _Scope) -> list[str]:
        if not scope.points:
            return self.move(scope)
        name, tool, wobj = self.pick(scope.points).split()
        if not self.plain and self.maybe(0.2):
            tool, wobj = self.pick(list(self.tools)), self.pick(list(self.wobjs))
        return [f"MoveL {name},v100,fine,{tool}" + ("" if wobj == "wobj0" else f"\\WObj:={wobj}") + ";"]

    def arc(self, scope: _Scope) -> list[str]:
        tool, wobj, rest = self._ends()
        return [f"MoveC {self._point(tool, wobj, scope)},{self._point(tool, wobj, scope)}{rest}"]

    def approach(self, scope: _Scope) -> list[str]:
        """An approach to a point from above or along the tool, with retraction."""
        tool, wobj, rest = self._ends()
        name = self._point(tool, wobj, scope, named=True)
        z = self.pick([10, 20, 30, 50])
        how = self.pick([f"Offs({name},0,0,{z})", f"RelTool({name},0,0,-{z})", f"RelTool({name},0,0,-{z}\\Rz:=2)"])
        first = self.pick(["MoveJ", "MoveL"])
        return [f"{first} {how}{rest}", f"MoveL {name}{rest}", *([f"MoveL {how}{rest}"] if self.maybe(0.5) else [])]

    def track(self, scope: _Scope) -> list[str]:
        """A move of the track, alone or together with the arm."""
        alone = f"MoveExtJ [{_EXTERNAL},[150,9E9,9E9,9E9,9E9,9E9]],vrot10,fine;"
        together = f"MoveAbsJ [{_text(np.degrees(self.near()), 4)},[150,9E9,9E9,9E9,9E9,9E9]],v200,fine,tGrip;"
        return [self.pick([alone, together]), *self.move(scope)]

    def _joint(self, q: Array) -> list[str]:
        text = f"[{_text(np.degrees(q), 4)},{_EXTERNAL}]"
        if self.maybe(0.5):
            self.count += 1
            self.declared.append(f"CONST jointtarget j{self.count}:={text};")
            text = f"j{self.count}"
        return [f"MoveAbsJ {text}{self.pick(['', chr(92) + 'NoEOffs'])},v200,fine,tGrip;"]

    def harmless(self) -> list[str]:
        return [
            self.pick(
                ["SetDO do1,1;", "WaitTime 0.5;", f'TPWrite "{self.pick(WORDS)}";', f"! {self.pick(WORDS)}", "Reset do2;",
                 "WaitDI di1,1;", "AccSet 50,100;", "VelSet 100,500;", "TPErase;", "GripLoad load0;", "reg1:=reg1+1;",
                 "PulseDO\\PLength:=0.2,do3;"]
            )
        ]  # fmt: skip

    def call(self) -> list[str]:
        if not self.routines:
            return self.harmless()
        name, kind = self.pick(self.routines)
        if kind == "point":
            return [f"{name} {self.target('tGrip', 'wTable', _Scope(np.eye(4)))};"]
        return [f"{name};"]

    def block(self, scope: _Scope) -> list[str]:
        if scope.depth > 1:
            return self.harmless()
        inner = _Scope(scope.displaced, scope.depth + 1, list(scope.points))
        body = [self.indent + one for _ in range(self.whole(1, 3)) for one in self.line(inner)]
        head, end = self.pick(
            [
                ("IF di1=1 THEN", "ENDIF"),
                ("FOR i FROM 1 TO 3 DO", "ENDFOR"),
                ("WHILE reg1<5 DO", "ENDWHILE"),
                ("TEST reg1\nCASE 1:", "DEFAULT:\n  Stop;\nENDTEST"),
                ("IF di1=1 THEN", "ELSE\n  SetDO do1,0;\nENDIF"),
            ]
        )
        return [*head.split("\n"), *body, *end.split("\n")]

    def _part(self, what: str) -> list[str]:
        name = (
            self.pick(list(self.tools)) if what == "tool" else self.pick([one for one in self.wobjs if one != "wobj0"])
        )
        shift = self.rng.uniform(-40, 40)
        parts = (
            [f"{name}.tframe.trans.z:={abs(shift) + 60:.1f};", f"{name}.tframe:={pose(self.tool())};",
             f"{name}.tframe.rot:=OrientZYX({shift:.1f},0,0);", f"{name}:=tPen;",
             f'ok:=StrToVal("1",{name}.tframe.trans.z);']
            if what == "tool"
            else [f"{name}.uframe:=DefFrame(p1,p2,p3);", f"{name}.oframe.trans.x:={shift:.1f};",
                  f"{name}.uframe.trans:={_text(self.small(), 1)};", f"{name}.oframe:=PoseMult({name}.oframe,{pose(frame(self.small(), Rotation.identity()))});"]
        )  # fmt: skip
        line = self.pick(parts)
        return [line] if self.maybe(0.6) else ["IF di4=1 THEN", self.indent + line, "ENDIF"]

    def offset(self, scope: _Scope) -> list[str]:
        tool, wobj, rest = self._ends()
        taught = scope.points and self.maybe(0.5)
        name = self.pick(scope.points).split()[0] if taught else self._point(tool, wobj, scope)
        x, y, z = self.small()
        if self.maybe(0.3):
            x, y, z = x / 20, y / 20, z / 20
        how = self.pick(
            [f"Offs({name},{x:.1f},{y:.1f},{z:.1f})", f"RelTool({name},{x:.1f},0,{z:.1f})",
             f"RelTool({name},0,0,{z:.1f}\\Rz:=20)", f"Offs({name},0,0,reg1)", f"Offs(CRobT(),0,0,{z:.1f})",
             f"Offs(CRobT(\\Tool:={tool}\\WObj:={wobj}),0,0,{z:.1f})"]
        )  # fmt: skip
        return [f"MoveL {how}{rest}", *(self.again(scope) if self.maybe(0.5) else [])]

    def displace(self, scope: _Scope) -> list[str]:
        tool, wobj, _ = self._ends()
        D = frame(self.small(), Rotation.from_rotvec([0, 0, float(self.rng.uniform(-0.3, 0.3))]))
        point = self._point(tool, wobj, scope)
        how = self.pick(["set", "variable", "on", "rot", "exep", "off", "if"])
        self.count += 1
        lines = {
            "set": [f"PDispSet {pose(D)};"],
            "variable": [f"xp{self.count}:={pose(D)};", f"PDispSet xp{self.count};"],
            "on": [f"PDispOn {point},{tool};"],
            "rot": [f"PDispOn \\Rot,{point},{tool}\\WObj:={wobj};"],
            "exep": [f"PDispOn \\ExeP:={self._point(tool, wobj, scope)},{point},{tool};"],
            "off": ["PDispOff;"],
            "if": ["IF di3=1 THEN", f"  PDispSet {pose(D)};", "ENDIF"],
        }[how]
        if how == "variable":
            self.declared.append(f"VAR pose xp{self.count};")
        return [*lines, *self.move(scope), *(["PDispOff;"] if self.maybe(0.6) else [])]

    def changed(self, scope: _Scope) -> list[str]:
        if not scope.points:
            return self.move(scope)
        name, tool, wobj = self.pick(scope.points).split()
        line = self.pick(
            [f"{name}.trans.z:={name}.trans.z+20;", f"{name}:=Offs({name},0,0,10);", f"{name}.trans:=[400,50,500];",
             f"{name}:={self.target(tool, wobj, scope)};", f"{name}:=CRobT(\\Tool:={tool}\\WObj:={wobj});"]
        )  # fmt: skip
        lines = [line] if self.maybe(0.6) else ["IF di5=1 THEN", "  " + line, "ENDIF"]
        return [*lines, f"MoveL {name},v100,fine,{tool}" + ("" if wobj == "wobj0" else f"\\WObj:={wobj}") + ";"]

    def posture(self, scope: _Scope) -> list[str]:
        switch = self.pick(["ConfL\\Off;", "ConfJ\\Off;", "SingArea\\Wrist;"])
        return [switch, *(self._joint(self.astray()) if self.maybe(0.4) else []), *self.move(scope)]

    def array(self, scope: _Scope) -> list[str]:
        self.count += 1
        tool, wobj, rest = self._ends()
        rows = ",\n    ".join(self.target(tool, wobj, scope) for _ in range(2))
        name = f"pArr{self.count}"
        self.declared.append(f"CONST robtarget {name}{{2}}:=[\n    {rows}];")
        return [f"MoveL {name}{{1}}{rest}", f"MoveL {name}{{{self.pick(['2', 'reg1'])}}}{rest}"]

    def unknown(self) -> list[str]:
        return [self.pick([f"{self.name()};", f"reg1:={self.name()}(1);", "DoSomethingElse 3,TRUE;"])]
