"""Interpreter of RAPID, written from ABB's technical reference: modules of data and routines.

Each move states its tool and work object. A program displacement lies between work object and target. With ConfL or
ConfJ off, the robot uses the solution nearest to the current angles; otherwise that of confdata: quadrants of axes 1, 4
and 6, and cfx for shoulder, elbow and wrist.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.worlds.languages.arms import Array, cell, chain, placed
from tests.worlds.languages.execution import Ended, Place, Ways, World, copied
from tests.worlds.languages.expressions import NotUnderstood, Tree, arithmetic
from tests.worlds.languages.frames import inverted, of_angles, of_quaternion, quaternion_of, shifted
from tests.worlds.languages.machines import NOWHERE, Value, ValueMachine
from tests.worlds.languages.rapid_text import Program

__all__ = ["Conf", "Machine", "Program", "confdata"]

_FIELDS = {
    "TRANS": 0, "ROT": 1, "ROBCONF": 2, "TFRAME": 1, "TLOAD": 2, "UFRAME": 3, "OFRAME": 4, "X": 0, "Y": 1, "Z": 2,
    "Q1": 0, "Q2": 1, "Q3": 2, "Q4": 3, "CF1": 0, "CF4": 1, "CF6": 2, "CFX": 3, "ROBAX": 0, "ROBHOLD": 0, "UFPROG": 1,
    "UFMEC": 2, "RAX_1": 0, "RAX_2": 1, "RAX_3": 2, "RAX_4": 3, "RAX_5": 4, "RAX_6": 5, "EAX_A": 0, "EAX_B": 1,
    "MASS": 0, "COG": 1,
}  # fmt: skip
_POINTS = {
    "MOVEJ": 1, "MOVEL": 1, "MOVEC": 2, "MOVEABSJ": 1, "MOVELDO": 1, "MOVEJDO": 1, "MOVECDO": 2, "MOVELSYNC": 1,
    "MOVEJSYNC": 1, "TRIGGL": 1, "TRIGGJ": 1, "TRIGGC": 2, "SEARCHL": 2, "MOVELAO": 1, "TRIGGLIOS": 1, "ARCL": 1,
    "ARCLSTART": 1, "ARCLEND": 1, "SPOTL": 1,
}  # fmt: skip
_WITHOUT_MOTION = """
SET RESET SETDO SETGO SETAO PULSEDO INVERTDO WAITTIME WAITDI WAITDO WAITUNTIL WAITGI WAITROB WAITAI WAITGO
TPWRITE TPERASE TPREADFK TPREADNUM TPSHOW ACCSET VELSET SINGAREA GRIPLOAD CLKSTART CLKSTOP CLKRESET INCR
DECR ADD CLEAR STOP EXIT BREAK EXITCYCLE ERRWRITE ERRLOG OPEN CLOSE WRITE WRITEBIN IDISABLE IENABLE
IDELETE ISLEEP IWATCH TRIGGIO TRIGGEQUIP TRIGGINT TRIGGSPEED CONFJ CONFL PDISPON PDISPOFF PDISPSET EOFFSON
EOFFSOFF EOFFSSET SOFTACT SOFTDEACT ACTUNIT DEACTUNIT CONNECT ISIGNALDI ISIGNALDO ITIMER WAITSYNCTASK
SPEEDREFRESH STOPMOVE STARTMOVE STOREPATH RESTOPATH CLEARPATH LOAD UNLOAD MOTIONSUP CIRPATHMODE PATHACCLIM
PATHRESOL WZDISABLE RETURN RAISE TRYNEXT RETRY BOOKERRNO UIMSGBOX SOCKETCREATE SOCKETCONNECT SOCKETSEND
SOCKETRECEIVE SOCKETCLOSE SOCKETBIND SOCKETLISTEN SOCKETACCEPT ACTEVENTBUFFER WORLDACCLIM
"""
_UNIT = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]]
_STILL = frozenset(_WITHOUT_MOTION.split())
"""Instructions without motion. Those that change something of a pose are handled before."""


class Machine(ValueMachine):
    """A controller that executes a task along one execution path."""

    dialect = "abb"

    def __init__(self, program: Program, world: World, ways: Ways) -> None:
        super().__init__(program, world, ways)
        if program.has_rail:
            self.robot.begin_on_rail()
        self.displaced = np.eye(4)
        self.conf = {"CONFJ": True, "CONFL": True}
        self.traps: dict[str, str] = {}
        self.scopes[0]["TOOL0"] = ([True, _UNIT, []], NOWHERE)
        self.scopes[0]["WOBJ0"] = ([False, True, "", _UNIT, _UNIT], NOWHERE)
        if world.seed in program.made:
            self.scopes[0] |= program.made[world.seed]
            return
        for name, value in program.data:
            self.scopes[0][name] = copied(value(self))
        if not ways.taken:
            program.made[world.seed] = dict(self.scopes[0])

    def run(self) -> None:
        """Execute the program from main."""
        self.call(self.program.main, [])

    def call(self, name: str, values: list[tuple[str, Value]]) -> Value:
        scope = {}
        plain = iter([value for key, value in values if not key])
        keyed = {key: value for key, value in values if key}
        for parameter in self.program.routines[name].parameters:
            scope[parameter] = keyed.get(parameter) or next(plain, (self.world.number(parameter), NOWHERE))
        return self.run_routine(name, copied(scope))

    def declare(self, name: str, value: Value) -> None:
        """Create a variable of the routine."""
        self.scopes[-1][name] = copied(value)

    def assign(self, target: Tree, value: Value) -> None:
        """Assign to data or a component."""
        path, tree = [], target
        while tree[0] != "name":
            path.append(self._step(tree))
            tree = tree[1]
        name = tree[1]
        scope = next((s for s in (self.scopes[-1], self.scopes[0]) if name in s), self.scopes[0])
        if not path:
            before = scope.get(name, value)[1]
            scope[name] = (copied(value[0]), value[1] | before)
            return
        old, src = scope.get(name) or (self.outside(name, ""), NOWHERE)
        part = new = copied(old)
        for step in reversed(path[1:]):
            part = part[step]
        part[path[0]] = copied(value[0])
        scope[name] = (new, src | value[1])

    def _step(self, tree: Tree) -> int:
        if tree[0] == "field":
            return _FIELDS.get(tree[2], 0)
        return max(int(self.evaluate(tree[2], NOWHERE)[0]) - 1, 0)

    def outside(self, name: str, kind: str) -> Any:
        """Return data that the program lacks: in another module, taught, or stated by the user."""
        low = name.lower()
        kind = kind or {"T": "TOOLDATA", "W": "WOBJDATA"}.get(name[0], "")
        for key, wanted in (("tool", "TOOLDATA"), ("frame", "WOBJDATA")):
            stated = self.world.stated.get((key, low))
            if stated is None and kind == wanted:
                stated = self.world.shift(name)
            if stated is not None:
                pose = _pose_of(stated)
                return [True, pose, []] if key == "tool" else [False, True, "", pose, _UNIT]
        if kind == "POSE":
            return _pose_of(self.world.shift(name))
        if kind == "ROBTARGET":
            return self._target(self.robot.pose_now(np.eye(4)))
        return self.world.number(name)

    def read(self, name: str) -> Value:
        if stored := self.stored(name, [self.scopes[-1], self.scopes[0]]):
            return stored
        if name in ("TRUE", "FALSE"):
            return name == "TRUE", NOWHERE
        return self.outside(name, "ROBTARGET" if re.match(r"P\d", name) else ""), NOWHERE

    @staticmethod
    def _target(T: Array) -> Any:
        return [*_pose_of(T), [0.0, 0.0, 0.0, 0.0], [9e9] * 6]

    def binary(self, operator: str, a: Any, b: Any) -> Any:
        if isinstance(a, list) and isinstance(b, list) and operator in "+-":
            return [x + (y if operator == "+" else -y) for x, y in zip(a, b, strict=False)]
        return False if isinstance(a, bool) else arithmetic(operator, a, b)

    def evaluate_own(self, tree: Tree, where: frozenset[Place]) -> Value:
        match tree:
            case ("list", items):
                values = [self.evaluate(one, where) for one in items]
                return [value for value, _ in values], where.union(*(src for _, src in values))
            case ("index", one, _) | ("field", one, _):
                value, src = self.evaluate(one, where)
                if tree[0] == "field" and tree[2] == "EXTAX":
                    return value[-1], src
                k = self._step(tree)
                return (value[k] if isinstance(value, list) and k < len(value) else self.world.number(str(tree))), src
            case ("call", name, arguments):
                if name == "STRTOVAL":  # which changes its argument
                    self.assign(arguments[1][1], (self.world.number(name, 20, 90), NOWHERE))
                    return True, NOWHERE
                return self._function(name, [(key, self.evaluate(one, where)) for key, one in arguments])
        raise NotUnderstood(str(tree))

    def _function(self, name: str, values: list[tuple[str, Value]]) -> Value:
        if name in self.program.routines:
            return self.call(name, values)
        plain = [value[0] for key, value in values if not key]
        keyed = {key: value[0] for key, value in values if key}
        src = NOWHERE.union(*(value[1] for _, value in values))
        match name:
            case "OFFS":
                new = copied(plain[0])
                new[0] = [a + b for a, b in zip(new[0], plain[1:4], strict=False)]
                return new, src
            case "RELTOOL":
                new = copied(plain[0])
                turns = [keyed.get(key, 0.0) for key in ("RX", "RY", "RZ")]
                new[:2] = _pose_of(_frame(new) @ of_angles(*plain[1:4], *turns))
                return new, src
            case "CROBT":
                tool, wobj = keyed.get("TOOL", self.read("TOOL0")[0]), keyed.get("WOBJ", self.read("WOBJ0")[0])
                X = inverted(_wobj(wobj)) @ self.robot.pose_now(_frame(tool[1]))
                return self._target(X), src
            case "CJOINTT":
                return [np.degrees(self.robot.q).tolist(), [9e9] * 6], src
            case "CALCJOINTT":
                F = _wobj(keyed.get("WOBJ", self.read("WOBJ0")[0])) @ _frame(plain[0]) @ inverted(_frame(plain[1][1]))
                q = self.robot.solve(F, self.robot.q)
                if q is None:
                    raise Ended
                return [np.degrees(q).tolist(), [9e9] * 6], src
            case "ORIENTZYX":
                z, y, x = plain[:3]
                return quaternion_of(of_angles(0.0, 0.0, 0.0, x, y, z)), src
            case "POSEMULT":
                return _pose_of(_frame(plain[0]) @ _frame(plain[1])), src
            case "POSEINV":
                return _pose_of(inverted(_frame(plain[0]))), src
            case "CTOOL":
                return self.read("TOOL0")[0], src
            case "DEFFRAME" | "DEFACCFRAME" | "ORIENT":
                return _pose_of(self.world.shift(name)), src
        return self.world.number(name), src

    def instruction(self, name: str, arguments: list[tuple[str, Tree]], place: Place, where: frozenset[Place]) -> None:
        if name not in self.program.routines and name in ("CONNECT", "ISIGNALDI", "ITIMER"):
            self._interrupts(name, arguments)
            return
        switches = {key for key, one in arguments if key and one == ("name", key)}
        values = [(key, self.evaluate(one, where)) for key, one in arguments if key not in switches]
        if name in self.program.routines:
            self.call(name, values)
            return
        keyed, plain = {key: value for key, value in values if key}, [value for key, value in values if not key]
        if name in _POINTS:
            if (trap := self.interruption()) is not None:
                self.call(trap, [])
            self._move(name, plain, keyed, place, where)
        elif name in ("CONFJ", "CONFL"):
            self.conf[name] = "OFF" not in switches
        elif name.startswith("PDISP"):
            self._displace(name, plain, keyed, switches)
        elif name == "MOVEEXTJ":
            self._external(plain[0][0][1])
        elif name.startswith("EOFFS") or name in _STILL:
            if name == "EXIT":
                raise Ended
        else:
            self.unknown(name)

    def _interrupts(self, name: str, arguments: list[tuple[str, Tree]]) -> None:
        if name != "CONNECT":
            self.armed += [trap for trap in self.traps.values() if trap not in self.armed]
            return
        self.traps["ANY"] = next((one[1] for _, one in arguments if one[1] in self.program.routines), "")

    def _displace(self, name: str, plain: list[Value], keyed: dict[str, Value], switches: set[str]) -> None:
        if name == "PDISPOFF":
            self.displaced = np.eye(4)
        elif name == "PDISPSET":
            self.displaced = _frame(plain[0][0])
        else:
            tool, wobj = plain[1][0], keyed.get("WOBJ", self.read("WOBJ0"))[0]
            there = _frame(plain[0][0])
            now = inverted(_wobj(wobj)) @ self.robot.pose_now(_frame(tool[1]))
            here = _frame(keyed["EXEP"][0]) if "EXEP" in keyed else now
            if "ROT" in switches:
                self.displaced = here @ inverted(there)
            else:
                self.displaced = placed(here[:3, 3] - there[:3, 3], np.eye(3))

    def _move(
        self, name: str, plain: list[Value], keyed: dict[str, Value], place: Place, where: frozenset[Place]
    ) -> None:
        count = _POINTS[name]
        if name == "SEARCHL":
            plain, count = plain[2:], 1
        tools = [
            value for value, _ in plain[count:] if isinstance(value, list) and len(value) == 3 and len(value[1]) == 2
        ]
        if not tools:
            raise Ended
        tool, wobj = tools[0], keyed.get("WOBJ", self.read("WOBJ0"))[0]
        for value, src in plain[:count]:
            sources = src | where
            if not isinstance(value, list):
                raise Ended
            if len(value) == 2:
                self._external(value[1])
                self.robot.joints(np.radians(value[0]), _frame(tool[1]), place, sources)
                continue
            X = self.displaced @ _frame(value)
            if tool[0] is True:
                F = _wobj(wobj) @ X @ inverted(_frame(tool[1]))
                point = np.array(tool[1][0], dtype=float)
            else:
                F = _frame(tool[1]) @ inverted(_wobj(wobj) @ X)
                point = (inverted(F) @ _frame(tool[1]))[:3, 3]
            self._external(value[3] if len(value) > 3 else [])
            F = shifted(F, -self.robot.rail_mm)
            configured = self.conf["CONFJ" if name.startswith(("MOVEJ", "TRIGGJ")) else "CONFL"]
            chosen = Conf(*value[2][:4]) if configured else None
            self.robot.pose(F, point, place, sources, chosen, straight="J" not in name[4:6])
            if name == "SEARCHL":
                self.robot.q = self.robot.q + np.radians(self.world.number("search", -3, 3))

    def _external(self, axes: list[float]) -> None:
        """Move the track to the first external axis; 9E9 leaves it unchanged."""
        if axes and abs(axes[0]) < 9e8:
            self.robot.rail_mm = float(axes[0])

    def changed_by(self, name: str) -> None:
        self.displaced = self.displaced @ self.world.shift(name)
        self.conf["CONFL"] = False


@dataclass(frozen=True)
class Conf:
    """Test of joint angles (6,) rad against confdata."""

    cf1: float
    cf4: float
    cf6: float
    cfx: float

    def __call__(self, q: Array) -> bool:
        return confdata(q) == [self.cf1, self.cf4, self.cf6, self.cfx]


def confdata(q: Array) -> list[float]:
    """Quadrants of axes 1, 4 and 6, and cfx of an IRB 120, whose arm is stretched at -77 degrees of axis
    3.
    """
    here = cell("abb")
    wrist = chain(here, q)[0]
    centre = wrist[:3, 3] - here.nominal.d[5] * wrist[:3, 2]
    front = centre[0] * np.cos(q[0]) + centre[1] * np.sin(q[0]) > 0
    cfx = 4 * (not front) + 2 * (np.degrees(q[2]) < -77) + int(q[4] < 0)
    return [float(np.floor(np.degrees(q[k]) / 90)) for k in (0, 3, 5)] + [float(cfx)]


def _frame(pose: Any) -> Array:
    """Frame (4, 4) of a pose or robtarget."""
    try:
        return of_quaternion(*map(float, pose[0]), *map(float, pose[1]))
    except (TypeError, ValueError, IndexError):
        raise Ended from None


def _wobj(wobj: Any) -> Array:
    if not isinstance(wobj, list):
        raise Ended
    return _frame(wobj[3]) @ _frame(wobj[4])


def _pose_of(T: Array) -> list[list[float]]:
    return [T[:3, 3].tolist(), quaternion_of(T)]
