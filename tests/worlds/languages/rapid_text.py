"""Text of RAPID modules: tokens with line numbers, data and routines."""

from __future__ import annotations

import bisect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from tests.worlds.languages.execution import Branch, Do, Goto, Label, Loop, Place, Step, steps_of
from tests.worlds.languages.expressions import RAPID, NotUnderstood, Tokens, Tree
from tests.worlds.languages.machines import NOWHERE, Value


class Lined(Tokens):
    """Tokens with line numbers."""

    def __init__(self, items: list[tuple[str, str]], lines: list[int], name: str) -> None:
        super().__init__(items)
        self.lines, self.name = lines, name

    def here(self) -> int:
        """Line of the next token."""
        return self.lines[min(self.at, len(self.lines) - 1)]

    def span(self, begin: int) -> frozenset[Place]:
        """Lines of the tokens from `begin` to the last one consumed."""
        rows = self.lines[begin : max(self.at, begin + 1)]
        return frozenset((self.name, row) for row in range(rows[0], rows[-1] + 1)) if rows else NOWHERE


def lined(name: str, text: str) -> Lined:
    """Tokens of a module; a comment runs from ! to the end of its line."""
    text = re.sub(r"\r\n|\r", "\n", text)
    starts = [0, *(one.end() for one in re.finditer("\n", text))]
    items, lines, at = [], [], 0
    while at < len(text):
        if text[at] == "!":
            at = text.find("\n", at) if "\n" in text[at:] else len(text)
            continue
        if text[at] == "%":
            at += 1
            continue
        one = RAPID.token.match(text, at)
        if not one or one.end() == at:
            raise NotUnderstood(text[at : at + 20])
        if one.lastgroup:
            items.append((one.lastgroup, one[0].upper() if one.lastgroup == "name" else one[0]))
            lines.append(bisect.bisect_right(starts, at))
        at = one.end()
    return Lined(items, lines, name)


@dataclass
class _Routine:
    parameters: tuple[str, ...]
    steps: list[Step]


class Program:
    """The modules of a task: data and routines of all files."""

    def __init__(self, files: Mapping[str, str], main: str) -> None:
        self.routines: dict[str, _Routine] = {}
        self.written: dict[str, set[Place]] = {}
        self.data: list[tuple[str, Callable[[Any], Value]]] = []
        self.made: dict[int, dict[str, Value]] = {}
        """Data by world. Statements replace values and never modify them."""
        self.has_rail = any(re.search(r"(?i)MoveExtJ|\[[1-9]\d*,9E9", text) for text in files.values())
        for name, text in files.items():
            self._tokens = lined(name, text)
            self._module()
        self.main = "MAIN" if "MAIN" in self.routines else next(iter(self.routines))

    def _module(self) -> None:
        t = self._tokens
        while t.kind() != "over":
            word = t.peek()
            match word:
                case "MODULE":
                    t.take()
                    t.take()
                    if t.peek() == "(":
                        while t.take() != ")":
                            pass
                case "ENDMODULE" | "LOCAL" | "TASK" | ";":
                    t.take()
                case "CONST" | "PERS" | "VAR":
                    self.data += self._data()
                case "PROC" | "FUNC" | "TRAP":
                    self._routine(word)
                case _:
                    t.take()

    def _data(self) -> list[tuple[str, Callable[[Any], Value]]]:
        t, begin = self._tokens, self._tokens.at
        t.take()
        kind = t.take()
        made = []
        while True:
            name, size = t.take(), None
            if t.peek() == "{":
                while t.take() != "}":
                    pass
            if t.peek() == ":=":
                t.take()
                size = RAPID.tree(t)
            where = t.span(begin)
            made.append((name, self._valued(size, where, kind, name)))
            if t.take() == ";":
                return made

    @staticmethod
    def _valued(tree: Tree | None, where: frozenset[Place], kind: str, name: str) -> Callable[[Any], Value]:
        def value(machine: Any) -> Value:
            if tree is None:
                return machine.outside(name, kind), NOWHERE
            value, src = machine.evaluate(tree, where)
            return value, src | where

        return value

    def _routine(self, word: str) -> None:
        t = self._tokens
        t.take()
        if word == "FUNC":
            t.take()
        name, parameters = t.take(), []
        if t.peek() == "(":
            t.take()
            depth, last = 1, ""
            while depth:
                item = t.take()
                depth += {"(": 1, ")": -1}.get(item, 0)
                if item in (",", ")") and last and depth <= 1:
                    parameters.append(last)
                    last = ""
                elif item not in ("{", "}", "*", "\\"):
                    last = item
        nodes = self._block(("END" + word, "ERROR", "UNDO", "BACKWARD"))
        while t.take() != "END" + word:
            pass
        self.routines[name] = _Routine(tuple(parameters), steps_of(nodes))

    def _block(self, ends: tuple[str, ...]) -> list[Any]:
        t, nodes = self._tokens, []  # type: ignore[var-annotated]
        while t.peek() not in ends:
            if t.kind() == "over":
                raise NotUnderstood("a block has no end")
            if t.peek() == ";":
                t.take()
                continue
            nodes += self._statement()
        return nodes

    def _statement(self) -> list[Any]:
        t = self._tokens
        place, word, begin = (t.name, t.here()), t.peek(), t.at
        match word:
            case "IF":
                t.take()
                act = self._condition(begin)
                if t.peek() != "THEN":
                    return [Branch(place, [self._statement()], False, act)]
                bodies, otherwise = [], False
                while True:
                    if t.peek() == "THEN":
                        t.take()
                    bodies.append(self._block(("ELSEIF", "ELSE", "ENDIF")))
                    end = t.take()
                    if end == "ENDIF":
                        return [Branch(place, bodies, otherwise, act)]
                    if end == "ELSE":
                        otherwise = True
                    else:
                        self._condition(t.at)
            case "FOR" | "WHILE":
                while t.peek() not in ("DO", ""):
                    t.take()
                t.take("DO")
                body = self._block(("ENDFOR", "ENDWHILE"))
                t.take()
                return [Loop(place, body, at_least_once=t.items[begin + 1][1] == "TRUE")]
            case "TEST":
                t.take()
                act = self._condition(begin)
                bodies, otherwise = [], False
                while t.peek() != "ENDTEST":
                    otherwise |= t.take() == "DEFAULT"
                    while t.take() != ":":
                        pass
                    bodies.append(self._block(("CASE", "DEFAULT", "ENDTEST")))
                t.take()
                return [Branch(place, bodies, otherwise, act)]
            case "GOTO":
                t.take()
                return [Goto(place, (t.take(),), perhaps=False)]
            case "RETURN":
                t.take()
                tree = None if t.peek() == ";" else RAPID.tree(t)
                where = t.span(begin)
                return [Do(place, lambda m: m.evaluate(tree, where) if tree else None, ends=True)]
            case "VAR" | "CONST" | "PERS":
                made = self._data()
                return [Do(place, lambda m: [m.declare(name, value(m)) for name, value in made])]
        if t.kind() == "name" and t.peek(1) == ":":
            t.take()
            t.take()
            return [Label(word)]
        return [self._do(place, begin)]

    def _condition(self, begin: int) -> Callable[[Any], Any]:
        tree = RAPID.tree(self._tokens)
        where = self._tokens.span(begin)
        return lambda m: m.evaluate(tree, where)

    def _do(self, place: Place, begin: int) -> Do:
        t = self._tokens
        if t.peek() == "%":
            t.take()
        target = RAPID.tree(Tokens(t.items, t.at)) if t.kind(1) == "mark" and t.peek(1) in (":=", ".", "{") else None
        if target is not None:
            target = RAPID.tree(t)
            t.take(":=")
            value = RAPID.tree(t)
            where = t.span(begin)
            t.take(";")
            name = target
            while name[0] != "name":
                name = name[1]
            self.written.setdefault(name[1], set()).update(where)
            return Do(place, lambda m: m.assign(target, m.evaluate(value, where)))
        name = t.take()
        if t.peek() == "(" and t.peek(1) == ")":  # Otherwise an argument in brackets: Go (5);
            t.take()
            t.take()
        arguments = RAPID.items(t, ";")
        where = t.span(begin)
        return Do(place, lambda m: m.instruction(name, arguments, place, where))
