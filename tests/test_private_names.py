"""A test that reaches into private names of the code says why, so that it is known which break when code moves.

The reason stands in a comment on the line or the one above, `# private: why`, or once for a file and a name,
`# private _name, _other: why`. Names that libraries document with an underscore need none.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
DOCUMENTED = {"_exit", "_replace", "_asdict", "_fields"}
"""`os._exit`, and the methods of named tuples."""
REASON = re.compile(r"# private(?P<names>( _\w+,?)*): \w.*")


def private_names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and name of each access to a private name of another object or module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            if not (isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")):
                yield node.end_lineno or node.lineno, node.attr
        elif isinstance(node, ast.ImportFrom):
            yield from ((alias.lineno, part) for alias in node.names for part in _parts(node.module, alias.name))
        elif isinstance(node, ast.Import):
            yield from ((alias.lineno, part) for alias in node.names for part in alias.name.split("."))
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("setattr", "getattr", "delattr")):
            named = [one for one in node.args[:2] if isinstance(one, ast.Constant) and isinstance(one.value, str)]
            yield from ((one.lineno, str(one.value).rsplit(".", 1)[-1]) for one in named)


def _parts(module: str | None, name: str) -> list[str]:
    return [*(module or "").split("."), name]


def unexplained(source: str) -> list[str]:
    """Return `line: name` of each access to a private name without a reason."""
    reasons = {
        token.start[0]: match
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT and (match := REASON.search(token.string))
    }
    of_file = {name.strip(" ,") for match in reasons.values() for name in match["names"].split()}
    of_line = {line for line, match in reasons.items() if not match["names"]}
    return [
        f"{line}: {name}"
        for line, name in private_names(ast.parse(source))
        if re.fullmatch(r"_[^_]\w*", name) and name not in DOCUMENTED | of_file and not {line, line - 1} & of_line
    ]


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("one._state", ["1: _state"]),
        ("one._state  # private: it is not reported", []),
        ("# private: it is not reported\none._state", []),
        ("# private _state, _io: stepped by hand\n\none._state + one._io + one._run", ["3: _run"]),
        ("one._state  # private:", ["1: _state"]),
        ("self._state + cls._state + one.__doc__ + os._exit", []),
        ("from a._b import _c", ["1: _b", "1: _c"]),
        ("import a._b", ["1: _b"]),
        ("monkeypatch.setattr(one, '_ROOM', 3)\nmonkeypatch.setattr('a.b._ROOM', 3)", ["1: _ROOM", "2: _ROOM"]),
    ],
)
def test_an_access_without_a_reason_is_found(source: str, found: list[str]) -> None:
    assert unexplained(source) == found


def test_every_access_to_a_private_name_gives_its_reason() -> None:
    missing = [
        f"{path.relative_to(TESTS.parent)}:{access}"
        for path in sorted(TESTS.rglob("*.py"))
        for access in unexplained(path.read_text(encoding="utf-8"))
    ]
    assert not missing, "\n".join(missing)
