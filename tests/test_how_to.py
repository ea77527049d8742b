"""The pages of docs/how-to that add a driver, followed to the letter in a copy of the tree."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq
import pytest

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent
FOLDERS = ("rigs", "daq", "analysis", "docs", "tests/daq/protocol", "tests/support")
FILES = ("pyproject.toml", "tests/__init__.py", "README.md", "CONTRIBUTING.md", "tests/test_docs.py")


@dataclass(frozen=True)
class Page:
    """A page, and the driver that it adds: its interface, its stream and the samples that a second brings at least."""

    name: str
    interface: str
    stream: str
    least_hz: float

    def blocks(self, language: str) -> list[str]:
        text = (ROOT / "docs" / "how-to" / self.name).read_text(encoding="utf-8")
        return re.findall(rf"^```{language}\n(.*?)^```", text, re.S | re.M)


PAGES = [
    Page("add-a-gauge.md", "example_dial", "g1", 10.0),
    Page("add-a-robot-interface.md", "example_arm", "robot", 200.0),
]


def _run(tree: Path, *command: str, timeout_s: float = 100) -> subprocess.CompletedProcess[str]:
    """Run a command of the environment on the code of this tree."""
    env = os.environ | {"PYTHONPATH": str(tree), "XDG_RUNTIME_DIR": str(tree), "PATH": f"{BIN}:{os.environ['PATH']}"}
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=tree, env=env, timeout=timeout_s)


def _edited(text: str, lines: list[str]) -> str:
    """Text with the lines of a diff in it: each + goes below the line before it, each - goes."""
    at = 0
    for line in lines:
        mark, wanted = line[:1], line[1:] + "\n"
        if mark == "+":
            text = text[:at] + wanted + text[at:]
            at += len(wanted)
            continue
        assert text.count(wanted, at) == 1, f"{wanted!r} stands there {text.count(wanted, at)} times"
        begin = text.index(wanted, at)
        at = begin + len(wanted)
        if mark == "-":
            text, at = text[:begin] + text[at:], begin
    return text


@pytest.fixture(scope="module", params=PAGES, ids=lambda page: page.interface)
def grown(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Page, Path]:
    """A copy of the tree with the example's files in their places, and named where the page names it."""
    page: Page = request.param
    tree = tmp_path_factory.mktemp(page.interface)
    for name in FOLDERS:
        shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in FILES:
        shutil.copy(ROOT / name, tree / name)
    (copy,) = (block for block in page.blocks("sh") if block.startswith("cp "))
    assert _run(tree, "bash", "-ec", copy).returncode == 0
    for block in page.blocks("diff"):
        header, *lines = block.splitlines()
        path = tree / header.removeprefix("+++ ")
        path.write_text(_edited(path.read_text(encoding="utf-8"), lines), encoding="utf-8")
    return page, tree


def test_the_new_driver_passes_the_checks_of_style_and_types(grown: tuple[Page, Path]) -> None:
    page, tree = grown
    files = sorted(
        str(path.relative_to(tree)) for path in tree.glob(f"*/**/*{page.interface}.py") if "docs" not in path.parts
    )
    assert len(files) == 3
    named = [block.splitlines()[0].removeprefix("+++ ") for block in page.blocks("diff")]
    files += [name for name in named if name.endswith(".py")]
    for check in (("ruff", "check"), ("ruff", "format", "--check")):
        done = _run(tree, *check, *files)
        assert done.returncode == 0, done.stdout + done.stderr
    done = _run(tree, "mypy", *(name for name in files if not name.startswith("tests/")), timeout_s=300)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_new_driver_keeps_the_contract_of_every_driver(grown: tuple[Page, Path]) -> None:
    page, tree = grown
    chosen = f"{page.interface.split('_')[1]} or every_driver or gauges_names_no_other"
    tests = ("tests/daq/protocol", "tests/test_docs.py::test_the_table_of_gauges_names_no_other")
    done = _run(tree, sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", chosen, *tests)
    assert done.returncode == 0, done.stdout + done.stderr
    assert int(re.findall(r"(\d+) passed", done.stdout)[0]) >= 10


@pytest.mark.timeout(180)
def test_the_commands_of_the_page_record_with_the_new_driver(grown: tuple[Page, Path]) -> None:
    page, tree = grown
    (commands,) = (block for block in page.blocks("sh") if "rigd " in block)
    # What waits in vain is ended, and the emulated cell and the daemon with it.
    script = f"trap 'kill $(jobs -p) 2> /dev/null' EXIT\n{commands}\nwait"
    done = _run(tree, "timeout", "120", "bash", "-c", script, timeout_s=150)
    assert ": whole\n" in done.stdout, done.stdout + done.stderr
    assert page.interface in done.stdout
    (run,) = tree.glob("*/runs/*_first")
    samples = sum(pq.read_metadata(chunk).num_rows for chunk in run.glob(f"{page.stream}-*.parquet"))
    assert samples > page.least_hz, "in three seconds"
    faults = [row for chunk in run.glob("faults-*.parquet") for row in pq.read_table(chunk).to_pylist()]
    assert [fault for fault in faults if fault["stream"] in (page.stream, "g2")] == []
