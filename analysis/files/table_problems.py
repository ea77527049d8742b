"""The mistakes of a table file, each with its line and column; the first twenty are reported."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from rigs.errors import FileError

_SHOWN = 20


@dataclass(frozen=True, order=True)
class TableProblem:
    """One mistake in a table: the line of the file, counted from 1, the column or "" for the whole row, the reason."""

    line: int
    column: str
    message: str

    def __str__(self) -> str:
        place = f"line {self.line}, {_plain(self.column)}" if self.column else f"line {self.line}"
        return f"{place}: {self.message}"


@dataclass
class Problems:
    """The mistakes found so far: how many, and the first of them in order of lines; a bad file may have millions."""

    count: int = 0
    _kept: list[TableProblem] = field(default_factory=list)

    def add(self, found: Iterable[TableProblem]) -> None:
        """Count problems, and keep those that may be among the first."""
        for problem in found:
            self.count += 1
            self._kept.append(problem)
            if len(self._kept) > 50 * _SHOWN:
                self._kept = self.first

    @property
    def first(self) -> list[TableProblem]:
        """The problems that are shown, in order."""
        return sorted(self._kept)[:_SHOWN]


class TableFileError(FileError):
    """A table with mistakes; the first of them in `problems`, in order of lines."""

    def __init__(
        self, path: str, problems: list[TableProblem], remedy: str = "correct the file", count: int | None = None
    ) -> None:
        """count: of all mistakes, where problems are the first of them only."""
        total = len(problems) if count is None else count
        self.problems = sorted(problems)[:_SHOWN]
        shown = [str(problem) for problem in self.problems]
        if total > _SHOWN:
            shown.append(f"… and {total - _SHOWN} more, {total} mistakes in all")
        mistakes = "1 mistake" if total == 1 else f"{total} mistakes"
        super().__init__(path, f"{mistakes}: " + " | ".join(shown), remedy)
        self.shown = shown

    def lines(self) -> list[str]:
        return [
            *(f"{self.where}, {line}" for line in self.shown[:-1]),
            f"{self.where}, {self.shown[-1]}; {self.remedy}",
        ]


def quoted(text: str) -> str:
    """What stands in a file, fit for one line of a message."""
    return repr(text if len(text) <= 40 else text[:37] + "…")


def _plain(column: str) -> str:
    return column if column.isprintable() else quoted(column)
