"""`scripts/tools/folder_cycles.py`: it finds folders that import each other, and finds none in the product."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("rigs", "daq", "analysis")


def _count(directory: Path, package: str) -> subprocess.CompletedProcess[str]:
    script = ROOT / "scripts" / "tools" / "folder_cycles.py"
    return subprocess.run([sys.executable, script, package], cwd=directory, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("package", PACKAGES)
def test_the_folders_form_no_cycle(package: str) -> None:
    done = _count(ROOT, package)
    assert (done.returncode, done.stdout) == (0, f"{package}: 0 import cycles between folders\n"), done.stderr


def test_every_folder_of_modules_is_a_package() -> None:
    """Neither the contracts nor the count of cycles sees the modules of a folder without `__init__.py`."""
    folders = {file.parent for package in PACKAGES for file in (ROOT / package).rglob("*.py")}
    assert [folder for folder in sorted(folders) if not (folder / "__init__.py").exists()] == []


def test_the_tests_of_a_package_lie_in_folders_named_as_its_own() -> None:
    folders = {
        folder.relative_to(ROOT / "tests") for package in PACKAGES for folder in (ROOT / "tests" / package).glob("*/")
    }
    assert [folder for folder in sorted(folders) if folder.name[0] != "_" and not (ROOT / folder).is_dir()] == []


def test_folders_that_import_each_other_through_a_third_are_one_cycle(tmp_path: Path) -> None:
    imports = {"low/a": "", "low/b": "from cell.low import a", "mid/c": "from cell.low import b"}
    imports |= {
        "top/d": "from cell.mid import c",
        "low/e": "from cell.top import d",
        "beside/f": "from cell.low import e",
    }
    for module, text in imports.items():
        path = tmp_path / "cell" / f"{module}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        (path.parent / "__init__.py").touch()
    (tmp_path / "cell" / "__init__.py").touch()
    done = _count(tmp_path, "cell")
    expected = "cell: 1 import cycles between folders\n  3 folders: cell.low, cell.mid, cell.top\n"
    assert (done.returncode, done.stdout) == (1, expected), done.stderr
