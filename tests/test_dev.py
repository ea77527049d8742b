"""`scripts/dev`: the one entry to what only developers run, and the links that stand for its programs."""

import runpy
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ENTRY = ROOT / "scripts" / "dev"
FILES = {file.stem: file for file in (ROOT / "scripts" / "tools").glob("[!_]*.py")}
FILES |= {file.parent.name: file for file in (ROOT / "tests" / "trials").glob("*/__main__.py")}
FILES |= {file.stem: file for file in (ROOT / "tests" / "trials").glob("[!_]*.py") if not file.stem.startswith("test_")}
LOCKED = {file.stem for file in (ROOT / "tests" / "trials").glob("*.lock")}
PROGRAMS = sorted(FILES)
LINKS = sorted(path for path in (ROOT / "scripts").iterdir() if path.is_symlink())


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


@pytest.mark.parametrize("name", sorted({*PROGRAMS} - {"booted"} - LOCKED))
def test_each_program_starts(name, monkeypatch, capsys):
    """Excludes programs that require additional packages or root."""
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    try:
        runpy.run_path(str(FILES[name]), run_name="__main__")
    except SystemExit as end:
        assert not end.code
    assert capsys.readouterr().out


def test_there_are_links():
    assert LINKS


@pytest.mark.parametrize("link", LINKS, ids=lambda link: link.name)
def test_each_link_is_the_entry_under_the_name_of_a_program(link):
    assert link.resolve() == ENTRY
    assert link.name in PROGRAMS


def test_each_lock_belongs_to_a_program():
    assert set(PROGRAMS) >= LOCKED
