"""Abstract interpretation of programs: the tool, frame and displacement that are certain at each move.

The machine joins branches, runs loops to a fixed point and follows calls. A variable of the state has a value, or is
unknown because of a line. `ForgetAll` stands for a statement outside the closed list of a dialect. Concurrent code may
run at any moment: what it certainly can change is unknown everywhere, all else only in the programs that start it.
"""

from __future__ import annotations

import heapq
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from analysis.correction.reasons import Reason

OFF = "off"
BEGIN = "\0begin"
EXTERNAL = "external"
"""The family of the variables for external axes: off at zero."""
_MOST_STATES = 64
"""States in which a routine is analysed; further ones count as unknown. Chosen: real programs call a routine with a few
tools and frames."""
_DEEPEST = 60
"""Depth of nested calls; the state of deeper ones is unknown. Controllers allow fewer (some about 20)."""


@dataclass(frozen=True, order=True)
class Unknown:
    """An unknown value, with the place in the program and a reason that completes "line n: …"."""

    file: int
    line: int
    why: str
    everything: bool = False
    """True if the complete state is unknown there, rather than only this variable."""


@dataclass(frozen=True)
class Ref:
    variable: str


_KEPT = Unknown(0, 0, "a routine of these files sets the value for the next cycle")
Value = str | tuple[float, ...] | Unknown
"""A name, the 16 numbers of a frame in mm, or unknown."""


@dataclass(frozen=True)
class ComputedValue:
    variables: tuple[str, ...]
    make: Callable[[tuple[Value, ...]], Value]


Setting = Value | Ref | ComputedValue
Needs = tuple[tuple[Reason, Setting], ...]
"""Settings that must be off at a move, each with the reason for leaving its target if it is not."""


@dataclass(frozen=True)
class Set:
    variable: str
    value: Setting


@dataclass(frozen=True)
class ForgetFamily:
    """All variables of a family, "UFRAME" of "UFRAME[3]", become unknown."""

    family: str
    why: Unknown


@dataclass(frozen=True)
class ForgetAll:
    why: Unknown
    missing: str = ""
    """Called routine without text or unknown instruction, which the user can state as neutral."""


@dataclass(frozen=True)
class Call:
    name: str
    why: Unknown
    """Reason for an unknown state if the routine has no text."""
    starter: str = ""
    """For concurrent code, the routine that starts it; empty if the controller starts it."""


@dataclass(frozen=True)
class Elsewhere:
    """A move of the arm to a position outside the targets of the program."""

    relative: Unknown | None = None
    """Place and text of a relative move in another file, which starts at the position of the arm."""


@dataclass(frozen=True)
class JumpTarget:
    name: str


@dataclass(frozen=True)
class Jump:
    """A jump to any of the labels, or to the next statement if it `falls` through."""

    labels: tuple[str, ...]
    falls: bool = False


@dataclass(frozen=True)
class End:
    """A return from the routine, or the end of the program if it `halts`."""

    halts: bool = False


@dataclass(frozen=True)
class Move:
    key: str
    way: str
    file: int
    line: int
    tool: Setting = ""
    frame: Setting = ""
    needs: Needs = ()
    trusts: Setting = "on"
    """"on" if configuration flags are valid, "checked" if the path has to lead to the same configuration, or off."""
    near: tuple[float, ...] | None = None
    offset: tuple[str, Value | ComputedValue] | None = None
    """The kind, "frame" or "tool", and the 16 numbers of a frame in mm, or unknown."""
    base: str = ""
    """The key of the point itself, if `key` belongs to a point with an offset."""
    arc: str = ""
    tangent: bool = False
    """True if the arc rotates the tool with the tangent: the arm then does not reach any written orientation."""
    through: bool = False


Statement = Set | ForgetFamily | ForgetAll | Call | Elsewhere | JumpTarget | Jump | End | Move


@dataclass(frozen=True)
class Program:
    routines: Mapping[str, tuple[Statement, ...]]
    initial: Callable[[str], Value]
    beside: tuple[Call, ...] = ()
    broken: tuple[Call, ...] = ()
    """Routines that may end at any statement, after which the program continues anywhere."""
    kept: tuple[str, ...] = ()
    """Prefixes of variables that keep the value set by any routine, even by one that is not called: it may have been
    started by hand or by an event."""
    cycles: bool = False
    """True if the program restarts at the end with all variables unchanged."""
    starts: str | None = None
    """The routine with which the operator starts the program, if certain."""


@dataclass(frozen=True)
class Usage:
    move: Move
    tool: Value
    frame: Value
    needs: tuple[tuple[Reason, Value], ...]
    trusts: Value
    offset: tuple[str, Value] | None
    comes_from: frozenset[str | None]
    """Keys of the points from which the arm comes; None for an unknown position."""


@dataclass(frozen=True)
class MachineState:
    values: Mapping[str, Value] = field(default_factory=dict)
    lost: Mapping[str, Unknown] = field(default_factory=dict)
    """Families whose variables are unknown unless set later; "" stands for all families."""
    stands: frozenset[object] = frozenset()

    def key(self) -> tuple[frozenset[object], frozenset[object]]:
        """Identity of the state, apart from the position of the arm."""
        return frozenset(self.values.items()), frozenset(self.lost.items())


@dataclass
class _Context:
    """A routine analysed from a state: the states before its statements, and the positions of the arm at its calls."""

    number: int
    routine: str
    entry: MachineState
    before: dict[int, MachineState] = field(default_factory=dict)
    after: MachineState | None = None
    called_from: set[object] = field(default_factory=set)


def called_routines(bodies: Iterable[Iterable[Statement]]) -> set[str]:
    return {statement.name for body in bodies for statement in body if isinstance(statement, Call)}


class _Machine:
    def __init__(self, program: Program) -> None:
        self.program = program
        self.contexts: list[_Context] = []
        self.by_key: dict[object, _Context] = {}
        self.count = Counter[str]()
        self.later: dict[str, Unknown] = {}
        self.active: list[str] = []
        self.halted: list[MachineState] = []
        """The states in which the program ends inside a routine."""
        self.flow = {name: _successors(body) for name, body in program.routines.items()}
        concurrent = (*program.beside, *program.broken)
        self.pinned = self._concurrent_changes(concurrent)[0]
        self.programs = programs_of(program.routines, {call.name for call in concurrent}) if concurrent else {}
        self.effects: dict[tuple[Call, ...], tuple[Unknown | None, bool]] = {(): (None, False)}
        """For concurrent calls: the cause if they may change everything, and True if they may move the arm."""
        self.unknown_in = {name: self._unknown_by_others(name, concurrent) for name in program.routines}

    def _unknown_by_others(self, routine: str, concurrent: Sequence[Call]) -> tuple[Unknown | None, bool]:
        """Cause if concurrent routines may change everything in a routine, and True if they may move the arm."""
        programs = self.programs.get(routine, set())
        acting = tuple(
            call for call in concurrent if not call.starter or programs & self.programs.get(call.starter, set())
        )
        if acting not in self.effects:
            self.effects[acting] = self._concurrent_changes(acting)[1:]
        return self.effects[acting]

    def _concurrent_changes(self, concurrent: Iterable[Call]) -> tuple[dict[str, Unknown], Unknown | None, bool]:
        """What concurrent routines may change: variables, the cause if all, and whether they may move the arm."""
        pinned: dict[str, Unknown] = {}
        everything: Unknown | None = None
        moved, seen = False, set()
        todo = [*concurrent]
        while todo:
            call = todo.pop()
            body = self.program.routines.get(call.name)
            if body is None:
                everything, moved = min(everything or call.why, call.why), True
            elif call.name not in seen:
                seen.add(call.name)
                for statement in body:
                    match statement:
                        case Set(name) | ForgetFamily(name):
                            pinned.setdefault(name, call.why)
                        case ForgetAll(why):
                            everything, moved = min(everything or why, why), True
                        case Call():
                            todo.append(statement)
                        case Move() | Elsewhere():
                            moved = True
        return pinned, everything, moved

    def value(self, state: MachineState, variable: str) -> Value:
        everything, _ = self.unknown_in[self.active[-1]] if self.active else (None, False)
        if everything:
            return replace(everything, everything=True)
        if pinned := self.pinned.get(variable) or self.pinned.get(family_of(variable)):
            return pinned
        if variable in state.values:
            return state.values[variable]
        if lost := state.lost.get(family_of(variable)):
            return lost
        if lost := state.lost.get(""):
            return replace(lost, everything=True)
        return self.program.initial(variable)

    def resolved(self, state: MachineState, value: Setting) -> Value:
        if isinstance(value, ComputedValue):
            return value.make(tuple(self.value(state, variable) for variable in value.variables))
        return self.value(state, value.variable) if isinstance(value, Ref) else value

    def join(self, first: MachineState, second: MachineState, place: Unknown) -> MachineState:
        if first is second:
            return first
        values: dict[str, Value] = {}
        for variable in first.values.keys() | second.values.keys():
            both = self.value(first, variable), self.value(second, variable)
            unknown = [value for value in both if isinstance(value, Unknown)]
            values[variable] = both[0] if both[0] == both[1] else min(unknown, default=place)
        lost = dict(first.lost)
        for name, why in second.lost.items():
            lost[name] = min(lost.get(name, why), why)
        return MachineState(values, lost, first.stands | second.stands)

    def context(self, routine: str, entry: MachineState) -> _Context:
        key = (routine, entry.key())
        if context := self.by_key.get(key):
            context.called_from |= entry.stands
            return context
        self.count[routine] += 1
        context = _Context(len(self.contexts), routine, entry, called_from=set(entry.stands))
        self.contexts.append(context)
        self.by_key[key] = context
        self.active.append(routine)
        self._through(context)
        self.active.pop()
        return context

    def _through(self, context: _Context) -> None:
        """Analyse a routine until the state before every statement is stable."""
        body, flow = self.program.routines[context.routine], self.flow[context.routine]
        context.before[0] = replace(context.entry, stands=frozenset({context.number}))
        todo = [0]
        waiting = {0}
        while todo:
            at = heapq.heappop(todo)
            waiting.discard(at)
            if at >= len(body):
                continue
            after = self._step(body[at], context.before[at])
            if after is None:
                continue
            for following in flow[at]:
                old = context.before.get(following)
                new = after if old is None else self.join(old, after, _place_of(body, following))
                if old is None or new != old:
                    context.before[following] = new
                    if following not in waiting:
                        waiting.add(following)
                        heapq.heappush(todo, following)
        context.after = context.before.get(len(body))

    def _step(self, statement: Statement, state: MachineState) -> MachineState | None:
        match statement:
            case Set(variable, value):
                return replace(state, values={**state.values, variable: self.resolved(state, value)})
            case ForgetFamily(family, why):
                kept = {variable: value for variable, value in state.values.items() if family_of(variable) != family}
                return MachineState(kept, {**state.lost, family: why}, state.stands)
            case Elsewhere() | Move():
                key = statement.key if isinstance(statement, Move) else None
                return replace(state, stands=frozenset({key}))
            case Call(name, why) if name in self.program.routines:
                return self._state_after_call(name, why, state)
            case ForgetAll(why) | Call(why=why):
                return _unknown_state(why)
            case End(halts=True):
                self.halted.append(state)
        return state

    def _state_after_call(self, name: str, why: Unknown, state: MachineState) -> MachineState | None:
        if self.count[name] >= _MOST_STATES or len(self.active) >= _DEEPEST or name in self.active:
            how = "again while it runs" if name in self.active else "in too many different ways"
            why = replace(why, why=f"{why.why} {how}")
            self.later.setdefault(name, why)
            return _unknown_state(why)
        context = self.context(name, state)
        if context.after is None:
            return None
        stands = context.after.stands
        if context.number in stands:
            stands = (stands - {context.number}) | state.stands
        return replace(context.after, stands=stands)

    def run(self) -> list[Usage]:
        called: dict[str, Unknown] = {}
        # The controller keeps values set by a routine, so the initial state is uncertain.
        variables: dict[str, Value] = {}
        families: dict[str, Unknown] = {}
        kept, initial = self.program.kept, self.program.initial
        for statement in (statement for body in self.program.routines.values() for statement in body):
            match statement:
                case Call(name, why):
                    called[name] = why
                case Set(variable, value) if variable.startswith(kept) and value != initial(variable):
                    variables[variable] = value if isinstance(value, Unknown) else _KEPT
                case ForgetFamily(family, why) if f"{family}[".startswith(kept):
                    families[family] = why
        beside = {call.name: call.why for call in self.program.beside}
        begins = [name for name in self.program.routines if name not in called and name not in beside]
        begin = MachineState(variables, families, frozenset({None}))
        # If all routines call each other, the first is the start.
        for name in begins or list(self.program.routines)[:1]:
            self._cycle(name, replace(begin, stands=frozenset({BEGIN})) if name == self.program.starts else begin)
        self.later |= {name: why for name, why in beside.items() if name in self.program.routines}
        self._in_any_state()
        reached = {context.routine for context in self.contexts}
        for name in self.program.routines.keys() - reached:  # Cycles of routines that call only each other
            self.later[name] = called[name]
        self._in_any_state()
        return self._usages()

    def _cycle(self, name: str, begin: MachineState) -> None:
        """Analyse a start routine. If the program cycles, repeat with the final state until the state is stable."""
        while True:
            self.halted.clear()
            context = self.context(name, begin)
            if not self.program.cycles:
                return
            again = begin
            for end in ([context.after] if context.after else []) + self.halted:
                context.called_from |= end.stands
                again = self.join(again, replace(end, stands=begin.stands), _KEPT)
            if again.key() == begin.key():
                return
            begin = again

    def _in_any_state(self) -> None:
        done: set[str] = set()
        while todo := sorted(self.later.keys() - done):
            done.update(todo)
            for name in todo:
                self.context(name, _unknown_state(self.later[name]))

    def _usages(self) -> list[Usage]:
        # For each context: the points at which the arm may be when it starts.
        stands: list[set[str | None]] = [set() for _ in self.contexts]
        changed = True
        while changed:
            changed = False
            for context in self.contexts:
                points = stands[context.number]
                before = len(points)
                points |= _resolved(stands, context.called_from)
                changed |= len(points) > before
        usages: dict[object, Usage] = {}
        for context in self.contexts:
            body = self.program.routines[context.routine]
            self.active = [context.routine]
            _, moved = self.unknown_in[context.routine]
            for at, state in sorted(context.before.items()):
                if at < len(body) and isinstance(move := body[at], Move):
                    comes_from = _resolved(stands, state.stands)
                    usage = Usage(
                        move,
                        self.resolved(state, move.tool),
                        self.resolved(state, move.frame),
                        tuple((reason, self.resolved(state, setting)) for reason, setting in move.needs),
                        self.resolved(state, move.trusts),
                        (move.offset[0], self.resolved(state, move.offset[1])) if move.offset else None,
                        comes_from | {None} if moved else comes_from,
                    )
                    key = (id(move), usage.tool, usage.frame, usage.needs, usage.trusts, usage.offset)
                    old = usages.get(key)
                    usages[key] = usage if old is None else replace(old, comes_from=old.comes_from | usage.comes_from)
        return list(usages.values())


def programs_of(routines: Mapping[str, tuple[Statement, ...]], concurrent: Iterable[str]) -> dict[str, set[str]]:
    """The programs to which each routine belongs, by their start: a routine that no other calls."""
    called = called_routines(routines.values()) | {*concurrent}
    programs: dict[str, set[str]] = {}
    starts = [name for name in routines if name not in called]
    for start in starts:
        for name in reachable(routines, [start]):
            programs.setdefault(name, set()).add(start)
    for name in routines.keys() - programs.keys():  # Concurrent routines, and routines that only call each other
        programs[name] = {*routines}
    return programs


def _unknown_state(why: Unknown) -> MachineState:
    return MachineState({}, {"": why}, frozenset({None}))


def _resolved(stands: list[set[str | None]], places: Iterable[object]) -> frozenset[str | None]:
    """Points at which the arm may be. A context stands for the position at the start of its routine."""
    points: set[str | None] = set()
    for place in places:
        points |= stands[place] if isinstance(place, int) else {place if isinstance(place, str) else None}
    return frozenset(points)


def usages_of(program: Program) -> list[Usage]:
    return _Machine(program).run()


def family_of(variable: str) -> str:
    return variable.partition("[")[0]


def _place_of(body: tuple[Statement, ...], at: int) -> Unknown:
    """Reason for different values on joining paths, located at the next move or call."""
    fact = "the value differs between the paths leading here"
    for place in range(at, len(body)):  # A slice would copy a long routine at each join.
        statement = body[place]
        if isinstance(statement, Move | Call):
            where = statement if isinstance(statement, Move) else statement.why
            return Unknown(where.file, where.line, fact)
    return Unknown(0, 0, fact)


def _successors(body: tuple[Statement, ...]) -> list[tuple[int, ...]]:
    """Successors of each statement; the length of the body is the return.

    A jump to a missing label ends the program.
    """
    places = {statement.name: at for at, statement in enumerate(body) if isinstance(statement, JumpTarget)}
    flow: list[tuple[int, ...]] = []
    for at, statement in enumerate(body):
        match statement:
            case Jump(labels, falls):
                targets = {places[name] for name in labels if name in places} | ({at + 1} if falls else set())
                flow.append(tuple(sorted(targets)))
            case End(halts):
                flow.append(() if halts else (len(body),))
            case _:
                flow.append((at + 1,))
    return flow


def reachable(routines: Mapping[str, tuple[Statement, ...]], first: Iterable[str]) -> list[str]:
    """Names of the routines that run, directly or indirectly, with those named `first`."""
    todo, found = list(first), dict[str, None]()
    while todo:
        name = todo.pop()
        if name in routines and name not in found:
            found[name] = None
            todo += [statement.name for statement in routines[name] if isinstance(statement, Call)]
    return list(found)


class Blocks:
    """Statements of a routine during parsing, with blocks translated to jumps, whatever their conditions."""

    def __init__(self) -> None:
        self.body: list[Statement] = []
        self.open: list[tuple[str, str, str]] = []
        """Kind of each open block, and its two labels: the next branch, or the head of a loop; and the end."""
        self._labels = 0

    def add(self, *statements: Statement) -> None:
        self.body += statements

    def keyword(self, role: str, condition: Callable[[], None] = lambda: None) -> None:
        """Translate a keyword of flow control. `condition` adds the calls in its condition."""
        self.before_condition(role)
        condition()
        self.after_condition(role)

    def before_condition(self, role: str) -> None:
        match role:
            case "case" | "else" if self._in_branch():
                _, branch, end = self.open[-1]
                self.open[-1] = ("branch", self._label(), end)
                self.add(Jump((end,)), JumpTarget(branch))
            case "loop" | "while":
                self._begin("loop")
                self.add(JumpTarget(self.open[-1][1]))
            case "break":
                self.add(Jump((self._innermost_loop(2),)))
            case "continue":
                self.add(Jump((self._innermost_loop(1),)))

    def after_condition(self, role: str) -> None:
        match role:
            case "if" | "switch":  # Without a default case, all cases may be skipped.
                self._begin("branch")
                self.add(Jump((self.open[-1][1],), falls=role == "if"))
            case "case" if self._in_branch():
                self.add(Jump((self.open[-1][1],), falls=True))
            case "while" | "until":
                self.add(Jump((self._innermost_loop(2),), falls=True))
        match role:
            case "until" | "end":
                self.close()
            case "return":
                self.add(End())

    def close(self) -> None:
        if self.open:
            kind, first, end = self.open.pop()
            self.add(Jump((first,)) if kind == "loop" else JumpTarget(first), JumpTarget(end))

    def add_conditional(self, *statements: Statement) -> None:
        self.keyword("if")
        self.add(*statements)
        self.close()

    def add_one_of(self, statements: Sequence[Statement]) -> None:
        for statement in statements[:-1]:
            self.keyword("if")
            self.add(statement)
            self.keyword("else")
        self.add(*statements[-1:])
        for _ in statements[:-1]:
            self.close()

    def evaluated(self, before: str, call: Statement) -> None:
        """Add a call in an expression after the text `before`. No manual guarantees that both sides of `and` or `or`
        are evaluated."""
        (self.add_conditional if re.search(r"\b(?:and|or)\b", before, re.IGNORECASE) else self.add)(call)

    def finish_routine(self) -> tuple[Statement, ...]:
        while self.open:
            self.close()
        return tuple(self.body)

    def _begin(self, kind: str) -> None:
        self.open.append((kind, self._label(), self._label()))

    def _label(self) -> str:
        self._labels += 1
        return f"\0{self._labels}"

    def _in_branch(self) -> bool:
        return bool(self.open) and self.open[-1][0] == "branch"

    def _innermost_loop(self, which: int) -> str:
        return next((block[which] for block in reversed(self.open) if block[0] == "loop"), "")
