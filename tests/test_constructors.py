"""No constructor works: files, sockets, processes and threads are opened by a classmethod or by `start`, which can fail
and be undone, and what takes long is computed before. Read from the source: what a constructor calls, and what the
functions of its file call for it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGES = ("rigs", "daq", "analysis")
ROOT = Path(__file__).parents[1]
WORK = {
    *("open", "openpty", "socket", "create_server", "connect", "bind", "listen", "accept", "start", "submit", "Popen"),
    *("mkdir", "touch", "unlink", "symlink_to", "read_text", "read_bytes", "write_text", "write_bytes", "stat"),
    *("least_squares", "minimize", "sleep"),
}
"""Last names of calls that work."""
MADE = {"array", "asarray", "empty", "zeros", "ones", "full", "eye", "default_rng"}
"""What numpy makes without computing; everything else of numpy works, and so does a product of matrices."""


def working_constructors(source: str) -> dict[str, set[str]]:
    """Return what the constructor of each class in a file calls that works, of classes that do."""
    tree = ast.parse(source)
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    found = {}
    for owner in (node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)):
        methods = {node.name: node for node in owner.body if isinstance(node, ast.FunctionDef)}
        called = {
            name
            for constructor in ("__init__", "__post_init__")
            if constructor in methods
            for name in _called(methods[constructor], functions, methods, {constructor})
        }
        if works := {name for name in called if name in WORK or name == "@" or name.startswith("np.")}:
            found[owner.name] = works
    return found


def _called(
    function: ast.FunctionDef,
    functions: dict[str, ast.FunctionDef],
    methods: dict[str, ast.FunctionDef],
    seen: set[str],
) -> set[str]:
    """Return the last names of what a function calls, and what the functions and methods of the same file call."""
    names = {"@" for node in ast.walk(function) if isinstance(getattr(node, "op", None), ast.MatMult)}
    for call in (node for node in ast.walk(function) if isinstance(node, ast.Call)):
        called: ast.FunctionDef | None = None
        if isinstance(call.func, ast.Name):
            names.add(call.func.id)
            called = functions.get(call.func.id)
        elif isinstance(call.func, ast.Attribute):
            numpy = ast.unparse(call.func).startswith("np.") and call.func.attr not in MADE
            names.add(ast.unparse(call.func) if numpy else call.func.attr)
            if isinstance(call.func.value, ast.Name) and call.func.value.id == "self":
                called = methods.get(call.func.attr)
        if called is not None and called.name not in seen:
            seen.add(called.name)
            names |= _called(called, functions, methods, seen)
    return names


@pytest.mark.parametrize(
    ("body", "works"),
    [
        ("self._file = path.open()", {"open"}),
        ("self._begin()", {"start"}),
        ("self._line = _made()", {"openpty"}),
        ("self._lock = threading.Lock()", set()),
        ("self._places = np.zeros(3)", set()),
        ("self._whole = np.concatenate(path)", {"np.concatenate"}),
        ("self._basis = np.linalg.qr(path)[0]", {"np.linalg.qr"}),
        ("self._fitted = path.T @ path", {"@"}),
    ],
)
def test_a_constructor_that_works_is_found(body: str, works: set[str]) -> None:
    source = (
        f"class Port:\n    def __init__(self, path):\n        {body}\n"
        "    def _begin(self):\n        self._thread.start()\n"
        "def _made():\n    return os.openpty()\n"
    )
    assert working_constructors(source) == ({"Port": works} if works else {})


def test_no_constructor_works() -> None:
    found = {
        f"{path.relative_to(ROOT)}: {name}": works
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for name, works in working_constructors(path.read_text(encoding="utf-8")).items()
    }
    assert found == {}
