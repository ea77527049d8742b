"""What a command imports before it works: the packages that it needs and no other, since imports are most of the time
that a person waits for a small run."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from tests.support.dated_runs import dated_run

RUN_WRITER = Path(__file__).parents[2] / "support" / "synthetic_run.py"
_PRINT = """
import json, sys
before = set(sys.modules)
from analysis.cli import main
try:
    main()
finally:
    sys.stderr.write("modules " + json.dumps(sorted(set(sys.modules) - before)))
"""
TYPER = {"typer", "annotated_doc", "rich", "shellingham", "click"}
HELP = TYPER | {"markdown_it", "mdurl", "pygments", "attr"}
"""Packages imported for laying out the help."""
RIG_FILE = {"pydantic", "pydantic_core", "annotated_types", "typing_extensions", "typing_inspection", "yaml", "_yaml"}
READING = TYPER | RIG_FILE | {"numpy", "pyarrow", "cloudpickle", "markupsafe"}
"""Packages imported for reading tables, and for the pictures of an answer. pyarrow imports cloudpickle if installed,
for example with Dask."""
OURS = {"analysis", "rigs"}
WORDS = {
    *("analysis", "rigs", "rigs.distribution", "rigs.errors", "rigs.schema", "rigs.schema.part"),
    *("rigs.signals", "rigs.text"),
}
"""What every command imports of rig: the words that its options take, its errors."""


def imported_by(*words: str | Path) -> list[str]:
    """The modules that a command imports, in a process of its own."""
    done = subprocess.run([sys.executable, "-c", _PRINT, *words], capture_output=True, text=True, check=False)
    modules: list[str] = json.loads(done.stderr.rpartition("modules ")[2])
    assert "analysis.cli" in modules and done.returncode == 0, done.stderr
    return modules


modules_of = cache(imported_by)
"""The same of a command that does the same each time."""


def packages(modules: list[str]) -> set[str]:
    """The packages that are neither of Python nor modules built by a compiler for one of them."""
    found = {module.partition(".")[0] for module in modules}
    return {name for name in found if name not in sys.stdlib_module_names and not name.startswith(("_", "cython"))}


def test_help_imports_nothing_that_works() -> None:
    modules = modules_of("--help")
    assert packages(modules) <= HELP | OURS
    ours = {module for module in modules if module.partition(".")[0] in OURS}
    below = {module for module in ours if not module.startswith("analysis.cli")}
    assert below <= WORDS  # lists of names alone


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dated_run(tmp_path_factory.mktemp("runs"), 0, 0.01)


def test_runs_command_imports_only_readers_of_manifests(run: Path) -> None:
    modules = modules_of("runs", run.parent)
    assert packages(modules) <= READING | OURS | {"daq"}
    works = {
        module
        for module in modules
        if module.startswith(("analysis.procedures", "analysis.runs", "analysis.robot.model"))
    }
    assert works <= WORDS


@pytest.mark.parametrize("words", [["analyse"], ["analyse", "--json"], ["analyse", "--lines"]])
def test_analyse_imports_only_the_evaluation(words: list[str], run: Path) -> None:
    modules = modules_of(*words, run)
    assert packages(modules) <= READING | OURS | {"daq"}  # no scipy, no pandas, no matplotlib
    rings = {module.split(".")[1] for module in modules if module.startswith("analysis.")}
    assert not rings & {"diagnosis", "correction"}
    assert {module.split(".")[2] for module in modules if module.startswith("analysis.apps.")} == {"report"}


def test_figures_of_a_run_without_text_need_no_event_loop_and_no_functions_of_pyarrow(tmp_path: Path) -> None:
    writer = [sys.executable, str(RUN_WRITER), str(tmp_path), "10000"]
    recorded = subprocess.run(writer, capture_output=True, text=True, check=True).stdout.strip()
    assert not {"asyncio", "pyarrow.compute"} & set(imported_by("analyse", "--json", recorded))


def test_figures_for_a_script_import_nothing_that_draws(run: Path) -> None:
    assert "rich" in packages(modules_of("analyse", run))  # it lays out the table
    assert "rich" not in packages(modules_of("analyse", "--json", run))


def test_plant_commands_import_no_evaluation(run: Path, tmp_path: Path) -> None:
    words = ["fleet", run.parent, "--jobs", "1", "--catalogue", tmp_path / "catalogue.sqlite"]
    assert "scipy" in packages(imported_by(*words))  # its play is fitted
    assert packages(imported_by(*words)) <= READING | OURS | {"daq"}


def test_help_of_a_command_imports_no_more(run: Path) -> None:
    assert packages(modules_of("analyse", "--help")) <= HELP | OURS
    assert "pydantic" in packages(modules_of("analyse", run))  # it reads the rig file


def test_who_asks_the_daemon_imports_nothing_that_computes() -> None:
    code = "import sys, daq.service.client, analysis.cli.daemon_screen; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    modules = done.stdout.split()
    assert "numpy" not in packages(modules)
    assert not [name for name in modules if name.startswith(("rigs.rig", "rigs.effects", "daq.protocol", "daq.store"))]
