"""The page from the wire to the figure, and those that say how to extend rig, name files and functions that exist."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HOW_TO = ROOT / "docs" / "how-to"
TREES = (ROOT, *(HOW_TO / "examples").iterdir())
"""Where a file may be: in the tree, or in an example that a page adds to it."""
_NAME = re.compile(r"`((?:rigs|daq|analysis)/[\w/.]*?)(?::(\w+))?`")


def _named(page: Path) -> list[tuple[str, str]]:
    return sorted(set(_NAME.findall(page.read_text(encoding="utf-8"))))


SAMPLE_PAGE = ROOT / "docs" / "how-a-sample-becomes-a-figure.md"
NAMES = sorted({name for page in (SAMPLE_PAGE, *HOW_TO.glob("*.md")) for name in _named(page)})


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
    names = _named(SAMPLE_PAGE)
    assert len(names) > 30 and len([name for _, name in names if name]) > 25


@pytest.mark.parametrize(("path", "name"), NAMES, ids=[":".join(name) for name in NAMES])
def test_every_path_and_name_of_a_page_exists(path: str, name: str) -> None:
    found = next((tree / path for tree in TREES if (tree / path).exists()), None)
    assert found is not None, f"{path} is neither in the tree nor in an example"
    assert not name or name in _defined(found)
