"""Count maintenance costs of the code: lines, helpers used once, uninformative names, import cycles, named makers.

A number may decrease freely; tests/test_house.py contains the upper limit of each. Apps are the folders `analysis/apps`
and `daq/apps`; everything else is the core.
"""

from __future__ import annotations

import ast
import collections
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("rigs", "daq", "analysis")
EMPTY = frozenset(
    {"one", "found", "own", "told", "left", "known", "held", "there", "here", "some", "given", "wanted", "worth"}
    | {"what", "said", "more", "rest", "them", "same", "other", "like", "alone", "beside"}
)
"""Uninformative names."""
MAKERS = {
    "ur": r"\bur\b|\bur_|_ur\b|\bURs?\b|URScript|URRTDE|Universal Robots",
    "fanuc": r"(?i:(?<!paper-)fanuc)",
    "kuka": r"(?i:kuka)|\bKRL\b",
    "abb": r"\bABB|\babb\b|\babb_|\bRAPID\b",
    "yaskawa": r"(?i:yaskawa|motoman)|\bINFORM\b",
}
"""Patterns for the name of each maker. The names of the rig paper-fanuc and of arms such as ur10e do not count."""

TESTS = ("yaw", "roll", "radial", "repeatability", "pose", "touch", "path")
OTHER_WORDS = {
    "yaw": ("apps/interchange/driver_kinematics", "intake/column_groups"),  # rotations
    "roll": ("apps/interchange/driver_kinematics", "intake/column_groups"),
    "repeatability": ("report/listings",),  # data-sheet value of an arm
    # Other meanings: a word of URScript, of foreign headers, of stops at the cube, along an axis, and of a program
    # name.
    "pose": (
        *("apps/makers/ur/driver", "intake/column_groups", "intake/cube_stops"),
        *("report/run_pictures", "report/run_charts", "apps/makers/programs/planned"),
    ),
    # Other meanings: of a file or a page; the column of a curve.
    "path": (
        *("apps/makers/report/correction_report", "report/listings", "apps/window/guard"),
        "procedures/shared/result_curves",
    ),
}
"""Files of `analysis` in which the name of a test has another meaning."""


@cache
def sources() -> dict[str, ast.Module]:
    """Return the syntax tree of each file of the product, by its path below the root."""
    files = [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]
    return {str(file.relative_to(ROOT)): ast.parse(file.read_text(encoding="utf-8")) for file in files}


@cache
def nodes_of(tree: ast.Module) -> tuple[ast.AST, ...]:
    """Return all nodes of a file, cached because walking all files takes longer than the search itself."""
    return tuple(ast.walk(tree))


def counts() -> dict[str, int]:
    """Return all counts by name."""
    texts = [(ROOT / name).read_text(encoding="utf-8") for name in sources()]
    functions, once = _functions()
    return {
        "core lines": sum(text.count("\n") for name, text in zip(sources(), texts, strict=True) if not _is_app(name)),
        "product lines": sum(text.count("\n") for text in texts),
        "product files": len(texts),
        "private functions used once, per mille": round(1000 * once / len(functions)),
        "isinstance of a table": sum(len(re.findall(r"isinstance\([^)]*Table", text)) for text in texts),
        "names that say nothing": sum(name in EMPTY for name in _bindings()),
        "circles of modules": len(circles()),
        "files that name one test kind": max(len(files_that_name_kind(test)) for test in TESTS),
        "files that name one maker": max(len(files_that_name(maker)) for maker in MAKERS),
        "suppressions": sum(text.count("# noqa") + text.count("# type: ignore") for text in texts),
        "lines of the longest file": max(text.count("\n") for text in texts),
    }


def _is_app(name: str) -> bool:
    return name.split("/")[1] == "apps"


def _functions() -> tuple[list[int], int]:
    """Return the length of each function in lines, and the number of private functions used at a single place of
    their file.
    """
    lengths, once = [], 0
    for tree in sources().values():
        uses = collections.Counter(
            node.id if isinstance(node, ast.Name) else node.attr
            for node in nodes_of(tree)
            if isinstance(node, ast.Name | ast.Attribute)
        )
        for node in nodes_of(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lengths.append((node.end_lineno or node.lineno) - node.lineno + 1)
                once += node.name.startswith("_") and not node.name.startswith("__") and uses[node.name] == 1
    return lengths, once


def _bindings() -> Iterator[str]:
    for tree in sources().values():
        for node in nodes_of(tree):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                yield node.id
            elif isinstance(node, ast.arg):
                yield node.arg


def circles() -> list[list[str]]:
    """Return each group of modules that import each other in a cycle, including imports within functions but not
    imports for type checking only.
    """
    modules = {_module(name) for name in sources()}
    graph = {_module(name): _imports(tree, modules) for name, tree in sources().items()}
    reach: dict[str, set[str]] = {}
    for module in graph:
        seen: set[str] = set()
        todo = [module]
        while todo:
            for imported in graph.get(todo.pop(), ()):
                if imported not in seen:
                    seen.add(imported)
                    todo.append(imported)
        reach[module] = seen
    groups = {tuple(sorted(other for other in reach[m] if m in reach.get(other, ()))) for m in graph if m in reach[m]}
    return sorted(map(list, groups))


def _module(name: str) -> str:
    return name.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def _imports(tree: ast.Module, modules: set[str]) -> set[str]:
    """Return the imported modules among `modules` at run time; for an import from a package only the imported
    submodule.
    """
    imported: set[str] = set()
    for node in _that_run(tree):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            imported |= (names & modules) or {node.module}
        elif isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
    return imported & modules


def files_that_name(maker: str) -> list[str]:
    """Return the files that name a maker in code, outside of the maker's own files.

    Docstrings are ignored, because they state sources. A maker's own files are its folder and files named after it,
    such as the driver of its interface.
    """
    name = re.compile(MAKERS[maker])
    return [
        file
        for file, words in _words().items()
        if f"/{maker}/" not in file
        and not Path(file).name.startswith(f"{maker}_")
        and any(name.search(word) for word in words)
    ]


def files_that_name_kind(test: str) -> list[str]:
    """Return the files that name a kind of test, as a word or by its table, outside of its own folder and files
    named after it.
    """
    name, own = re.compile(rf"[\"']{test}[\"']|{test.capitalize()}Table"), re.compile(rf"(^|_){test}(s|es)?(_|$)")
    words = {f"analysis/{file}.py" for file in OTHER_WORDS.get(test, ())}
    others = (
        file
        for file in sources()
        if file not in words and f"/procedures/{test}/" not in file and not own.search(Path(file).stem)
    )
    return [file for file in others if name.search((ROOT / file).read_text(encoding="utf-8"))]


@cache
def _words() -> dict[str, set[str]]:
    """Return the names and texts in each file, excluding docstrings."""
    return {file: set(_words_of(tree)) for file, tree in sources().items()}


def _words_of(tree: ast.Module) -> Iterator[str]:
    docstrings = {id(node.value) for node in nodes_of(tree) if isinstance(node, ast.Expr)}
    for node in nodes_of(tree):
        match node:
            case ast.Constant(value=str(text)) if id(node) not in docstrings:
                yield text
            case ast.Name(id=text) | ast.Attribute(attr=text) | ast.alias(name=text) | ast.ImportFrom(module=str(text)):
                yield text
            case ast.ClassDef(name=text) | ast.FunctionDef(name=text):
                yield text


def _that_run(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield the nodes of a file, excluding those used only by a type checker."""
    skipped = {
        id(below)
        for node in nodes_of(tree)
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        for below in ast.walk(node)
    }
    return (node for node in nodes_of(tree) if id(node) not in skipped)


def sizes() -> dict[str, tuple[int, int]]:
    """Return the lines and files of the core, of the apps, of tests, of trials and of documents."""
    of_apps = [file for file in sources() if _is_app(file)]
    files = {
        "core": sorted(sources().keys() - set(of_apps)),
        "apps": of_apps,
        "tests": sorted((ROOT / "tests").rglob("*.py")),
        "trials": sorted((ROOT / "tests" / "trials").rglob("*.py")),
        "documents": sorted((ROOT / "docs").rglob("*.md")),
    }
    return {
        part: (sum((ROOT / file).read_text(encoding="utf-8").count("\n") for file in names), len(names))
        for part, names in files.items()
    }


def main() -> int:
    """Print all counts, and the import cycles."""
    for part, (lines, count) in sizes().items():
        print(f"{lines:8d}  lines of {part}, in {count} files")
    for name, number in counts().items():
        print(f"{number:8d}  {name}")
    lengths = _functions()[0]
    print(f"{sum(lengths) / len(lengths):8.1f}  lines of a function, mean")
    for maker in MAKERS:
        print(f"  {maker} is named in: {', '.join(files_that_name(maker))}")
    for test in TESTS:
        print(f"  {test} is named in: {', '.join(files_that_name_kind(test))}")
    for circle in circles():
        print(f"  circle: {', '.join(circle)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
