"""`dev/folder_cycles.py`: it finds folders that import each other, and finds none in daq."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def _count(directory: Path, package: str) -> subprocess.CompletedProcess[str]:
    script = ROOT / "dev" / "folder_cycles.py"
    return subprocess.run([sys.executable, script, package], cwd=directory, capture_output=True, text=True, check=False)


def test_the_folders_of_daq_form_no_cycle() -> None:
    done = _count(ROOT, "daq")
    assert (done.returncode, done.stdout) == (0, "daq: 0 import cycles between folders\n"), done.stderr


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
