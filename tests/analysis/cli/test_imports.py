import json
import os
import sys
from functools import cache
from pathlib import Path

import pytest

from tests.support.command_line import separately
from tests.support.dated_runs import dated_run

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
HELP = {"typer", "annotated_doc", "shellingham"}
"""Packages imported for the help: typer without rich, whose layout took half of the time."""
MOST_FOR_HELP = 160
"""Number of modules that the help may import, 138 in November 2026, 110 of them by `import typer`. With rich it was
270, and more than twice the processor time."""
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
    done = separately(sys.executable, "-c", _PRINT, *words)
    modules = json.loads(done.stderr.rpartition("modules ")[2])
    assert "analysis.cli" in modules and done.returncode == 0, done.stderr
    return modules


modules_of = cache(imported_by)
"""The same of a command that does the same each time."""


def packages(modules: list[str]) -> set[str]:
    found = {module.partition(".")[0] for module in modules}
    return {name for name in found if name not in sys.stdlib_module_names and not name.startswith(("_", "cython"))}


def test_help_imports_nothing_that_works():
    modules = modules_of("--help")
    assert packages(modules) <= HELP | OURS and len(modules) <= MOST_FOR_HELP
    assert "importlib.metadata" not in modules  # no search for plugins
    ours = {module for module in modules if module.partition(".")[0] in OURS}
    below = {module for module in ours if not module.startswith("analysis.cli")}
    assert below <= WORDS  # lists of names alone


def test_help_of_a_command_is_laid_out_without_rich():
    assert "rich" not in packages(modules_of("status", "--help"))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return dated_run(tmp_path_factory.mktemp("runs"), 0, 0.01)


def test_runs_command_imports_only_readers_of_manifests(run):
    modules = modules_of("runs", run.parent)
    assert packages(modules) <= READING | OURS | {"daq"}
    works = {
        module
        for module in modules
        if module.startswith(("analysis.procedures", "analysis.runs", "analysis.robot.predict"))
    }
    assert works <= WORDS


@pytest.mark.parametrize("words", ["analyse", "analyse --json", "analyse --lines"])
def test_analyse_imports_only_the_evaluation(words, run):
    modules = modules_of(*words.split(), run)
    assert packages(modules) <= READING | OURS | {"daq"}  # no scipy, no pandas, no matplotlib
    rings = {module.split(".")[1] for module in modules if module.startswith("analysis.")}
    assert not rings & {"diagnosis", "correction"}
    assert {module.split(".")[2] for module in modules if module.startswith("analysis.apps.")} == {"report"}


def test_plant_commands_import_no_evaluation(run, tmp_path):
    words = ["fleet", run.parent, "--jobs", "1", "--catalogue", tmp_path / "catalogue.sqlite"]
    assert "scipy" in packages(imported_by(*words))  # its play is fitted
    assert packages(imported_by(*words)) <= READING | OURS | {"daq"}


def test_who_asks_the_daemon_imports_nothing_that_computes():
    code = "import sys, daq.service.client, analysis.cli.listings; print(*sys.modules)"
    modules = separately(sys.executable, "-c", code).stdout.split()
    assert "daq" in packages(modules) and "numpy" not in packages(modules)
    assert not [name for name in modules if name.startswith(("rigs.rig", "rigs.effects", "daq.protocol", "daq.store"))]


_SHOW_THREADS = """
import sys
from analysis.cli import main
assert "numpy" not in sys.modules, "numpy reads its threads as it loads"
try:
    main()
except SystemExit:
    import os
    print("threads", os.environ["OPENBLAS_NUM_THREADS"])
"""


@pytest.mark.parametrize(("asked", "used"), [(None, "1"), ("2", "2")])
def test_one_thread_unless_asked(asked, used):
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    if asked:
        environment["OPENBLAS_NUM_THREADS"] = asked
    done = separately(sys.executable, "-c", _SHOW_THREADS, "--help", env=environment)
    assert f"threads {used}" in done.stdout
