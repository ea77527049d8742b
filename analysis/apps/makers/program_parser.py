"""Base of the parsers of all languages: they add statements of the abstract machine for those of the language.

Nothing is certain after a statement that is `not_known`.
"""

from __future__ import annotations

import re
import string
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping

from analysis.apps.makers.points import Points
from analysis.apps.makers.program_machine import (
    Blocks,
    Call,
    ComputedValue,
    Elsewhere,
    ForgetAll,
    ForgetFamily,
    Program,
    Ref,
    Set,
    Statement,
    Unknown,
    Value,
)
from analysis.apps.makers.target import NEUTRAL, Number, ProgramTexts, UncorrectedTarget
from analysis.correction.reasons import Reason

NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
UPPER_CASE = str.maketrans(string.ascii_lowercase, string.ascii_uppercase)
LOWER_CASE = str.maketrans(string.ascii_uppercase, string.ascii_lowercase)
_NUMBER = re.compile(NUMBER)
_MARK = "\xef\xbb\xbf"
_LONGEST_FACT, _LONGEST_NAME = 80, 60


class ProgramParser:
    """A program during parsing, at the position `at` in the text `file`."""

    def __init__(self, program: ProgramTexts, blank: re.Pattern[str], case: Mapping[int, int] | None = None) -> None:
        """blank: comments and quotes, which become spaces. case: translation of letters, if case does not matter."""
        self.names, self.own = program.names, program.own
        self.neutral = frozenset(name.upper() for name in program.neutral)
        self._written = tuple(_blanked(text, blank) for text in program.texts)
        self.texts = tuple(text.translate(case or {}) for text in self._written)
        self._line_ends = [[match.start() for match in re.finditer("\n", text)] for text in self.texts]
        self.points = Points(program.own)
        self.file = self.at = 0
        self.blocks = Blocks()
        self.routine: str | None = None
        self.around: list[tuple[str | None, Blocks]] = []
        self.routines: dict[str, tuple[Statement, ...]] = {}
        self.defined: dict[str, list[str]] = {}
        """The routines that a name may mean, by scope."""
        self.beside: list[Call] = []
        self.broken: list[Call] = []
        self.spent: set[tuple[int, int]] = set()
        """Names of points, by file and position, that a statement uses without changing the point."""

    @property
    def is_own(self) -> bool:
        """True if the targets of the current text are corrected."""
        return self.file < self.own

    def lines(self, file: int) -> Iterator[str]:
        self.file, at = file, 0
        for line in self.texts[file].split("\n"):
            self.at = at
            yield line
            at += len(line) + 1

    def line(self, at: int | None = None) -> int:
        return bisect_left(self._line_ends[self.file], self.at if at is None else at) + 1

    def why(self, fact: str, at: int | None = None) -> Unknown:
        return Unknown(self.file, self.line(at), " ".join(fact.split())[:_LONGEST_FACT])

    def add(self, *statements: Statement) -> None:
        self.blocks.add(*statements)

    def set(self, variable: str, value: Value | Ref | ComputedValue) -> None:
        self.add(Set(variable, value))

    def forget(self, family: str, why: Unknown) -> None:
        self.add(ForgetFamily(family, why))

    def not_known(self, text: str, at: int | None = None, *, may_be_neutral: bool = False) -> None:
        """Make everything unknown. may_be_neutral: if the dialect looks the text up in `neutral`."""
        stated = text if may_be_neutral and NEUTRAL.fullmatch(text) else ""
        self.add(ForgetAll(self.why(f"{self.as_written(text, at)} is unknown here", at), stated))

    def list_left(self, reason: Reason, name: str, at: int | None = None) -> None:
        if self.is_own:
            short = " ".join(self.as_written(name, at).split())[:_LONGEST_NAME]
            self.points.left.append(UncorrectedTarget(self.file, self.line(at), short, reason))

    def as_written(self, name: str, at: int | None = None) -> str:
        """A name or text in the case in which it follows a position of the file."""
        begin = self.texts[self.file].find(name, self.at if at is None else at)
        return name if begin < 0 else self._written[self.file][begin : begin + len(name)]

    def leave(self, reason: Reason, name: str, at: int | None = None, *, relative: bool = False) -> None:
        """List a move that cannot be corrected; the arm is anywhere afterwards.

        relative: if the move is in another file, it follows the corrections of this program.
        """
        self.list_left(reason, name, at)
        self.add(Elsewhere(self.why(name, at) if relative and not self.is_own else None))

    def change(self, key: str, at: int | None = None) -> None:
        """Record that the program uses a point otherwise than as a target."""
        if key in self.points.declared:
            self.points.change(key, self.file, self.line(at))

    def mentions(self, word: re.Pattern[str]) -> Iterator[re.Match[str]]:
        """Yield the words of all texts that no statement has used."""
        for file, text in enumerate(self.texts):
            for found in word.finditer(text):
                self.file, self.at = file, found.start()
                if (file, self.at) not in self.spent:
                    yield found

    def scopes(self, name: str) -> tuple[str, ...]:
        """The keys of `defined` under which a name is looked up, in this order."""
        return (name.upper(),)

    def named(self, name: str) -> list[str]:
        return next((self.defined[scope] for scope in self.scopes(name) if scope in self.defined), [])

    def call_of(self, name: str, at: int | None = None) -> Statement:
        """Call a routine; everything is unknown after a name that is not unique or has no text."""
        routines, name = self.named(name), self.as_written(name, at)
        if len(routines) == 1:
            return Call(routines[0], self.why(f"{name} is called", at))
        return ForgetAll(self.why(f"{name} is unknown here", at), missing="" if routines else name)

    def begin_routine(self, name: str) -> None:
        self.end_routine()
        self.routine, self.blocks = name, Blocks()

    def end_routine(self) -> None:
        """Store the routine. If another has the same name, no call leads to it, and nothing in it is certain."""
        if self.routine is not None:
            name, body = self.routine, self.blocks.finish_routine()
            if len(self.defined.get(name, ())) > 1:
                body = (ForgetAll(Unknown(0, 0, f"{name} is defined twice")), *body)
                name = f"{name} {len(self.routines)}"
            self.routines[name] = body
        self.routine = None

    def open_routine(self, name: str) -> None:
        self.around.append((self.routine, self.blocks))
        self.routine, self.blocks = name, Blocks()

    def close_routine(self) -> None:
        self.end_routine()
        self.routine, self.blocks = self.around.pop()

    def runs_beside(self, name: str, at: int | None = None) -> None:
        """Add a routine, by its name in the program, that may run at any moment."""
        routines = self.named(name)
        called = routines[0] if len(routines) == 1 else f"\0{name}"
        self.beside.append(Call(called, self.why(f"{name} may run at any moment", at), self.routine or ""))

    def concurrently(self, why: Unknown, parse: Callable[[], None]) -> None:
        """Let what `parse` adds happen at any moment."""
        outer, self.blocks = self.blocks, Blocks()
        parse()
        body, self.blocks = self.blocks.finish_routine(), outer
        if body:
            name = f"\0{len(self.beside)}"
            self.routines[name] = body
            self.beside.append(Call(name, why, self.routine or ""))

    def initial(self, variable: str) -> Value:
        raise NotImplementedError

    def program(self, *, kept: tuple[str, ...] = (), cycles: bool = False, starts: str | None = None) -> Program:
        concurrent = tuple(self.beside), tuple(self.broken)
        return Program(self.routines, self.initial, *concurrent, kept, cycles=cycles, starts=starts)


def _blanked(text: str, pattern: re.Pattern[str]) -> str:
    """Replace comments and the insides of quotes by spaces, and line ends by newlines; the length stays."""

    def spaces(match: re.Match[str]) -> str:
        matched = match[0]
        if len(matched) > 1 and matched[0] == matched[-1] and matched[0] in "\"'":
            return matched[0] + " " * (len(matched) - 2) + matched[0]
        return re.sub(r"[^\n]", " ", matched)

    if text.startswith(_MARK):
        text = " " * len(_MARK) + text[len(_MARK) :]
    return pattern.sub(spaces, text.replace("\r\n", " \n").replace("\r", "\n"))


def word_set(text: str) -> frozenset[str]:
    return frozenset(text.split())


def number_at(match: re.Match[str], group: int | str, begin: int = 0) -> Number:
    return Number(begin + match.start(group), begin + match.end(group), float(match[group]))


def numbers_in(text: str, begin: int, end: int, offset: int = 0) -> tuple[Number, ...] | None:
    """Numbers of a list "n, n, n" in a text that starts at `offset`; None for any other text."""
    found = [_NUMBER.fullmatch(text, *place) for place in arguments(text, begin, end)]
    numbers = tuple(number_at(number, 0, offset) for number in found if number)
    return numbers if len(numbers) == len(found) else None


def brackets(text: str, begin: int = 0, end: int | None = None) -> dict[int, int]:
    """Position of the closing bracket for each opening bracket that is closed."""
    open_at: list[int] = []
    closes: dict[int, int] = {}
    for match in re.compile(r"[()\[\]{}]").finditer(text, begin, len(text) if end is None else end):
        if match[0] in "([{":
            open_at.append(match.start())
        elif open_at:
            closes[open_at.pop()] = match.start()
    return closes


def arguments(text: str, begin: int, end: int) -> list[tuple[int, int]]:
    """Ranges of arguments separated by commas outside brackets, without the spaces around them."""
    commas, depth = [begin - 1], 0
    for match in re.compile(r"[()\[\]{},]").finditer(text, begin, end):
        if match[0] == "," and depth == 0:
            commas.append(match.start())
        elif match[0] != ",":
            depth += 1 if match[0] in "([{" else -1
    places = []
    for comma, stop in zip(commas, [*commas[1:], end], strict=True):
        inside = text[comma + 1 : stop]
        places.append((comma + 1 + len(inside) - len(inside.lstrip()), stop - len(inside) + len(inside.rstrip())))
    return places
