"""Random KRL modules with inline forms, expert code and post-processor output, including everything that changes a
tool, base or point.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from tests.worlds.languages.arms import Array
from tests.worlds.languages.drawing import WORDS, Draft, Pen
from tests.worlds.languages.krl import status_turn


@dataclass
class _Scope:
    """Assumptions of the program author at a line."""

    tool: Array
    base: Array
    depth: int = 0
    points: list[str] = field(default_factory=list)


def aggregate(T: Array, digits: int = 3) -> str:
    """Return X 1.0,Y 2.0,… of a frame (4, 4)."""
    values = [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_euler("ZYX", degrees=True)]
    return ",".join(f"{name} {value:.{digits}f}" for name, value in zip("XYZABC", values, strict=True))


class Writer(Pen):
    """Generator of a module."""

    dialect = "kuka"

    def __init__(self, seed: int, *, plain: bool) -> None:
        super().__init__(seed, plain=plain)
        self.tools = {1: self.tool(), 2: self.tool()}
        self.bases = {1: self.user_frame(), 2: self.user_frame()}
        self.data: list[str] = []
        self.extra = self.pick(["", ",E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0"])
        self.inline = self.maybe(0.5)

    def draft(self) -> Draft:
        scope = _Scope(self.tools[1], self.bases[1])
        if self.plain:
            for name, on in (("grip_open", "FALSE"), ("GripClose", "TRUE")):
                self._put(name, [f"$OUT[3]={on}", "WAIT SEC 0.3"], "still")
        for _ in range(0 if self.plain else self.whole(0, 3)):
            self._routine(scope)
        stop = ["  GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )", "  INTERRUPT ON 3 "]
        body = [";FOLD INI;%{PE}", *(stop if self.maybe(0.5) else []), "  BAS (#INITMOV,0 )", ";ENDFOLD (INI)"]
        body += self.pick(
            [[], ["BAS (#VEL_PTP,50)", "BAS (#ACC_PTP,50)"], ["PTP $AXIS_ACT ; skip BCO quickly"], ["$H_POS=XHOME"]]
        )
        body += [*self.begin(scope), *self.joint(self.near())]
        for _ in range(self.whole(4, 9)):
            body += self.line(scope)
        main = self._text("pick", body, "DEF")
        elsewhere = [text for text in self.texts if not self.plain and self.maybe(0.2) and text.startswith("DEF ")]
        inside = [text for text in self.texts if text not in elsewhere]
        head = "&ACCESS RVP\n&REL 4\n" if self.maybe(0.7) else ""
        files = {"pick.src": self.coded(head + "\n".join([main, *inside]) + "\n", crlf=True)}
        if self.data or self.maybe(0.5):
            lines = ["DEFDAT  PICK", "EXT  BAS (BAS_COMMAND  :IN,REAL  :IN )", *self.data, "ENDDAT"]
            files["pick.dat"] = self.coded(head + "\n".join(lines) + "\n", crlf=True)
        for text in elsewhere:
            name = text.split()[1].split("(")[0]
            files[f"{name}.src"] = self.coded(head + text + "\n", crlf=True)
        tools, bases = self.stated(self.tools, 0.85), self.stated(self.bases, 0.85)
        return Draft(self.dialect, files, "pick.src", ("pick.src",), tools, bases, self.plain)

    def _text(self, name: str, lines: list[str], kind: str, arguments: str = "") -> str:
        end = "ENDFCT" if kind.startswith("DEFFCT") else "END"
        return "\n".join([f"{kind} {name}({arguments})", *("  " + one for one in lines), end])

    def _put(self, name: str, lines: list[str], what: str, kind: str = "DEF", arguments: str = "") -> None:
        self.texts.append(self._text(name, lines, kind, arguments))
        self.routines.append((name, what))

    def _routine(self, scope: _Scope) -> None:
        name, what = self.name(), self.pick(["moves", "tool", "base", "mixed", "value", "point"])
        if what == "value":
            self._put(name, [*self.literal(self.astray()), "RETURN TRUE"], what, "DEFFCT BOOL")
        elif what == "point":
            self._put(name, ["LIN goal"], what, "DEF", "goal:IN")
        elif what == "mixed":
            inner = _Scope(scope.tool, scope.base, 1)
            self._put(name, [one for _ in range(3) for one in self.line(inner)], what)
        else:
            lines = self.literal(self.astray()) if what == "moves" else self.setting(what, scope)
            self._put(name, lines, what)

    def begin(self, scope: _Scope) -> list[str]:
        """Return instructions that set tool and base before the first move."""
        literal = [f"$TOOL={{{aggregate(scope.tool)}}}", f"$BASE={{{aggregate(scope.base)}}}"]
        ways = [literal, ["$TOOL=TOOL_DATA[1]", "$BASE=BASE_DATA[1]"], ["BAS(#TOOL,1)", "BAS(#BASE,1)"],
                [one.replace("={", "={FRAME: ") for one in literal]]  # fmt: skip
        return list(self.pick(ways)) if self.plain or self.maybe(0.8) else literal[:1] if self.maybe(0.5) else []

    def line(self, scope: _Scope) -> list[str]:
        """Return one or more instructions."""
        plain = [
            (3.0, self.move),
            (1.0, lambda _: self.joint(self.near())),
            (0.5, self.arc),
            (1.0, lambda _: self.harmless()),
            (0.8, lambda scope: [*self.call(), *self.move(scope)]),
            (0.5, self.block),
        ]
        wild = [
            (0.9, lambda scope: self.setting(self.pick(["tool", "base", "base"]), scope)),
            (0.6, self.computed),
            (0.5, self.changed),
            (0.4, self.external),
            (0.3, lambda _: self.unknown()),
            (0.3, self.interrupt),
            (0.2, self.jump),
            (0.5, self.returned),
            (0.15, self.track),
        ]
        return self.drawn(scope, plain, wild)

    def target(self, scope: _Scope) -> str:
        """Components of a position near the middle of the work area."""
        q = self.near()
        X = np.linalg.inv(scope.base) @ self.flange(q) @ scope.tool
        s, t = status_turn(q)
        # The pendant writes decimals; hand-written code has bits.
        flags = f",S {s},T {t}" if self.plain or self.maybe(0.8) else f",S 'B{s:03b}',T 'B{t:06b}'"
        extra = self.extra
        if not self.plain and self.maybe(0.06):
            extra = ",E1 150.0,E2 0.0"
        return aggregate(X, self.pick([3, 6])) + flags + extra

    def move(self, scope: _Scope) -> list[str]:
        text = self.target(scope)
        kind = self.pick(["PTP", "LIN", "LIN", "SLIN", "SPTP"])
        zone = {"PTP": "C_PTP", "LIN": "C_DIS"}.get(kind, "")
        end = f" {zone}" if self.maybe(0.3) and zone else ""
        if self.inline and scope.depth == 0 and self.maybe(0.7):
            return self.form(scope, text)
        if self.maybe(0.4):
            return [f"{kind} {self.point(text, scope)}{end}"]
        typed = self.pick(["", "", "E6POS: " if self.extra else "POS: "])
        return [f"{kind} {{{typed}{text}}}{end}"]

    def point(self, text: str, scope: _Scope) -> str:
        """Add a position to the data list and return its name."""
        self.count += 1
        name = f"XP{self.count}"
        self.data.append(f"{self.pick(['DECL E6POS', 'DECL GLOBAL E6POS', 'E6POS'])} {name}={{{text}}}")
        scope.points.append(name)
        return name

    def form(self, scope: _Scope, text: str) -> list[str]:
        """An inline form as the pendant writes it, with its tool and base by number."""
        tool = base = 1
        if not self.plain and self.maybe(0.3):
            tool, base = self.pick([1, 2]), self.pick([1, 2])
        text = self.target(_Scope(self.tools[tool], self.bases[base]))
        name = self.point(text, scope)
        k = name[2:]
        frame_ = "#TCP" if not self.plain and self.maybe(0.08) else "#BASE"
        self.data.append(
            f'DECL FDAT FP{k}={{TOOL_NO {tool},BASE_NO {base},IPO_FRAME {frame_},POINT2[] " ",TQ_STATE FALSE}}'
        )
        self.data.append(f"DECL PDAT PPDAT{k}={{VEL 100.000,ACC 100.000,APO_DIST 100.000}}")
        scope.tool, scope.base = self.tools[tool], self.bases[base]
        if self.maybe(0.6):
            return [
                f";FOLD PTP P{k} Vel=100 % PDAT{k} Tool[{tool}]:grip Base[{base}]:table;%{{PE}}%R 8.3.38",
                "$BWDSTART=FALSE", f"PDAT_ACT=PPDAT{k}", f"FDAT_ACT=FP{k}", "BAS(#PTP_PARAMS,100)",
                *["SET_CD_PARAMS (0)"] * (self.count % 2), f"PTP {name}", ";ENDFOLD",
            ]  # fmt: skip
        return [
            f"SLIN {name} WITH $VEL=SVEL_CP(0.5, , LCPDAT{k}), $TOOL=STOOL2(FP{k}), $BASE=SBASE(FP{k}.BASE_NO), "
            f"$IPO_MODE=SIPO_MODE(FP{k}.IPO_FRAME)"
            + f", $LOAD=SLOAD(FP{k}.TOOL_NO), $COLLMON_TOL_PRO[1]=USE_CM_PRO_VALUES(0)"
            * (self.count % 2)
        ]

    def arc(self, scope: _Scope) -> list[str]:
        return [f"CIRC {{{self.target(scope)}}},{{{self.target(scope)}}}" + self.pick(["", ", CA 90.0", " C_DIS"])]

    def joint(self, q: Array) -> list[str]:
        if self.maybe(0.3):
            self.count += 1
            self.data.append(f"DECL E6AXIS XP{self.count}={{{self._axes(q)},E1 0.0,E2 0.0}}")
            return [f"PTP XP{self.count}"]
        return self.literal(q)

    def _axes(self, q: Array) -> str:
        return ",".join(f"A{k + 1} {value:.4f}" for k, value in enumerate(np.degrees(q)))

    def literal(self, q: Array) -> list[str]:
        """A move to joint angles (6,) rad."""
        typed = self.pick(["", "AXIS: "])
        return [f"PTP {{{typed}{self._axes(q)}}}"]

    def harmless(self) -> list[str]:
        return [
            self.pick(
                ["$OUT[1]=TRUE", "WAIT SEC 0.5", "WAIT FOR $IN[1]", f"; {self.pick(WORDS)}", "$VEL.CP=0.5", "$ACC.CP=2.0",
                 "$APO.CDIS=5", "$ADVANCE=3", "FOR I=1 TO 6\n  $VEL_AXIS[I]=50\nENDFOR", "count=count+1", "$ORI_TYPE=#VAR",
                 "PULSE($OUT[2],TRUE,0.3)", "$OV_PRO=50", 'MsgNotify("PTP {A1 0}")']
            )
        ]  # fmt: skip

    def call(self) -> list[str]:
        if not self.routines:
            return self.harmless()
        name, what = self.pick(self.routines)
        if what == "value":
            return self.pick(
                [[f"ok={name}()"], [f"IF {name}() THEN", "  WAIT SEC 0.1", "ENDIF"], [f"WAIT FOR {name}()"]]
            )
        if name == "measure":
            return [f"measure(BASE_DATA[{self.pick([1, 2])}])"]
        if what == "point":
            return [f"{name}({{{self.target(_Scope(self.tools[1], self.bases[1]))}}})"]
        return [f"{name}()"]

    def block(self, scope: _Scope) -> list[str]:
        if scope.depth > 1:
            return self.harmless()
        inner = _Scope(scope.tool, scope.base, scope.depth + 1, list(scope.points))
        body = ["  " + one for _ in range(self.whole(1, 3)) for one in self.line(inner)]
        head, end = self.pick(
            [("IF $IN[1] THEN", "ENDIF"), ("IF $IN[2]==TRUE THEN", "ELSE\n  $OUT[1]=FALSE\nENDIF"), ("FOR I=1 TO 3", "ENDFOR"),
             ("WHILE count<3", "ENDWHILE"), ("SWITCH mode\nCASE 1", "DEFAULT\n  HALT\nENDSWITCH"), ("REPEAT", "UNTIL $IN[3]"),
             ("LOOP", "  IF $IN[4] THEN\n    EXIT\n  ENDIF\nENDLOOP")]
        )  # fmt: skip
        return [*head.split("\n"), *body, *end.split("\n")]

    def setting(self, what: str, scope: _Scope) -> list[str]:
        """Return instructions that change the tool or the base, completely or partially."""
        name, data = ("$TOOL", "TOOL_DATA") if what == "tool" else ("$BASE", "BASE_DATA")
        k = self.pick([1, 2])
        made = self.tool() if what == "tool" else self.user_frame()
        shift = self.rng.uniform(-40, 40)
        text = aggregate(made)
        lines = self.pick(
            [[f"{name}={{{text}}}"], [f"{name}={{FRAME: {text}}}"], [f"{name}.Z={name}.Z+{shift:.1f}"], [f"{name}.A={shift:.1f}"],
             [f"{data}[{k}]={{{text}}}"], [f"{data}[{k}].X={shift:.1f}", f"{name}={data}[{k}]"], [f"{name}={data}[{k}]"],
             [f"{name}={data}[{k}]:{{X {shift:.1f},Y 0,Z 0,A 0,B 0,C 0}}"], [f"{name}=measured_frame"], [f"BAS({'#TOOL' if what == 'tool' else '#BASE'},{k})"],
             [f"{name}=$NULLFRAME"] if what == "base" else [f"{name}={{{text}}}"]]
        )  # fmt: skip
        if len(lines) == 1 and lines[0].startswith(f"{name}={{"):
            if what == "tool":
                scope.tool = made
            else:
                scope.base = made
        return self.inside(0.3, "IF $IN[7] THEN", lines, "ENDIF")

    def returned(self, scope: _Scope) -> list[str]:
        """Return calls with output parameters."""
        k = self.pick([1, 2])
        name, data = self.pick([("$TOOL", "TOOL_DATA"), ("$BASE", "BASE_DATA"), ("$BASE", "BASE_DATA")])
        lines = self.pick(
            [[f'RET=EKI_GETFRAME("V","S/F",{data}[{k}])', f"{name}={data}[{k}]"], [f'RET=EKI_GETFRAME("V","S/F",{name})'],
             [f'RET=EKI_GETREAL("V","S/Z",{data}[{k}].Z)', f"{name}={data}[{k}]"], [f'ok=StrToFrame("x",{name})'],
             ['RET=EKI_GETREAL("V","S/H",height)'], [f"measure({data}[{k}])", f"{name}={data}[{k}]"]]
        )  # fmt: skip
        if lines[0].startswith("measure") and "measure" not in [one for one, _ in self.routines]:
            self._put("measure", [f"f={{{aggregate(self.user_frame())}}}"], "still", "DEF", "f:OUT")
        if scope.points and self.maybe(0.2):
            lines = [f'RET=EKI_GETREAL("V","S/Z",{self.pick(scope.points)}.Z)']
        return [*self.inside(0.2, "IF $IN[7] THEN", lines, "ENDIF"), *self.move(scope)]

    def track(self, scope: _Scope) -> list[str]:
        """A move of the track that carries the arm, and poses with or without its position."""
        there = self.pick(
            [
                f"PTP {{{self._axes(self.near())},E1 150.0}}",
                "ASYPTP {E1 150.0}",
                f"PTP {{{self._axes(self.near())},E1 0.0}}",
            ]
        )
        lines = self.inside(0.2, "IF $IN[6] THEN", [there], "ENDIF")
        return [*lines, *self.move(scope), *(self.joint(self.near()) if self.maybe(0.3) else []), *self.move(scope)]

    def computed(self, scope: _Scope) -> list[str]:
        name = self.pick(scope.points) if scope.points else self.point(self.target(scope), scope)
        x, y, z = self.small()
        move = self.pick(
            [f"LIN_REL {{Z {z:.1f}}}", f"PTP_REL {{A1 {z / 10:.1f}}}", f"LIN {name}:{{X {x:.1f},Y {y:.1f},Z {z:.1f},A 0,B 0,C 0}}",
             f"LIN_REL {{X {x:.1f},Z {z:.1f}}} #TOOL", f"LIN {{Z {self.rng.uniform(300, 500):.1f}}}", f"LIN {{FRAME: X {x:.1f}}}:{name}"]
        )  # fmt: skip
        return [move, *self.move(scope)]

    def changed(self, scope: _Scope) -> list[str]:
        name = self.pick(scope.points) if scope.points else self.point(self.target(scope), scope)
        line = self.pick([f"{name}.Z={name}.Z+20.0", f"{name}.X=400.0", f"{name}={{{self.target(scope)}}}", f"{name}=$POS_ACT",
                         f"{name}={{X 400.0}}"])  # fmt: skip
        lines = [line] if self.maybe(0.6) else ["IF $IN[8] THEN", "  " + line, "ENDIF"]
        return [*lines, f"LIN {name}"]

    def external(self, scope: _Scope) -> list[str]:
        return [
            "$IPO_MODE=#TCP",
            *self.move(scope),
            *(["$IPO_MODE=#BASE"] if self.maybe(0.7) else []),
            *self.move(scope),
        ]

    def unknown(self) -> list[str]:
        name = self.name()
        return [self.pick([f"{name}()", f"ok={name}(1)", f"{name} (1,TRUE)"])]

    def interrupt(self, scope: _Scope) -> list[str]:
        if not self.routines:
            return self.harmless()
        name = self.pick(self.routines)[0]
        return [f"INTERRUPT DECL 5 WHEN $IN[9]==TRUE DO {name}()", "INTERRUPT ON 5", *self.move(scope)]

    def jump(self, scope: _Scope) -> list[str]:
        self.count += 1
        label = f"again{self.count}"
        if scope.depth:
            return self.harmless()
        return [
            f"{label}:",
            *self.move(scope),
            *self.setting("tool", scope),
            "IF $IN[5] THEN",
            f"  GOTO {label}",
            "ENDIF",
        ]
