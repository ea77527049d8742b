"""Every command with hostile names: in the rig file, the run, the path, in what is asked. None reaches a terminal.

A command that is added needs a case here, or the walk fails.
"""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import stat
import sys
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
from tests.support.command_line import all_imported, ended
from tests.support.second_sources import SOURCES, Chain
from tests.support.store_cases import edit_manifest, ledger_records, put_ledger

EVIL = "a\x1b]0;owned\x07\x1b[31m$\\frac{$[/bold]\nrun: whole\r\u202e{{7*7}}<script>"
"""A title for the terminal, a colour, broken mathematics, markup, a forged line, reversed reading, a template, HTML."""
BYTES = os.fsdecode(b"\xff\xfe")
"""In a file's name: no UTF-8."""
TESTS = ("yaw", "radial")


def hostile_rig() -> str:
    data = yaml.safe_load((SHIPPED / "ur10e.yaml").read_text())
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


def ran(*arguments: str | Path, typed: str = "") -> tuple[int, str, str]:
    """Exit code and output of a command in this process."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    before = sys.argv, sys.stdin, sys.stdout, sys.stderr
    sys.argv, sys.stdin = ["rig", *map(str, arguments)], io.StringIO(typed)
    sys.stdout, sys.stderr = out, err
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            cli.main()
            code = 0
    except SystemExit as end:
        code = int(end.code or 0)
    finally:
        sys.argv, sys.stdin, sys.stdout, sys.stderr = before
    said = []
    for stream in (out, err):
        stream.flush()
        assert isinstance(stream.buffer, io.BytesIO)
        said.append(stream.buffer.getvalue().decode("utf-8"))
    assert not [w for w in warned if issubclass(w.category, UserWarning)]  # nothing but lines reaches standard error
    return code, said[0], said[1]


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hostile") / (EVIL.replace("/", "|") + BYTES)
    folder.mkdir()
    (folder / "rig.yaml").write_text(hostile_rig(), encoding="utf-8")
    for test in TESTS:
        options = ("--direction", "acw") if test == "yaw" else ()
        code, _, told = ran("simulate", folder / "rig.yaml", "--test", test, "-o", folder / test, *options)
        assert code == 0, told
    for run in runs(folder):
        edit_manifest(run, {"operator": EVIL, "host": EVIL, "software": {EVIL: EVIL}, "follows": EVIL})
        put_ledger(run, [_with_reason(record) for record in ledger_records(run)])
    return folder


def _with_reason(record: dict[str, Any]) -> dict[str, Any]:
    return {"seal": record["seal"] | {"reason": EVIL}} if "seal" in record else record


def runs(folder: Path) -> list[Path]:
    return sorted(path.parent for test in TESTS for path in (folder / test).rglob("manifest.json"))


@pytest.fixture
def peer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    from tests.support.hostile_peers import hostile_journal, hostile_peer  # noqa: PLC0415

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("PATH", f"{hostile_journal(tmp_path, EVIL)}:{os.environ['PATH']}")
    with hostile_peer(tmp_path / "rigd" / "ur10e.sock", EVIL):
        yield


Case = Callable[[Path, Path], list[list[str | Path]]]


def touches_of_two_arms(folder: Path) -> Path:
    """A table of two arms with a hostile socket in each row, in a file of a hostile name."""
    table = folder / (EVIL.replace("/", "|") + ".csv")
    names = [f"{letter}{axis}_deg" for letter in "qp" for axis in range(1, 7)]
    socket = EVIL.replace(",", " ").replace("\n", " ").replace("\r", " ")
    rows = [",".join([socket, *(str(17 * row * axis % 170) for axis in range(1, 13))]) for row in range(1, 15)]
    table.write_text("\n".join([",".join(["socket", *names]), *rows]) + "\n", encoding="utf-8")
    return table


def cases() -> dict[str, Case]:
    """What each command is called with: cell, a directory of the test's own → argument lists."""

    def first(cell: Path) -> Path:
        return runs(cell)[0]

    def of_every_run(*options: str) -> Case:
        return lambda cell, own: [[*runs(cell), *options]]

    return {
        "analyse": lambda cell, own: [
            [*runs(cell), "--plot", own / "plots"],
            [first(cell), "--json"],
            [first(cell), "--truth", cell / "rig.yaml"],
        ],
        "arms": lambda cell, own: [
            [],
            ["--json"],
            [EVIL],
            ["ur10e", "--calibration", cell / "rig.yaml"],
            ["ur10e", "-o", own / (EVIL.replace("/", "|") + BYTES)],
            ["ur10e", "-o", cell / "rig.yaml"],
        ],
        "automatic": of_every_run(),
        "ball fit": lambda cell, own: [
            [first(cell), "--rig", cell / "rig.yaml"],
            [cell / "no run", "--rig", EVIL, "--write"],
        ],
        "calibrate": lambda cell, own: [
            [*runs(cell), "--fit", EVIL],
            [*runs(cell), "--fit", "joint_offset", "-o", own / "out.yaml"],
        ],
        "certify": lambda cell, own: [
            [cell / EVIL.replace("/", "|"), "--rig", cell / "rig.yaml", "--tolerance", EVIL],
            [cell / "rig.yaml", "--rig", cell / "rig.yaml", "--tolerance", "position:all=0.3mm"],
            [cell / "rig.yaml", "--rig", EVIL, "--features", cell / "rig.yaml", "--history", cell / EVIL],
        ],
        "check": lambda cell, own: [[cell / "rig.yaml"], [cell / EVIL.replace("/", "|")], [cell]],
        "circle fit": lambda cell, own: [
            [*runs(cell), "--rig", cell / "rig.yaml"],
            [cell / EVIL, "--rig", shutil.copy(cell / "rig.yaml", own / (EVIL.replace("/", "|") + BYTES)), "--write"],
            ["--live"],
        ],
        "compare": lambda cell, own: [
            [*runs(cell), "--plot", own / "compared"],
            [first(cell), "--json"],
            [first(cell), "--against", EVIL],
        ],
        "moved": lambda cell, own: [
            [first(cell), "--new", first(cell), "-o", own / "moved.html"],
            [*runs(cell), "--json"],
            [cell / "no run", "--new", EVIL, "--plan"],
        ],
        "pair": lambda cell, own: [
            [cell / "rig.yaml", "ur10e", touches_of_two_arms(own.parent)],
            [cell / "rig.yaml", "ur10e", cell / EVIL, "-o", own],
            [cell / "rig.yaml", EVIL, "--plan", "12", "--base", EVIL],
        ],
        "correct": lambda cell, own: [[cell / "rig.yaml", "-o", own / "corrections"], [cell / "rig.yaml", "-o", cell]],
        "diagnose": lambda cell, own: [[cell / "no run"], [first(cell), "--hold-out", first(cell)]],
        "doctor": lambda cell, own: [[cell / "rig.yaml"], [cell / "rig.yaml", "--json"]],
        "emulate": lambda cell, own: [[cell / "rig.yaml", "-o", cell / "cell"]],
        "example": lambda cell, own: [[own / (EVIL.replace("/", "|") + BYTES)], [cell / "rig.yaml"]],
        "export": lambda cell, own: [
            *([first(cell), "--to", to, "-o", own / f"out.{to}"] for to in ("csv", "parquet", "mcap")),
            [first(cell), "--to", "csv", "-o", cell / EVIL / "out.csv"],
        ],
        "export-urdf": lambda cell, own: [
            [cell / "rig.yaml"],
            [cell / "rig.yaml", "--for", "ur-driver", "--hash", EVIL],
            [cell / "rig.yaml", "-o", cell / "rig.yaml"],
            [EVIL, "-o", own / "made.urdf"],
        ],
        "fleet": lambda cell, own: [
            [cell, "--catalogue", own / "catalogue", "-o", own / "page.html", "--parquet", own / "figures.parquet"],
            [cell, "--catalogue", own / "catalogue", "--json"],
            [cell / EVIL, "--catalogue", own / "other"],
            [cell, "--catalogue", cell / "rig.yaml"],
        ],
        "history": lambda cell, own: [
            ["rig", "--runs", cell / "yaw", "-o", own / "page.html"],
            [EVIL, "--runs", cell / "yaw"],
            ["rig", "--runs", cell / "yaw", "--json"],
            ["rig", "--runs", cell / "yaw", "--figure", EVIL],
        ],
        "import": lambda cell, own: [
            [cell / "rig.yaml", "--rig", cell / "rig.yaml", "--test", "pose", "-o", own / "made"],
            [cell, "--rig", EVIL, "--test", EVIL, "-o", own / "made"],
            ["x", "--rig", EVIL, "--test", "pose", "-o", own / "made"],
        ],
        "import-urdf": lambda cell, own: [
            [hostile_urdf(own)],
            [hostile_urdf(own), "--base", EVIL, "--tip", EVIL],
            [hostile_urdf(own), "-o", cell / "rig.yaml"],
            [cell / "rig.yaml"],
            [cell / EVIL.replace("/", "|"), "-o", own / "made.yaml"],
        ],
        "init": lambda cell, own: [
            [own / "new.yaml", "--robot", "tcp://127.0.0.1:1", "--arm", EVIL],
            [own / (EVIL.replace("/", "|") + BYTES), "--port", cell / EVIL, "--robot", EVIL, "--key", EVIL],
            [cell / "rig.yaml"],
            [own / "new.yaml", "--json", "--port", cell / EVIL],
        ],
        "interfaces": lambda cell, own: [[], ["--json"]],
        "live": lambda cell, own: [[], ["--rig", EVIL]],
        "logs": lambda cell, own: [[], [EVIL], ["ur10e", "--since", EVIL]],
        "metrics": lambda cell, own: [[], ["--rig", EVIL]],
        "paper": lambda cell, own: [["--rig", cell / "no rig"]],
        "parts": lambda cell, own: [
            [cell / "no rig", "-o", own / "parts"],
            [cell / "rig.yaml", "-o", own / EVIL.replace("/", "|")],
        ],
        "plan": lambda cell, own: [[cell / "no rig"], [cell / "rig.yaml", "--tests", EVIL]],
        "postures": lambda cell, own: [
            [cell / "no targets", "--rig", cell / "rig.yaml"],
            [cell / "rig.yaml", "--arm", "ur5", "-o", own / "made"],
            [cell / EVIL, "--rig", EVIL, "--part", EVIL],
        ],
        "program": lambda cell, own: [
            [cell / "rig.yaml", "--for", "fanuc", "--test", "yaw", "-o", own / (EVIL.replace("/", "|") + BYTES)],
            [cell / "rig.yaml", "--for", "ur", "--test", "roll", "-o", cell / "rig.yaml"],
            [cell / "no rig", "--for", "ur", "--test", EVIL, "--outputs", EVIL, "-o", own / "made"],
        ],
        "record start": lambda cell, own: [
            ["lap", "--test", "radial"],
            [EVIL, "--test", "radial"],
            ["lap", "--test", EVIL],
        ],
        "record stop": lambda cell, own: [[]],
        "record touch": lambda cell, own: [["touches", "-o", own / "t"], [EVIL, "-o", own / "t", "--rig", EVIL]],
        "relabel": lambda cell, own: [
            [shutil.copytree(first(cell), own / EVIL.replace("/", "|")), "--operator", "ada"],
            [first(cell), "--operator", EVIL],
            [first(cell), "--placement", EVIL],
        ],
        "replay": lambda cell, own: [[cell / "rig.yaml", cell / "rig.yaml", "-o", own / "played"]],
        "report": lambda cell, own: [
            [*runs(cell), "-o", own / "page.html", "--lang", "de"],
            [first(cell), "--no-diagnosis", "-o", own / EVIL.replace("/", "|")],
        ],
        "runs": lambda cell, own: [[cell / "yaw"], [cell / "yaw", "--json"], [cell / EVIL]],
        "keep": lambda cell, own: [[shutil.copytree(first(cell), own / (EVIL.replace("/", "|") + BYTES))]],
        "recover": lambda cell, own: [[first(cell)], [cell / EVIL]],
        "verify": lambda cell, own: [[first(cell)], [cell / EVIL]],
        "session": lambda cell, own: [
            [cell / "rig.yaml", "--status", "-o", _kept_session(own / (EVIL.replace("/", "|") + BYTES))],
            [cell / "rig.yaml", "--for", "ur", "-o", own / (EVIL.replace("/", "|") + BYTES)],
            [EVIL, "--for", "ur", "-o", own / "s", "--emulated", "--effects", EVIL],
            [cell / "rig.yaml", "--for", "ur", "-o", cell / "rig.yaml"],
        ],
        "simulate": lambda cell, own: [
            [cell / "rig.yaml", "--test", "radial", "-o", own / (EVIL.replace("/", "|") + BYTES), "--csv"],
            [cell / "rig.yaml", "--test", "radial", "-o", own / "s", "--effects", EVIL],
        ],
        "status": lambda cell, own: [[], ["--json"], ["--rig", EVIL]],
        "versions": lambda cell, own: [
            [cell / "rig.yaml"],
            [cell / "rig.yaml", "--in", cell, "--json"],
            [cell / "rig.yaml", "--in", EVIL],
            [cell / "rig.yaml", "--back-to", EVIL],
        ],
        "window": lambda cell, own: [
            [cell / "no rig"],
            [cell / "rig.yaml", "--listen", EVIL],
            [cell / "rig.yaml", "--token", cell / "rig.yaml"],
            [cell / "rig.yaml", "--listen", "192.0.2.1", "--token", own / EVIL],
        ],
    }


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
    assert set(commands(all_imported())) == set(cases())


@pytest.mark.usefixtures("peer")
@pytest.mark.parametrize("command", cases())
def test_commands_print_only_printable_text(command, cell, tmp_path, monkeypatch):
    own = tmp_path / "own"
    own.mkdir()
    monkeypatch.chdir(own)
    for arguments in cases()[command](cell, own):
        code, out, err = ran(*command.split(), *arguments, typed=f"{EVIL}\nquit\n")
        assert code in (0, 1, 2, 3, 4), (arguments, err)
        for line in (out + err).split("\n"):
            assert line.isprintable(), (arguments, line)
            assert line.strip() != "run: whole", (arguments, "a name forged a line")
        if code > 1 and command != "verify":  # which lists what is wrong
            assert all(line.startswith("error: ") for line in err.splitlines()), err
    for file in own.rglob("*"):
        if stat.S_ISREG(file.stat().st_mode) and file.suffix in (".html", ".csv", ".txt"):
            text = file.read_text(encoding="utf-8")
            assert all(line.isprintable() for line in text.splitlines()), file
            assert file.suffix != ".html" or "<script>" not in text


def test_a_terminal_gets_colours_of_ours_alone(cell, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    code, out, _ = ran("analyse", *runs(cell))
    assert code == 0 and "\x1b]" not in out and "\x07" not in out


def test_pictures_show_dollar_signs_literally(tmp_path):
    from analysis.apps.report.still_chart import Sheet  # noqa: PLC0415

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
