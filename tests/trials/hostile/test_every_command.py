"""Every command with hostile names: in the rig file, the run, the path, in what is asked. None reaches a terminal.

A command that is added needs a case here, or the walk fails.
"""

import json
import os
import re
import shlex
import shutil
import stat
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import pytest
import typer
import yaml

from analysis import cli
from rigs.load import SHIPPED
from tests.support.command_line import all_imported, ended, ran
from tests.support.second_sources import SOURCES, Chain
from tests.support.store_cases import edit_manifest, ledger_records, put_ledger

EVIL = "a\x1b]0;owned\x07\x1b[31m$\\frac{$[/bold]\nrun: whole\r\u202e{{7*7}}<script>"
"""A title for the terminal, a colour, broken mathematics, markup, a forged line, reversed reading, a template, HTML."""
BYTES = os.fsdecode(b"\xff\xfe")
"""In a file's name: no UTF-8."""
TESTS = ("yaw", "radial")
CASES: dict[str, list[str]] = {}
"""Arguments of the calls of each command; each {name} is explained by `called`."""
for _line in (Path(__file__).parent / "every_command.txt").read_text(encoding="ascii").splitlines():
    CASES.setdefault(_line.partition(":")[0], []).append(_line.partition(":")[2])


def hostile_rig() -> str:
    data = yaml.safe_load((SHIPPED / "ur10e-cell.yaml").read_text())
    data["description"] = data["robot"]["name"] = EVIL
    for axis in data["robot"]["axes"]:
        axis["name"] += EVIL
    return yaml.safe_dump(data)


def hostile_urdf(folder: Path) -> Path:
    chain = SOURCES["kuka-kr-6-r900-2"]["geometry"]
    assert isinstance(chain, Chain)
    carried = "".join(char for char in EVIL if char >= " " or char in "\n\r")
    name = escape(carried, {'"': "&quot;", "\n": "&#10;", "\r": "&#13;"})
    file = folder / (EVIL.replace("/", "|") + BYTES)
    text = re.sub(r'(?<=")((?:joint|link)_[1-6])(?=")', lambda found: found[1] + name, chain.urdf())
    file.write_text(text, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hostile") / (EVIL.replace("/", "|") + BYTES)
    folder.mkdir()
    (folder / "rig.yaml").write_text(hostile_rig(), encoding="utf-8")
    for test in TESTS:
        options = ("--direction", "acw") if test == "yaw" else ()
        done = ran("simulate", folder / "rig.yaml", "--test", test, "-o", folder / test, *options)
        assert done.returncode == 0, done.stderr
    for run in runs(folder):
        edit_manifest(run, {"operator": EVIL, "host": EVIL, "software": {EVIL: EVIL}, "follows": EVIL})
        put_ledger(run, [_with_reason(record) for record in ledger_records(run)])
    return folder


def _with_reason(record: dict[str, Any]) -> dict[str, Any]:
    return {"seal": record["seal"] | {"reason": EVIL}} if "seal" in record else record


def runs(folder: Path) -> list[Path]:
    return sorted(path.parent for test in TESTS for path in (folder / test).rglob("manifest.json"))


@pytest.fixture
def peer(tmp_path, monkeypatch):
    from tests.support.hostile_peers import hostile_journal, hostile_peer  # noqa: PLC0415

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("PATH", f"{hostile_journal(tmp_path, EVIL)}:{os.environ['PATH']}")
    with hostile_peer(tmp_path / "rigd" / "ur10e.sock", EVIL):
        yield


def touches_of_two_arms(folder: Path) -> Path:
    """A table of two arms with a hostile socket in each row, in a file of a hostile name."""
    table = folder / (EVIL.replace("/", "|") + ".csv")
    names = [f"{letter}{axis}_deg" for letter in "qp" for axis in range(1, 7)]
    socket = EVIL.replace(",", " ").replace("\n", " ").replace("\r", " ")
    rows = [",".join([socket, *(str(17 * row * axis % 170) for axis in range(1, 13))]) for row in range(1, 15)]
    table.write_text("\n".join([",".join(["socket", *names]), *rows]) + "\n", encoding="utf-8")
    return table


def called(words: str, cell: Path, own: Path) -> list[str]:
    """Arguments of a line of CASES for a cell, in a directory of the test's own."""
    name = EVIL.replace("/", "|")
    made: dict[str, Callable[[], str | Path]] = {
        "{copied_rig}": lambda: shutil.copy(cell / "rig.yaml", own / (name + BYTES)),
        "{copied_run}": lambda: shutil.copytree(runs(cell)[0], own / (name + BYTES)),
        "{touches}": lambda: touches_of_two_arms(own.parent),
        "{urdf}": lambda: hostile_urdf(own),
        "{kept_session}": lambda: _kept_session(own / (name + BYTES)),
    }
    plain = {"rig": cell / "rig.yaml", "first": runs(cell)[0], "evil": EVIL, "name": name, "bytes": BYTES}
    found = []
    for word in shlex.split(words):
        if word == "{runs}":
            found += map(str, runs(cell))
        else:
            make = made.get(word)
            found.append(str(make()) if make else word.format(cell=cell, own=own, **plain))
    return found


def _kept_session(directory: Path) -> Path:
    directory.mkdir()
    text = json.dumps({"version": 1, "rig": EVIL, "rig_file": EVIL, "aim": EVIL, EVIL: [EVIL]})
    (directory / "session.yaml").write_text(text, encoding="utf-8")
    return directory


def commands(group: Any, above: str = "") -> Iterator[str]:
    """The name of each command of the program."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, f"{above}{name} ")
        else:
            yield f"{above}{name}"


def test_every_command_has_a_case():
    assert set(commands(all_imported())) == set(CASES)


@pytest.mark.usefixtures("peer")
@pytest.mark.parametrize("command", CASES)
def test_commands_print_only_printable_text(command, cell, tmp_path, monkeypatch):
    own = tmp_path / "own"
    own.mkdir()
    monkeypatch.chdir(own)
    for words in CASES[command]:
        arguments = called(words, cell, own)
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            done = ran(*command.split(), *arguments, typed=f"{EVIL}\nquit\n")
        assert not [str(w.message) for w in warned if issubclass(w.category, UserWarning)]  # only lines
        code, out, err = done.returncode, done.stdout, done.stderr
        assert code in (0, 1, 2, 3, 4), (arguments, err)
        for line in (out + err).split("\n"):
            assert line.isprintable(), (arguments, line)
            assert line.strip() != "run: whole", (arguments, "a name forged a line")
        if code > 1 and command != "verify":  # which lists what is wrong
            assert all(line.startswith(("error: ", '{"error": ')) for line in err.splitlines()), err
    for file in own.rglob("*"):
        if stat.S_ISREG(file.stat().st_mode) and file.suffix in (".html", ".csv", ".txt"):
            text = file.read_text(encoding="utf-8")
            assert all(line.isprintable() for line in text.splitlines()), file
            assert file.suffix != ".html" or "<script>" not in text


def test_a_terminal_gets_colours_of_ours_alone(cell, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    done = ran("analyse", *runs(cell))
    assert done.returncode == 0 and "\x1b]" not in done.stdout and "\x07" not in done.stdout


def test_pictures_show_dollar_signs_literally(tmp_path):
    from analysis.apps.report.chart import Sheet  # noqa: PLC0415

    sheet = Sheet(3, 2)
    axes = sheet.subplots()
    axes.plot([0, 1], label=f"{EVIL}\udcff 机")
    axes.set_title(EVIL)
    axes.legend(title="$\\frac{$")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sheet.savefig(tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 1000


def test_typer_is_asked_for_no_frame(capsys, monkeypatch):
    app = typer.Typer()
    app.command()(lambda: (_ for _ in ()).throw(typer.BadParameter(EVIL)))
    monkeypatch.setattr(cli, "app", app)
    code = ended()
    (line,) = capsys.readouterr().err.splitlines()
    assert code == 2 and line.startswith("error: ") and ": Invalid value: " in line and line.isprintable()
