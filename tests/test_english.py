"""The counts of `scripts/dev english` may fall at any time, and rise only with a reason beside them."""

from __future__ import annotations

import ast
import runpy
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

ENGLISH = runpy.run_path(str(Path(__file__).parents[1] / "scripts" / "tools" / "english.py"))
MOST = {
    "docstrings": 2.3,
    "messages": 5.0,
    "page texts": 7.3,  # a third of it are keys of data: held_out, nothing_unusual, unjudged
    "documents": 7.1,  # an eighth more words than before: pages for one purpose each
    "docstrings without a noun or verb first": 0.0,
    "names of a participle or preposition": 8.0,  # public names and attributes of users' own extensions
    "class names in several files": 9.0,
}


@pytest.fixture(scope="module")
def counts() -> dict[str, float]:
    found: tuple[dict[str, float], Any] = ENGLISH["counts"]()
    return found[0]


@pytest.mark.parametrize("name", MOST)
def test_no_count_has_grown(name: str, counts: dict[str, float]) -> None:
    assert counts[name] <= MOST[name], f"{name}: {counts[name]:.1f}, more than {MOST[name]:g}: see scripts/dev english"


def test_every_count_has_a_limit(counts: dict[str, float]) -> None:
    assert counts.keys() == MOST.keys()


def test_the_dialect_is_seen() -> None:
    dialect = "What is left is told beside those that it stands behind. " * 20
    ordinary = "Return the residual in units of the noise. Raise an error if the gauge does not answer. " * 20
    assert ENGLISH["excess_of"](Counter(ENGLISH["words_of"](dialect))) > 300
    assert ENGLISH["excess_of"](Counter(ENGLISH["words_of"](ordinary))) == 0
    assert ENGLISH["words_of"]("the `left` of {what} at https://a.b/those") == ["the", "of", "at"]


def test_docstrings_of_definitions_and_constants_are_read() -> None:
    tree = ast.parse('"""A."""\nX = 1\n"""B."""\ndef f():\n    """C."""\n    return "no docstring"\n')
    assert [constant.value for constant in ENGLISH["docstrings_in"](tree)] == ["A.", "B.", "C."]
