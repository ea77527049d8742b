"""Random TP programs in the format of the pendant, including everything that changes a tool, frame or point."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tests.worlds.languages.arms import Array
from tests.worlds.languages.drawing import WORDS, Draft, Pen
from tests.worlds.languages.fanuc import config_letters


class _Text:
    """Lines and positions of a program."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.lines: list[str] = []
        self.positions: list[str] = []
        self.count = 0
        self.labels = 0


@dataclass
class _Scope:
    """Program with the frame and tool that the author assumes to be selected."""

    text: _Text
    uf: int = 1
    ut: int = 1
    depth: int = 0


class Writer(Pen):
    """Generator of a program and the programs it calls."""

    dialect = "fanuc"

    def __init__(self, seed: int, *, plain: bool) -> None:
        super().__init__(seed, plain=plain)
        self.tools = {1: self.tool(), 2: self.tool()}
        self.frames = {0: np.eye(4), 1: self.user_frame(), 3: self.user_frame()}
        self.files: dict[str, bytes] = {}
        self.groups = self.maybe(0.2)
        """True if the cell has a second motion group, such as a spot welding gun."""

    def draft(self) -> Draft:
        if self.plain:
            for name, on in (("GRIP_OPEN", "OFF"), ("GRIP_CLOSE", "ON")):
                other = _Text(name)
                other.lines = [f"  DO[1]={on}", "  WAIT    .30(sec)"]
                self._write(other)
                self.routines.append((name, "still"))
        for _ in range(0 if self.plain else self.whole(0, 3)):
            self._routine()
        text = _Text("PICK_PART")
        scope = _Scope(text, self.pick([0, 1]), 1)
        begin = [f"  UFRAME_NUM={scope.uf}", f"  UTOOL_NUM={scope.ut}"]
        text.lines += begin if self.plain or self.maybe(0.85) else begin[:1]
        text.lines += self.joint(scope, self.near())
        for _ in range(self.whole(4, 9)):
            text.lines += self.line(scope)
        self._write(text)
        tools = self.stated(self.tools, 0.9)
        frames = self.stated({k: T for k, T in self.frames.items() if k}, 0.9)
        return Draft(self.dialect, self.files, "PICK_PART.LS", ("PICK_PART.LS",), tools, frames, self.plain)

    def _write(self, text: _Text) -> None:
        rows, number = [], 0
        for line in text.lines:
            first, *rest = line.split("\n")
            if first.startswith("\v"):  # logic along the move before
                rows.append(f"      1:{first[1:]} ;" if first[1:] else "       ------ ;")
                continue
            if first.startswith("\t"):  # an additional row of SELECT
                number += 1
                rows.append(f"{number:4d}:  {first[1:]} ;")
                continue
            number += 1
            rows.append(f"{number:4d}:{first}" + (" ;" if not rest else "    "))
            rows += [f"    :{one} ;" for one in rest]
        track = self.pick(["", "", "/APPL\n\nAUTO_SINGULARITY_HEADER;\n  ENABLE_SINGULARITY_AVOIDANCE   : FALSE;\n"])
        if not self.plain and self.maybe(0.08):
            track = "/APPL\n  LINE_TRACK;\n    LINE_TRACK_SCHEDULE_NUMBER      : 1;\n    LINE_TRACK_BOUNDARY_NUMBER      : 1;\n    CONTINUE_TRACK_AT_PROG_END      : FALSE;\n"
        head = (
            f"/PROG  {text.name}\n/ATTR\nOWNER\t\t= MNEDITOR;\nCOMMENT\t\t= \"P[1] X = 1.0\";\nPROG_SIZE\t= 512;\n"
            f"CREATE\t\t= DATE 23-05-04  TIME 10:11:12;\nMODIFIED\t= DATE 23-05-04  TIME 10:11:12;\nFILE_NAME\t= ;\n"
            f"VERSION\t\t= 0;\nLINE_COUNT\t= {number};\nMEMORY_SIZE\t= 900;\nPROTECT\t\t= READ_WRITE;\n"
            "TCD:  STACK_SIZE\t= 0,\n      TASK_PRIORITY\t= 50,\n      TIME_SLICE\t= 0,\n      BUSY_LAMP_OFF\t= 0,\n"
            "      ABORT_REQUEST\t= 0,\n      PAUSE_REQUEST\t= 0;\nDEFAULT_GROUP\t= 1,*,*,*,*;\nCONTROL_CODE\t= 00000000 00000000;\n"
        )  # fmt: skip
        body = "\n".join([*rows, "/POS", *text.positions, "/END"]) + "\n"
        self.files[f"{text.name}.LS"] = self.coded(head + track + "/MN\n" + body, crlf=True)

    def _routine(self) -> None:
        name, what = self.name(), self.pick(["moves", "tool", "frame", "mixed", "offset", "select"])
        other = _Text(name)
        scope = _Scope(other, 1, 1, 1)
        if what == "moves":
            other.lines = ["  UFRAME_NUM=1", "  UTOOL_NUM=1", *self.joint(scope, self.astray())]
        elif what == "mixed":
            lines = [one for _ in range(3) for one in self.line(scope)]
            other.lines = ["  UFRAME_NUM=1", "  UTOOL_NUM=1", *lines]
        elif what == "offset":
            other.lines = ["  OFFSET CONDITION PR[9]"]
        elif what == "select":
            other.lines = [f"  UTOOL_NUM={self.pick([1, 2])}"]
        else:
            other.lines = self.setting(what)
        self._write(other)
        self.routines.append((name, what))

    def line(self, scope: _Scope) -> list[str]:
        """Return one or more random lines of a program. They contain difficult statements unless `self.plain` is set."""
        plain = [
            (3.0, self.move),
            (1.0, lambda scope: self.joint(scope, self.near())),
            (0.4, self.again),
            (0.4, self.arc),
            (0.4, self.approach),
            (1.0, lambda _: self.harmless()),
            (0.8, lambda scope: [*self.call(), *self.move(scope)]),
            (0.5, self.block),
        ]
        wild = [
            (0.8, self.offset),
            (0.7, lambda _: self.setting(self.pick(["tool", "frame"]))),
            (0.5, self.select),
            (0.4, self.changed),
            (0.3, lambda _: self.unknown()),
            (0.3, self.jump),
        ]
        return self.drawn(scope, plain, wild)

    def position(self, scope: _Scope, q: Array, *, joints: bool = False) -> int:
        """Teach a position, and return its number."""
        scope.text.count += 1
        k = scope.text.count
        comment = self.pick(["", f':"PUNKT{k}"'])
        degrees = np.degrees(q)
        extra = ""
        if self.groups:
            extra = f"\n   GP2:\n\tUF : {scope.uf}, UT : {scope.ut},\t\n\tJ1=     12.500  mm"
        if not self.plain and self.maybe(0.03):
            extra = f",\n\tE1=   150.000  mm{extra}"
        uf = "F" if not self.plain and self.maybe(0.05) else str(scope.uf)
        if joints:
            one = [f"J{axis}={angle:10.3f} deg" for axis, angle in enumerate(degrees, start=1)]
            inside = f"\tUF : {uf}, UT : {scope.ut},\t\n\t" + ",\t".join(one[:3]) + ",\n\t" + ",\t".join(one[3:])
        else:
            X = np.linalg.inv(self.frames[scope.uf]) @ self.flange(q) @ self.tools[scope.ut]
            x, y, z = X[:3, 3]
            w, p, r = Rotation.from_matrix(X[:3, :3]).as_euler("xyz", degrees=True)
            inside = (
                f"\tUF : {uf}, UT : {scope.ut},\t\tCONFIG : '{config_letters(q)}, 0, 0, 0',\n"
                f"\tX ={x:10.3f}  mm,\tY ={y:10.3f}  mm,\tZ ={z:10.3f}  mm,\n"
                f"\tW ={w:10.3f} deg,\tP ={p:10.3f} deg,\tR ={r:10.3f} deg"
            )
        scope.text.positions.append(f"P[{k}{comment}]{{\n   GP1:\n{inside}{extra}\n}};")
        return k

    def move(self, scope: _Scope) -> list[str]:
        k = self.position(scope, self.near())
        kind = self.pick(
            [
                f"J P[{k}] 30% CNT50",
                f"L P[{k}] 200mm/sec FINE",
                f"L P[{k}:PUNKT] 50mm/sec CNT20 ACC80",
                f"J P[{k}] 100% CNT100 TB    .10sec,DO[5]=ON",
            ]
        )
        after = self.pick(["", "", "", "\n  Arc Start[1]    ", "\n  SPOT[SD=1,P=1,S=1,ED=1]    ", "logic"])
        if self.plain or after != "logic":
            return [f"{kind}    {'' if after == 'logic' else after}"]
        action = self.pick([["  DO[1]=ON", "  WAIT (DI[2])"], ["  TC_ONLINE (ON)", *self.call()], self.setting("tool")])
        return [f"J P[{k}] 100% CNT0 ACC100 TB   0.00sec,P-SPS    ", *(f"\v{one}" for one in action), "\v"]

    def again(self, scope: _Scope) -> list[str]:
        if not scope.text.count:
            return self.move(scope)
        return [f"L P[{self.whole(1, scope.text.count)}] 100mm/sec FINE    "]

    def arc(self, scope: _Scope) -> list[str]:
        a, b = (self.position(scope, self.near()) for _ in range(2))
        return [f"C P[{a}]    \n  P[{b}] 100mm/sec FINE    "]

    def joint(self, scope: _Scope, q: Array) -> list[str]:
        """A move to joint angles (6,) rad."""
        return [f"J P[{self.position(scope, q, joints=True)}] 20% FINE    "]

    def harmless(self) -> list[str]:
        return [
            self.pick(["  DO[3]=ON", "  WAIT    .50(sec)", "  WAIT DI[2]=ON", f"  !{self.pick(WORDS)[:30]}", "  R[1]=R[1]+1",
                      "  OVERRIDE=50%", "  //L P[1] 200mm/sec FINE", "  PAYLOAD[1]", "  MESSAGE[P[4] X = 3.0 mm]", "  TIMER[1]=START", ""])
        ]  # fmt: skip

    def call(self) -> list[str]:
        if not self.routines:
            return self.harmless()
        name = self.pick(self.routines)[0]
        return [self.pick([f"  CALL {name}    ", f"  IF DI[4]=ON,CALL {name}"])]

    def block(self, scope: _Scope) -> list[str]:
        if scope.depth > 1:
            return self.harmless()
        inner = replace(scope, depth=scope.depth + 1)
        body = [one for _ in range(self.whole(1, 3)) for one in self.line(inner)]
        scope.text.labels += 1
        label = f"LBL[{scope.text.labels}]"
        head, end = self.pick(
            [(["  IF (DI[1]=ON) THEN"], ["  ENDIF"]), (["  FOR R[2]=1 TO 3"], ["  ENDFOR"]), (["  IF (R[1]>2) THEN"], ["  ELSE", "  DO[1]=OFF", "  ENDIF"]),
             ([f"  IF DI[1]=OFF,JMP {label}"], [f"  {label}"]), ([f"  {label}"], [f"  IF R[1]<5,JMP {label}"])]
        )  # fmt: skip
        return [*head, *body, *end]

    def offset(self, scope: _Scope) -> list[str]:
        k = self.position(scope, self.near())
        how = self.pick(["Offset,PR[3]", "Tool_Offset,PR[4]", "Offset", "VOFFSET,VR[1]", "INC", "COORD", "TB .10sec,DO[5]=ON Offset,PR[3]"])  # fmt: skip
        before = ["  OFFSET CONDITION PR[3]"] if how == "Offset" and self.maybe(0.5) else []
        literal = ["  PR[3]=LPOS-LPOS", f"  PR[3,3]={self.rng.uniform(2, 50):.1f}"] if self.maybe(0.3) else []
        again = [f"L P[{k}] 100mm/sec FINE    "] if self.maybe(0.6) else []
        return [*literal, *before, f"L P[{k}] 100mm/sec FINE {how}    ", *again]

    def approach(self, scope: _Scope) -> list[str]:
        """An approach from above, using a position register set by the program."""
        k = self.position(scope, self.near())
        zeros = [f"  PR[12,{axis}]=0" for axis in (1, 2, 4, 5, 6)]
        z = self.pick([10, 20, 30, 50])
        how = self.pick([(f"  PR[12,3]={z}", "Offset,PR[12]"), (f"  PR[12,3]=(-{z})", "Tool_Offset,PR[12]")])
        return [*zeros, how[0], f"L P[{k}] 200mm/sec FINE {how[1]}    ", f"L P[{k}] 100mm/sec FINE    "]

    def setting(self, what: str) -> list[str]:
        """Return lines that change a tool or a frame in the controller."""
        name, numbers = ("UTOOL", [1, 2]) if what == "tool" else ("UFRAME", [1, 3])
        k = self.pick(numbers)
        lines = self.pick(
            [[f"  {name}[{k}]=PR[5]"], [f"  PR[6]={name}[{k}]", f"  PR[6,3]={self.rng.uniform(60, 150):.1f}", f"  {name}[{k}]=PR[6]"],
             [f"  {name}_NUM={k}", f"  {name}[{k}]=PR[7:kamera]"]]
        )  # fmt: skip
        return self.inside(0.3, "  IF (DI[7]=ON) THEN", lines, "  ENDIF", "")

    def select(self, scope: _Scope) -> list[str]:
        if self.maybe(0.2):
            return [self.pick(["  UFRAME_NUM=R[5]", "  UTOOL_NUM=R[6]"]), *self.move(scope)]
        scope.uf, scope.ut = self.pick([0, 1, 3]), self.pick([1, 2])
        return [f"  UFRAME_NUM={scope.uf}", f"  UTOOL_NUM={scope.ut}", *self.move(scope)]

    def changed(self, scope: _Scope) -> list[str]:
        k = self.position(scope, self.near())
        lines = [self.pick([f"  P[{k}]=PR[8]", f"  P[{k},3]=R[4]", f"  PR[8]=P[{k}]"])]
        lines = lines if self.maybe(0.6) else ["  IF (DI[8]=ON) THEN", *lines, "  ENDIF"]
        return [
            *lines,
            f"L P[{k}] 100mm/sec FINE    ",
            self.pick(["L PR[8] 100mm/sec FINE    ", "L P[R[3]] 100mm/sec FINE    ", "  R[9]=1"]),
        ]

    def unknown(self) -> list[str]:
        return [self.pick([f"  CALL {self.name()}    ", "  CALL VISION_FIND(1)", f"  RUN {self.name()}"])]

    def jump(self, scope: _Scope) -> list[str]:
        if scope.depth or not self.routines:
            return self.harmless()
        scope.text.labels += 2
        a, b = scope.text.labels - 1, scope.text.labels
        return [f"  SELECT R[1]=1,CALL {self.pick(self.routines)[0]}", f"\t       =2,JMP LBL[{a}]", f"\t       ELSE,JMP LBL[{b}]", f"  LBL[{a}]",
                *self.setting("tool"), f"  LBL[{b}:weiter]", *self.move(scope)]  # fmt: skip
