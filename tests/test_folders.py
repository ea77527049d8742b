"""Where files belong: folders of modules are packages, tests mirror the packages, and what tests may import.

What the packages may import of each other, import-linter checks (`tool.importlinter` in pyproject.toml).
"""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("rigs", "daq", "analysis")
TESTS = ROOT / "tests"


def test_every_folder_of_modules_is_a_package() -> None:
    """The contracts do not see the modules of a folder without `__init__.py`."""
    folders = {file.parent for package in PACKAGES for file in (ROOT / package).rglob("*.py")}
    assert [folder for folder in sorted(folders) if not (folder / "__init__.py").exists()] == []


def test_the_tests_of_a_package_lie_in_folders_named_as_its_own() -> None:
    folders = {folder.relative_to(TESTS) for package in PACKAGES for folder in (TESTS / package).glob("*/")}
    assert [folder for folder in sorted(folders) if folder.name[0] != "_" and not (ROOT / folder).is_dir()] == []


def _imported(file: Path) -> set[str]:
    """The modules that a file imports, names that it takes from a package as modules of it."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found


def _importing(folder: Path, *forbidden: str, below: tuple[str, ...] = ()) -> list[str]:
    """The files of a folder that import a module below one of those forbidden; `below` are folders left out."""
    files = [file for file in sorted(folder.rglob("*.py")) if file.relative_to(ROOT).parts[1] not in below]
    assert len(files) > 10
    return [
        str(file.relative_to(ROOT))
        for file in files
        if any(module.startswith(f"{name}.") for module in _imported(file) for name in forbidden)
    ]


def test_an_ordinary_test_imports_no_trial() -> None:
    assert _importing(TESTS, "tests.trials", below=("trials",)) == []


def test_a_world_knows_neither_fixtures_nor_trials() -> None:
    """It judges rig: what it shared with the tests of rig, it would be wrong about in the same way."""
    assert _importing(TESTS / "worlds", "tests.support", "tests.trials", "tests.analysis", "tests.daq") == []


def test_the_product_imports_no_test() -> None:
    assert [name for package in PACKAGES for name in _importing(ROOT / package, "tests", "scripts")] == []
