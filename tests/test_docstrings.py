"""Every public function on arrays says their shapes and units, and a docstring names its subject first."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("rigs", "daq", "analysis")
ARRAY = re.compile(r"\b(Array|NDArray|ndarray|Integers|Mask)\b")
SHAPE = re.compile(r"\((?:\.\.\.|…|\d|[A-Za-z])[\w\s.+·*/…-]*,[^()]*\)|\(\d\)")
"""`(n,)`, `(n, 6)`, `(..., NODES)`, `(6)`."""
UNIT = re.compile(
    r"(?<!\w)(mm|rad|deg|degrees|s|ns|Hz|Nm|ppm|relative|ratio|shares?|weights?|turns?|standard deviations?|poses?"
    r"|whitened|healthy sizes?|log evidence|µm|mm²|counts?|numbers?|index|indices|mask|whether|which"
    r"|directions?|orders?|power|unit|figures)(?!\w)|°|_(mm|rad|deg|s|ns|um)\b"
)
"""A unit, or a word for what has none, as a share, a number, a mask, or whitened values (standard deviations)."""


def _functions() -> Iterator[tuple[str, ast.FunctionDef, str]]:
    """Each public function on arrays: its place, itself, and the words that describe it."""
    for path in sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        name = str(path.relative_to(ROOT))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            bodies = [("", node)] if isinstance(node, ast.Module) else []
            bodies += [(ast.get_docstring(node) or "", node)] if isinstance(node, ast.ClassDef) else []
            for of_class, body in bodies:
                for one in body.body:
                    if isinstance(one, ast.FunctionDef) and not one.name.startswith("_") and _on_arrays(one):
                        yield f"{name}:{one.name}", one, _words(one, of_class)


def _arrays(one: ast.FunctionDef) -> list[ast.arg]:
    arguments = [*one.args.args, *one.args.kwonlyargs]
    return [each for each in arguments if each.annotation and ARRAY.search(ast.unparse(each.annotation))]


def _on_arrays(one: ast.FunctionDef) -> bool:
    return bool(_arrays(one)) or bool(one.returns and ARRAY.search(ast.unparse(one.returns)))


def _words(one: ast.FunctionDef, of_class: str) -> str:
    """What a reader sees: the docstring and the names; of a property also the docstring of its class."""
    is_property = any(ast.unparse(decorator).endswith("property") for decorator in one.decorator_list)
    names = " ".join([one.name, *(each.arg for each in _arrays(one))])
    return f"{ast.get_docstring(one) or ''} {of_class if is_property else ''} {names}"


FUNCTIONS = list(_functions())
FRAGMENT = re.compile(r"(Of|By|That|In which|In the|As (for|in)|Beside|Times (the|what|a|as)) ")
"""How a docstring begins that leaves out what it is about: `Of a cycle: …`."""
QUAINT = re.compile(r"\b(tells?|told|nobody|whoever|anew|awaited|no doubt|mended?)\b", re.I)
"""Words for which this project has plainer ones: report, distinguish, unknown, again, correct."""


def _strings() -> Iterator[tuple[str, str]]:
    """Each docstring and message of the product with its place."""
    for path in sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        name = str(path.relative_to(ROOT))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
                yield f"{name}:{node.lineno}", node.value


def test_functions_on_arrays_are_found() -> None:
    assert len(FUNCTIONS) > 100


@pytest.mark.parametrize(("place", "one", "words"), FUNCTIONS, ids=[place for place, *_ in FUNCTIONS])
def test_shapes_and_units_are_said(place: str, one: ast.FunctionDef, words: str) -> None:
    assert SHAPE.search(words), f"{place}, line {one.lineno}: its docstring gives no shape, as (n, 6)"
    assert UNIT.search(words), f"{place}, line {one.lineno}: neither docstring nor names give a unit"


def test_docstrings_name_their_subject_and_words_are_plain() -> None:
    strings = list(_strings())
    assert len(strings) > 2000
    assert [(place, text[:60]) for place, text in strings if FRAGMENT.match(text) or QUAINT.search(text)] == []


@pytest.mark.parametrize(
    ("words", "shape", "unit"),
    [
        ("Angles (n,) rad.", True, True),
        ("Curves (..., NODES).", True, False),
        ("Angles of the joints (see there), in rad.", False, True),
        ("The T of an arm.", False, False),
    ],
)
def test_what_counts_as_shape_and_unit(words: str, shape: bool, unit: bool) -> None:
    assert (bool(SHAPE.search(words)), bool(UNIT.search(words))) == (shape, unit)
