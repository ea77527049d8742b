"""Selection of tests and test cases that run for each commit; the others run in `scripts/dev nightly`.

`cases` selects cases of a parametrised test in its own file. The table `tests/night.toml` lists nightly tests whose
capability is also covered by cheaper tests, and names those.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Collection, Iterable
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any

import pytest

TABLE = Path(__file__).parents[1] / "night.toml"

NIGHT_IS_OVER = "the night is over"
"""Skip reason for tests of `scripts/dev nightly` after the end of the night."""


def cases(every: Iterable[Any], in_each_commit: Collection[Any] | Callable[[Any], bool]) -> list[Any]:
    """Return parameters for `pytest.mark.parametrize`, with the mark `nightly` on all cases not selected for each
    commit.

    A tuple is a case with several parameters.
    """
    chosen = in_each_commit if callable(in_each_commit) else in_each_commit.__contains__
    return [
        pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=() if chosen(one) else pytest.mark.nightly)
        for one in every
    ]


def examples(of_commit: int, of_night: int) -> pytest.MarkDecorator:
    """Set the number of hypothesis examples of a property: `of_commit` for each commit, `of_night` at night."""
    return pytest.mark.parametrize("examples", cases((of_commit, of_night), {of_commit}))


@cache
def moved() -> tuple[dict[str, Any], ...]:
    """Entries of the table: file or folder `of` tests, their names, cases to `keep`, and the tests that
    `stay`.
    """
    return tuple(tomllib.loads(TABLE.read_text(encoding="utf-8"))["moved"])


def is_moved(nodeid: str) -> bool:
    """True if a test runs only at night, according to the table of nightly tests."""
    return any(_names(entry, nodeid) for entry in _moved_of(nodeid.partition("::")[0]))


@cache
def _moved_of(file: str) -> tuple[dict[str, Any], ...]:
    """Entries of a test file."""
    return tuple(entry for entry in moved() if file.startswith(entry["of"]))


def _names(entry: dict[str, Any], nodeid: str) -> bool:
    test = nodeid.partition("::")[2]
    kept = any(fnmatchcase(_case(test), pattern) for pattern in entry.get("keep", ()))
    return not kept and any(_is_of(test, name) for name in entry["tests"])


def _case(test: str) -> str:
    """Part of a test name in brackets."""
    return test.partition("[")[2].removesuffix("]")


def _is_of(test: str, name: str) -> bool:
    return test == name or test.startswith(f"{name}[")
