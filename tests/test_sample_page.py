"""The page from the wire to the figure names files and functions that exist."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "how-a-sample-becomes-a-figure.md").read_text(encoding="utf-8")
NAMES = sorted(set(re.findall(r"`((?:rigs|daq|analysis)/[\w/.]*?)(?::(\w+))?`", PAGE)))


def _defined(path: Path) -> set[str]:
    """The classes, functions and constants of a module."""
    found: set[str] = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.AnnAssign(target=ast.Name(id=name)):
                found.add(name)
            case ast.Assign(targets=targets):
                found |= {target.id for target in targets if isinstance(target, ast.Name)}
    return found


def test_the_page_names_its_steps() -> None:
    assert len(NAMES) > 30 and len([name for _, name in NAMES if name]) > 25


@pytest.mark.parametrize(("path", "name"), NAMES, ids=":".join)
def test_every_path_and_name_of_the_page_exists(path: str, name: str) -> None:
    assert (ROOT / path).exists()
    assert not name or name in _defined(ROOT / path)
