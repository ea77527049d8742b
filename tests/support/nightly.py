"""Which tests, and which cases of a test, each commit has; the others are for `scripts/dev nightly`.

Cases of one test are chosen beside it by `cases`. Tests that are a night's because others of the same capability cost
less stand in the table `tests/night.toml`, each with what stays.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Collection, Iterable, Iterator
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any

import pytest

TABLE = Path(__file__).parents[1] / "night.toml"

NIGHT_IS_OVER = "the night is over"
"""Why a test of `scripts/dev nightly` is skipped after its last hour."""


def cases(every: Iterable[Any], in_each_commit: Collection[Any] | Callable[[Any], bool]) -> list[Any]:
    """Return parameters for `pytest.mark.parametrize`, a tuple being a case of several: those that are not among the
    chosen ones are marked `nightly`."""
    chosen = in_each_commit if callable(in_each_commit) else in_each_commit.__contains__
    return [
        pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=() if chosen(one) else pytest.mark.nightly)
        for one in every
    ]


def examples(of_commit: int, of_night: int) -> pytest.MarkDecorator:
    """Give a property how many `examples` it is tried on: so many in each commit, and the more at night."""
    return pytest.mark.parametrize("examples", cases((of_commit, of_night), {of_commit}))


@cache
def moved() -> tuple[dict[str, Any], ...]:
    """The entries of the table: the file or folder `of` tests, their names, cases to `keep` and what `stays`."""
    return tuple(tomllib.loads(TABLE.read_text(encoding="utf-8"))["moved"])


def is_moved(nodeid: str) -> bool:
    """Whether the table moves a test to the night."""
    return any(nodeid.startswith(entry["of"]) and _names(entry, nodeid) for entry in moved())


def unmatched(nodeids: Collection[str]) -> Iterator[str]:
    """The names of the table that no test has, and the cases to keep that no test of its entry has."""
    for entry in moved():
        there = [nodeid.partition("::")[2] for nodeid in nodeids if nodeid.startswith(entry["of"])]
        yield from (name for name in entry["tests"] if not any(_is_of(test, name) for test in there))
        cases = [_case(test) for test in there if any(_is_of(test, name) for name in entry["tests"])]
        yield from (kept for kept in entry.get("keep", ()) if not any(fnmatchcase(case, kept) for case in cases))


def _names(entry: dict[str, Any], nodeid: str) -> bool:
    test = nodeid.partition("::")[2]
    kept = any(fnmatchcase(_case(test), pattern) for pattern in entry.get("keep", ()))
    return not kept and any(_is_of(test, name) for name in entry["tests"])


def _case(test: str) -> str:
    """The part of a test's name in brackets."""
    return test.partition("[")[2].removesuffix("]")


def _is_of(test: str, name: str) -> bool:
    return test == name or test.startswith(f"{name}[")
