"""Questions to a person: answered by an option, at the terminal, or by what is usual."""

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
"""Clears what an older, longer line has left."""
Busy = Callable[[str], AbstractContextManager[Callable[[str], None]]]
"""Shows what is being done until it is left; gives the function to call when something else is."""


class Stopped(Exception):
    """The person has ended the questions: Ctrl-D, or the terminal is closed."""


@dataclass(frozen=True)
class Dialogue:
    """Where questions are asked.

    say: prints a line; busy: shows what is done meanwhile; terminal: whether there is a person who can answer.
    """

    say: Callable[[str], None]
    busy: Busy
    terminal: bool
    keyboard: TextIO
    screen: TextIO

    def ask(self, question: str, option: str, read: Callable[[str], T], usual: str | None = None) -> T:
        """Ask until `read` understands the answer; again only by the last line of the question.

        option: what answers the question without a terminal. Raises UseError without a terminal, and Stopped.
        """
        if not self.terminal:
            if usual is None:
                raise UseError(option, "is missing, and rig cannot ask without a terminal", f"give {option}")
            return read(usual)
        explained, _, asked = question.rpartition("\n")
        for line in explained.splitlines():  # `say` is the gate for one line, and escapes what ends one
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
        """Return what is typed, without blanks around it. Raises Stopped."""
        self.screen.write(prompt)
        self.screen.flush()
        return self._typed()

    def line_or(self, prompt: Callable[[], str], happened: Callable[[], T | None]) -> str | T:
        """Return what is typed, or what happens before. The prompt is shown again and again, in its one line."""
        while True:
            self.screen.write(f"\r{prompt()}{_TO_THE_END}")
            self.screen.flush()
            if self._has_typed():
                return self._typed()
            if (event := happened()) is not None:
                self.screen.write("\n")
                return event

    def _has_typed(self) -> bool:
        """Wait a moment for a line: a Ctrl-C that comes just before an endless wait would go unnoticed."""
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
            raise Stopped
        return typed.strip()


def at_terminal(say: Callable[[str], None], busy: Busy) -> Dialogue:
    """Return the dialogue with the person at this program's terminal, if it has one."""
    has_terminal = has_keyboard() and sys.stdout.isatty()
    return Dialogue(say, busy, has_terminal, sys.stdin, sys.stdout)


def has_keyboard() -> bool:
    """Return whether a person can type to this program; standard input may be a file, or closed."""
    return sys.stdin is not None and sys.stdin.isatty()
