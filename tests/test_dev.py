import gzip
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from scripts.tools import mutants as program
from scripts.tools.plotting_script import TEMPLATES, made
from tests.support.durations import Durations
from tests.support.mutants import mutants_of

ROOT = Path(__file__).parents[1]
ENTRY = ROOT / "scripts" / "dev"
FILES = {file.stem: file for file in (ROOT / "scripts" / "tools").glob("[!_]*.py")}
FILES |= {file.parent.name: file for file in (ROOT / "tests" / "trials").glob("*/__main__.py")}
FILES |= {file.stem: file for file in (ROOT / "tests" / "trials").glob("[!_]*.py") if not file.stem.startswith("test_")}
LOCKED = {"booted", *(file.stem for file in (ROOT / "tests" / "trials").glob("*.lock"))}
PROGRAMS = sorted(FILES)


def _dev(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([ENTRY, *arguments], capture_output=True, text=True, check=False)


def test_without_a_name_each_program_is_listed_with_one_sentence():
    done = _dev()
    assert done.returncode == 0, done.stderr
    rows = [line.split(maxsplit=1) for line in done.stdout.splitlines()]
    assert sorted(name for name, _ in rows) == PROGRAMS
    assert all(len(words) > 20 and words.endswith(".") for _, words in rows), rows


@pytest.mark.parametrize("name", ["nothing", "../trials/pace"])
def test_unknown_program_is_refused_with_the_available_names(name):
    done = _dev(name)
    assert done.returncode == 2
    assert repr(name) in done.stderr
    assert sorted(line.split()[0] for line in done.stdout.splitlines()) == PROGRAMS


@pytest.mark.parametrize("name", [name for name in PROGRAMS if not name.endswith("_page") and name not in LOCKED])
def test_each_program_starts(name, monkeypatch, capsys):
    """Excludes programs that need other packages or root, and those that write pages, which test_docs runs."""
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    try:
        runpy.run_path(str(FILES[name]), run_name="__main__")
    except SystemExit as end:
        assert not end.code
    assert capsys.readouterr().out


def test_mutant_is_found_by_its_test_and_the_file_restored(tmp_path):
    (tmp_path / "rigs").mkdir()
    (tmp_path / "rigs" / "__init__.py").touch()
    (tmp_path / "tests" / "rigs").mkdir(parents=True)
    module, text = tmp_path / "rigs" / "sums.py", "def added(a, b):\n    return a + b\n"
    module.write_text(text)
    (tmp_path / "pytest.ini").write_text("[pytest]\naddopts = --import-mode=importlib\n")
    (mutant,) = (one for one in mutants_of(text, "rigs/sums.py") if one.kind == "operator swapped")
    own = "tests/rigs/test_sums.py"
    for number, found in ((0, {"by": "", "test": ""}), (1, {"by": "commit", "test": f"{own}::test_it"})):
        asserted = f"from rigs.sums import added\ndef test_it():\n    assert added(1, {number}) == {1 + number}\n"
        (tmp_path / own).write_text(asserted)
        assert program.looked_for(mutant, tmp_path, Durations(), 60.0, night=False) == found
        assert module.read_text() == text
    assert "1 mutants, 1" in program.counted([{**mutant.to_dict(), "by": "commit"}])


def test_the_script_and_its_licence_are_those_that_the_command_makes():
    files = made()
    script = gzip.decompress((TEMPLATES / "plotly.min.js.gz").read_bytes())
    assert script == gzip.decompress(files["plotly.min.js.gz"])
    assert (TEMPLATES / "plotly.txt").read_bytes() == files["plotly.txt"]
    assert b"plotly.js v" in script[:300]
    assert "MIT" in files["plotly.txt"].decode()
