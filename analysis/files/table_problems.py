"""The mistakes of a table file, each with its line and column; the first twenty are reported."""

from __future__ import annotations

from dataclasses import dataclass

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


class TableFileError(FileError):
    """A table with mistakes, all of them in `problems`, in order of lines."""

    def __init__(self, path: str, problems: list[TableProblem], remedy: str = "correct the file") -> None:
        self.problems = sorted(problems)
        shown = [str(problem) for problem in self.problems[:_SHOWN]]
        if len(self.problems) > _SHOWN:
            shown.append(f"… and {len(self.problems) - _SHOWN} more, {len(self.problems)} mistakes in all")
        count = "1 mistake" if len(problems) == 1 else f"{len(problems)} mistakes"
        super().__init__(path, f"{count}: " + " | ".join(shown), remedy)
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
