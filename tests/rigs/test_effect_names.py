"""No product file but an effect's own holds its name: what another file knows of it would be missing of a new one."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import rigs.effects
from rigs.effects import VOCABULARY

ROOT = Path(rigs.effects.__file__).parents[2]
FILES = [path for package in ("rigs", "daq", "analysis") for path in sorted((ROOT / package).rglob("*.py"))]
CLASSES = {cls.__name__: name for name, cls in VOCABULARY.items()}
IDENTIFIERS = re.compile(rf"\b({'|'.join((*VOCABULARY, *CLASSES))})\b")
KEYS = re.compile(
    rf"\b({'|'.join(name for name in VOCABULARY if '_' in name)})\b"
    rf"|^({'|'.join(name for name in VOCABULARY if '_' not in name)})\b"
)
"""In a string; an English word, as vibration, only where the string begins with it."""


def _names_in(source: str) -> set[str]:
    """Effects that code names by identifiers, imports and strings, docstrings left out."""
    tree = ast.parse(source)
    prose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    found: set[str] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Constant(value=str(text)) if id(node) not in prose:
                found.update(name for groups in KEYS.findall(text) for name in groups if name)
            case (
                ast.Name(id=text)
                | ast.Attribute(attr=text)
                | ast.alias(name=text)
                | ast.keyword(arg=str(text))
                | ast.ImportFrom(module=str(text))
            ):
                found.update(IDENTIFIERS.findall(text))
    return {CLASSES.get(name, name) for name in found}


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_only_its_own_file_names_an_effect(path: Path) -> None:
    own = {path.stem} if path.parent.name == "effects" else set()
    assert _names_in(path.read_text()) <= own


def test_names_are_found_where_code_holds_them() -> None:
    assert _names_in('"""A vibration."""\nX = {"time_lag": 1}') == {"time_lag"}
    assert _names_in("from rigs.effects import Backlash as B") == {"backlash"}
    assert _names_in("import rigs.effects.ball_form") == {"ball_form"}
    assert _names_in("effects.ServoLag(axis=1)") == {"servo_lag"}
    assert _names_in('tell("the vibration of the stand")') == set()
