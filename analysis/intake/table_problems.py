"""Mistakes in a table by line and column, collected into one error."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from rigs.errors import FileError
from rigs.text import counted, first_of

_SHOWN, _LINES = 20, 6
"""Largest number of mistakes shown, and of other lines with the same mistake."""


@dataclass(frozen=True, order=True)
class TableProblem:
    line: int
    column: str
    """Column, "" for the complete row."""
    message: str
    rows: int = 1
    also: tuple[int, ...] = ()
    """The first of the other lines with the same mistake."""

    def __str__(self) -> str:
        others = f"{first_of(self.also, _LINES)}{f' and {self.rows - 1 - _LINES} more' * (self.rows - 1 > _LINES)}"
        message = f"{self.message} (also in line {others})" if self.also else self.message
        if not self.column:
            return f"line {self.line}: {message}"
        column = self.column if self.column.isprintable() else quoted(self.column)
        return f"line {self.line}, {column}: {message}"


def _without_repeats(problems: Iterable[TableProblem]) -> list[TableProblem]:
    together: dict[tuple[str, str], TableProblem] = {}
    for problem in sorted(problems):
        first = together.setdefault((problem.column, problem.message), problem)
        if first is not problem:
            also = (*first.also, problem.line, *problem.also)[:_LINES]
            together[problem.column, problem.message] = replace(first, rows=first.rows + problem.rows, also=also)
    return list(together.values())


@dataclass
class Problems:
    count: int = 0
    _kept: list[TableProblem] = field(default_factory=list)

    def add(self, problems: Iterable[TableProblem]) -> None:
        for problem in problems:
            self.count += 1
            self._kept.append(problem)
            if len(self._kept) > 50 * _SHOWN:
                self._kept = self.first

    @property
    def first(self) -> list[TableProblem]:
        return _without_repeats(self._kept)[:_SHOWN]

    def refuse(self, where: str) -> None:
        if self.count:
            raise TableFileError(where, self.first, count=self.count)


class TableFileError(FileError):
    def __init__(
        self, path: str, problems: list[TableProblem], remedy: str = "correct the file", count: int | None = None
    ) -> None:
        """count: number of all mistakes, if problems is a part of it."""
        total = sum(problem.rows for problem in problems) if count is None else count
        self.problems = _without_repeats(problems)[:_SHOWN]
        self.shown = list(map(str, self.problems))
        if total > sum(problem.rows for problem in self.problems):
            unlisted = total - sum(problem.rows for problem in self.problems)
            self.shown.append(f"… and {unlisted} more, {total} mistakes in all")
        problem = f"{counted(total, 'mistake')}: {' | '.join(self.shown)}"
        super().__init__(path, problem, remedy, code="table.invalid")

    def lines(self) -> list[str]:
        return [
            *(f"{self.where}, {line}" for line in self.shown[:-1]),
            f"{self.where}, {self.shown[-1]}; {self.remedy}",
        ]


def quoted(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:37] + "…")
