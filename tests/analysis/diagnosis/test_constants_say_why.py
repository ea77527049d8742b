"""Every numeric constant of the estimating folders states its origin, and every function on arrays states shapes."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3] / "analysis"
FILES = sorted(
    file for folder in ("diagnosis", "fitting", "noise", "correction") for file in (ROOT / folder).glob("*.py")
)
ARRAYS = {"Array", "Integers", "Mask", "NDArray"}
SHAPE = re.compile(r"\([^()]*(,|…|\.\.\.)[^()]*\)")
"""A shape in a docstring: a tuple such as `(n, 6)`, `(N,)` or `(…)`."""


def constants(tree: ast.Module) -> Iterator[tuple[str, int, bool]]:
    """Name, first line and whether a docstring follows, of each module-level assignment with a number in it."""
    for node, following in zip(tree.body, [*tree.body[1:], None], strict=True):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None or not _has_number(node.value):
            continue
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        documented = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
        yield ast.unparse(target), node.lineno, documented and isinstance(following.value.value, str)


def _has_number(value: ast.expr) -> bool:
    parts = (part.value for part in ast.walk(value) if isinstance(part, ast.Constant))
    return any(isinstance(part, int | float) and not isinstance(part, bool) for part in parts)


def unexplained(text: str) -> list[str]:
    """Numeric constants that neither a docstring follows nor a comment precedes."""
    lines = text.splitlines()
    return [
        name
        for name, line, documented in constants(ast.parse(text))
        if not documented and not lines[line - 2].startswith("#")
    ]


def without_shapes(text: str) -> list[str]:
    """Public functions and methods with an array as parameter or result whose docstring has no shape."""
    found = []
    for owner in ast.walk(ast.parse(text)):
        if isinstance(owner, ast.Module | ast.ClassDef) and not getattr(owner, "name", "").startswith("_"):
            functions = [node for node in owner.body if isinstance(node, ast.FunctionDef)]
            found += [one.name for one in functions if _lacks_shape(one)]
    return found


def _lacks_shape(function: ast.FunctionDef) -> bool:
    if function.name.startswith("_"):
        return False
    arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    types = [one.annotation for one in arguments if one.annotation] + [function.returns] * bool(function.returns)
    names = {part.id for one in types if one for part in ast.walk(one) if isinstance(part, ast.Name)}
    return bool(names & ARRAYS) and not SHAPE.search(ast.get_docstring(function) or "")


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.parent.name}/{file.stem}")
def test_each_constant_states_its_origin(file: Path) -> None:
    assert unexplained(file.read_text()) == []


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.parent.name}/{file.stem}")
def test_each_public_function_on_arrays_states_shapes(file: Path) -> None:
    assert without_shapes(file.read_text()) == []


def test_a_number_without_a_word_is_found() -> None:
    text = 'A = 1.0\nB, C = 2, 3\n"""Chosen."""\n# chosen\nD = [4]\nE = "text"\n'
    assert unexplained(text) == ["A"]


def test_a_function_without_a_shape_is_found() -> None:
    text = "def f(x: Array) -> float:\n    '''Return x.'''\n\ndef g() -> Array:\n    '''Return (n, 3) mm.'''\n"
    assert without_shapes(text) == ["f"]
