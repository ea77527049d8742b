from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

from rigs.effects import VOCABULARY

ROOT = Path(__file__).parents[1]
FILES = [path for package in ("rigs", "daq", "analysis") for path in sorted((ROOT / package).rglob("*.py"))]


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


CLASSES = {cls.__name__: name for name, cls in VOCABULARY.items()}
IDENTIFIERS = re.compile(rf"\b({'|'.join((*VOCABULARY, *CLASSES))})\b")
KEYS = re.compile(
    rf"\b({'|'.join(name for name in VOCABULARY if '_' in name)})\b"
    rf"|^({'|'.join(name for name in VOCABULARY if '_' not in name)})\b"
)
"""In a string; an English word, as vibration, only where the string begins with it."""


def _names_in(tree: ast.Module) -> set[str]:
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


def test_only_its_own_file_names_an_effect():
    """What another file knew of an effect would be missing of a new one."""
    own = {path: {path.stem} if path.parent.name == "effects" else set() for path in FILES}
    found = {name_of(path): _names_in(tree_of(path)) - own[path] for path in FILES}
    assert {name: effects for name, effects in found.items() if effects} == {}


def test_a_signed_number_never_shows_a_negative_zero():
    """The point of a movement was `+1.60, +0.19, -0.00 mm`: a format with a sign also has the option z of PEP 682."""
    wire = {"daq/apps/gauge_drivers/magnescale_lt.py", "daq/acquisition/capture_writer.py"}  # formats of other programs
    signed, bare = re.compile(r"\+z[\d.{}]*[fg%]?"), re.compile(r"\+0?[\d.{}]*[fg%]")
    specs = [
        (name_of(path), spec)
        for path in FILES
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.JoinedStr)
        for value in node.values
        if isinstance(value, ast.FormattedValue) and value.format_spec is not None
        for spec in [ast.unparse(value.format_spec).removeprefix("f'").removesuffix("'")]
    ]
    assert sum(bool(signed.fullmatch(spec)) for _, spec in specs) > 30
    assert [entry for entry in specs if bare.fullmatch(entry[1]) and entry[0] not in wire] == []
