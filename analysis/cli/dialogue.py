"""Questions to the operator, answered by an option, at the terminal, or by a default."""

from __future__ import annotations

import select
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TextIO, TypeVar

from rigs.errors import RigError, UseError

T = TypeVar("T")
_EVERY_S = 0.1
_TO_THE_END = "\x1b[K"
"""Escape sequence that clears the rest of a longer old line."""
Busy = Callable[[str], AbstractContextManager[Callable[[str], None]]]
"""Context that shows the current step and yields a function to change it."""


class DialogueEnded(Exception):
    """The operator ended the questions by Ctrl-D or by closing the terminal."""


@dataclass(frozen=True)
class Dialogue:
    say: Callable[[str], None]
    busy: Busy
    terminal: bool
    """Whether an operator can answer."""
    keyboard: TextIO
    screen: TextIO

    def ask(self, question: str, option: str, read: Callable[[str], T], usual: str | None = None) -> T:
        """Ask a question until `read` accepts the answer; repetitions show only its last line.

        option: the command-line option that answers it without a terminal, where UseError names it if there is no usual
        answer.
        """
        if not self.terminal:
            if usual is None:
                problem = "is missing, and rig cannot ask without a terminal"
                raise UseError(option, problem, f"give {option}", code="answer.missing")
            return read(usual)
        explained, _, asked = question.rpartition("\n")
        for line in explained.splitlines():  # `say` prints single lines and escapes line breaks
            self.say(line)
        while True:
            answer = self.line(f"{asked}{f' [{usual}]' if usual else ''}: ") or usual
            if not answer:
                continue
            try:
                return read(answer)
            except RigError as error:
                for line in error.lines():
                    self.say(f"error: {line}")

    def line(self, prompt: str) -> str:
        self.screen.write(prompt)
        self.screen.flush()
        return self._typed()

    def line_or(self, prompt: Callable[[], str], happened: Callable[[], T | None]) -> str | T:
        """Typed line, or an earlier event. The prompt is refreshed in place."""
        while True:
            self.screen.write(f"\r{prompt()}{_TO_THE_END}")
            self.screen.flush()
            if self._has_typed():
                return self._typed()
            if (event := happened()) is not None:
                self.screen.write("\n")
                return event

    def _has_typed(self) -> bool:
        """Wait briefly for a line: an endless wait would miss a Ctrl-C just before it."""
        return bool(select.select([self.keyboard], [], [], _EVERY_S)[0])

    def _typed(self) -> str:
        while not self._has_typed():
            pass
        try:
            typed = self.keyboard.readline()
        except UnicodeDecodeError:
            return ""
        if not typed:
            self.screen.write("\n")
            raise DialogueEnded
        return typed.strip()


def at_terminal(say: Callable[[str], None], busy: Busy) -> Dialogue:
    has_terminal = has_keyboard() and sys.stdout.isatty()
    return Dialogue(say, busy, has_terminal, sys.stdin, sys.stdout)


def has_keyboard() -> bool:
    """True if standard input is a terminal; it may be a file or closed."""
    return sys.stdin is not None and sys.stdin.isatty()


def has_person() -> bool:
    """True if an operator can answer. Questions go to standard error: scripts read the run from standard output."""
    return has_keyboard() and sys.stderr.isatty()
