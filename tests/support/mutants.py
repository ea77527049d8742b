"""Mutants of the three packages: small random code changes that a test should detect."""

from __future__ import annotations

import ast
import random
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

PACKAGES = ("daq", "analysis", "rigs")
_COMPARED: dict[type[ast.cmpop], str] = {
    ast.Lt: ">=", ast.LtE: ">", ast.Gt: "<=", ast.GtE: "<", ast.Eq: "!=", ast.NotEq: "==",
    ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
_COMPUTED: dict[type[ast.operator], str] = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*"}
_SIGNS: dict[type[ast.AST], str] = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=", ast.Is: "is",
    ast.IsNot: "is not", ast.In: "in", ast.NotIn: "not in", ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/",
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
    source, tree = _Source(text, path), ast.parse(text)
    found = []
    for node in _code(tree):
        found += _mutants(source, node)
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


class _Source:
    """The text of a file with the character positions of its nodes."""

    def __init__(self, text: str, path: str) -> None:
        self.text, self.path = text, path
        self._lines = [0]
        for line in text.splitlines(keepends=True):
            self._lines.append(self._lines[-1] + len(line))
        self._bytes = [line.encode() for line in text.splitlines()]

    def begin(self, node: ast.expr | ast.stmt) -> int:
        return self._at(node.lineno, node.col_offset)

    def end(self, node: ast.expr | ast.stmt) -> int:
        return self._at(node.end_lineno or 0, node.end_col_offset or 0)

    def _at(self, line: int, byte: int) -> int:
        return self._lines[line - 1] + len(self._bytes[line - 1][:byte].decode())

    def mutant(self, node: ast.expr | ast.stmt, after: str, kind: str) -> Mutant:
        begin, end = self.begin(node), self.end(node)
        return Mutant(self.path, node.lineno, begin, self.text[begin:end], after, kind)

    def sign(self, left: ast.expr, right: ast.expr, before: str, after: str, kind: str) -> Iterator[Mutant]:
        """Mutant of an operator between two nodes, if only brackets surround it."""
        begin = self.end(left)
        between = self.text[begin : self.begin(right)]
        pattern = r"\s+".join(map(re.escape, before.split()))
        signs = list(re.finditer(pattern, between))
        if len(signs) == 1 and "#" not in between:
            at, sign = begin + signs[0].start(), signs[0].group()
            yield Mutant(self.path, self.text.count("\n", 0, at) + 1, at, sign, after, kind)


def _mutants(source: _Source, node: ast.AST) -> Iterator[Mutant]:
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _COMPARED:
        sign = type(node.ops[0])
        yield from source.sign(node.left, node.comparators[0], _SIGNS[sign], _COMPARED[sign], "comparison flipped")
    elif isinstance(node, ast.BinOp) and type(node.op) in _COMPUTED and not _is_text(node):
        computed = type(node.op)
        yield from source.sign(node.left, node.right, _SIGNS[computed], _COMPUTED[computed], "operator swapped")
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield source.mutant(node, repr(node.value + 1 if node.value in (0, 1) else 2 * node.value), "constant changed")
    elif isinstance(node, ast.Constant) and type(node.value) is bool:
        yield source.mutant(node, repr(not node.value), "constant changed")
    elif isinstance(node, ast.Return) and node.value is not None and not _is_none(node.value):
        yield source.mutant(node, "return None", "return removed")
    elif isinstance(node, ast.If | ast.While | ast.IfExp) and not _is_of_types(node.test):
        begin, end = source.begin(node.test), source.end(node.test)
        text = source.text[begin:end]
        yield Mutant(source.path, node.test.lineno, begin, text, f"(not ({text}))", "condition negated")


def _is_text(node: ast.BinOp) -> bool:
    return any(isinstance(one, ast.JoinedStr) or _is_str(one) for one in (node.left, node.right))


def _is_str(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _is_of_types(node: ast.expr) -> bool:
    return isinstance(node, ast.Name) and node.id == "TYPE_CHECKING"


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
