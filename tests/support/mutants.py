"""Mutants of the three packages: small random code changes that a test should detect."""

from __future__ import annotations

import ast
import random
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

PACKAGES = ("daq", "analysis", "rigs")
_OPPOSITE: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """A change in a file: the characters `before`, starting at position `begin`, become `after`."""

    path: str
    line: int
    begin: int
    before: str
    after: str
    kind: str

    def __str__(self) -> str:
        before, after = (" ".join(text.split())[:60] for text in (self.before, self.after))
        return f"{self.path}:{self.line}: {self.kind}: {before} -> {after or 'nothing'}"

    def applied(self, text: str) -> str:
        """Text of the file with the change. Raises ValueError if the file has different text at this
        position.
        """
        end = self.begin + len(self.before)
        if text[self.begin : end] != self.before:
            raise ValueError(f"{self.path} has another text at line {self.line} than it had when the mutant was drawn")
        return text[: self.begin] + self.after + text[end:]

    def to_dict(self) -> dict[str, str | int]:
        """Fields as plain types."""
        return asdict(self)


def drawn(root: Path, count: int, seed: int) -> list[Mutant]:
    """Draw mutants. The probability of a file is proportional to its number of possible changes; no place is changed
    twice.
    """
    files = [file for name in PACKAGES for file in sorted((root / name).rglob("*.py"))]
    every = [one for file in files for one in mutants_of(file.read_text(encoding="utf-8"), str(file.relative_to(root)))]
    random.Random(seed).shuffle(every)  # take the first of many mutants, as for files with few
    return every[:count]


def mutants_of(text: str, path: str) -> list[Mutant]:
    """All mutants of a file: changes of computations in functions and of named constants."""
    lines = text.splitlines(keepends=True)
    starts = [0, *accumulate(map(len, lines))]

    def place(line: int, byte: int) -> int:
        return starts[line - 1] + len(lines[line - 1].encode()[:byte].decode())

    found = []
    for node in _code(ast.parse(text)):
        for part, after, kind in _changes(node):
            begin, end = place(part.lineno, part.col_offset), place(part.end_lineno, part.end_col_offset)
            found.append(Mutant(path, part.lineno, begin, text[begin:end], after, kind))
    return found


def _code(node: ast.AST) -> Iterator[ast.AST]:
    """Nodes that compute something: no annotations, texts, decorators or error messages."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list") or isinstance(node, ast.Raise | ast.JoinedStr):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _code(child)


def _changes(node: ast.AST) -> Iterator[tuple[Any, str, str]]:
    """Nodes to replace, each with its new text and the kind of change."""
    match node:
        case ast.Compare(ops=[sign]) if type(sign) in _OPPOSITE:
            yield node, _with(node, ops=[_OPPOSITE[type(sign)]()]), "comparison flipped"
        case ast.BinOp(op=sign) if type(sign) in _OPPOSITE and not (_is_text(node.left) or _is_text(node.right)):
            yield node, _with(node, op=_OPPOSITE[type(sign)]()), "operator swapped"
        case ast.Constant(value=bool(value)):
            yield node, repr(not value), "constant changed"
        case ast.Constant(value=int(value) | float(value)):
            yield node, repr(value + 1 if value in (0, 1) else 2 * value), "constant changed"
        case ast.Return(value=ast.expr() as value) if not (isinstance(value, ast.Constant) and value.value is None):
            yield node, "return None", "return removed"
        case ast.If(test=test) | ast.While(test=test) | ast.IfExp(test=test):
            if not (isinstance(test, ast.Name) and test.id == "TYPE_CHECKING"):
                yield test, f"(not ({ast.unparse(test)}))", "condition negated"


def _with(node: ast.AST, **changed: Any) -> str:
    """Text of an expression with some of its parts changed."""
    return ast.unparse(type(node)(**dict(ast.iter_fields(node)) | changed))


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


def files_for(root: Path, path: str) -> list[str]:
    """Test files for a mutant of a module, most specific first: the module's own tests, tests that import it, tests
    named after its folder or below the same path, tests that import the folder, and the same for the parent folder.
    """
    module = path.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
    package, name = module.rpartition(".")[::2]
    parent, folder = package.rpartition(".")[::2]
    texts = {str(file.relative_to(root)): file.read_text(encoding="utf-8") for file in _tests(root)}
    ranks = (
        [test for test in texts if test.endswith(f"/test_{name}.py")],
        _importing(texts, rf"{re.escape(module)}\b|from {re.escape(package)} import [^\n]*\b{re.escape(name)}\b"),
        [
            test
            for test in texts
            if f"/test_{folder}_" in test or test.startswith(f"tests/{package.replace('.', '/')}/")
        ],
        _importing(texts, rf"\b{re.escape(package)}\b"),
        _importing(texts, rf"\b{re.escape(parent)}\b(?!\.\w+\.)") if "." in parent else [],
    )
    return list(dict.fromkeys(test for rank in ranks for test in rank))


def _importing(texts: Mapping[str, str], pattern: str) -> list[str]:
    imports = re.compile(pattern)
    return [test for test, text in texts.items() if imports.search(text)]


def _tests(root: Path) -> list[Path]:
    return sorted((root / "tests").rglob("test_*.py"))
