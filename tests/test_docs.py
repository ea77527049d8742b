import ast
import re
import runpy
from functools import cache
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from analysis.cli.commands import app
from daq.service.rigd import app as rigd_app
from rigs.load import SHIPPED, parse
from tests.support.command_line import all_imported
from tests.trials import wire_peers

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(ROOT.glob("docs/**/*.md"))]


RIG = all_imported()
GROUPS = {name: sorted(one.commands) for name, one in RIG.commands.items() if hasattr(one, "commands")}
"""Commands that have commands below them."""


def _typed() -> list[str]:
    lines = []
    for page in PAGES:
        for block in re.findall(r"```sh\n(.*?)```", page.read_text(), re.S):
            lines += [line.split("#")[0].strip() for line in block.splitlines()]
        lines += re.findall(r"`(rigd? [^`]+)`", page.read_text())
    return sorted({line for line in lines if line.startswith(("rig ", "rigd "))})


def test_every_command_line_in_the_documents_exists():
    lines = _typed()
    assert len(lines) > 200
    for line in lines:
        words = line.split()
        command = [word for word in words if re.fullmatch(r"[a-z]+(-[a-z]+)*", word)]
        depth = {"rig": 2, "rigd": 1}[command[0]] + (command[0] == "rig" and bool(GROUPS.keys() & command[1:2]))
        shown = _help(command[0], tuple(command[1:depth]))
        for option in (word.split("=")[0] for word in words if word.startswith("--")):
            assert re.search(rf"{option}\b", shown), (line, option)


@cache
def _help(program: str, command: tuple[str, ...]) -> str:
    done = CliRunner().invoke(
        {"rig": app, "rigd": rigd_app}[program], [*command, "--help"], env={"COLUMNS": "200"}, prog_name=program
    )
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.parametrize("block", re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / "rig-file.md").read_text(), re.S))
def test_every_example_of_the_rig_file_is_one(block):
    whole = yaml.safe_load((SHIPPED / "paper-fanuc.yaml").read_text())
    parse(yaml.safe_dump(whole | yaml.safe_load(block)), "example.yaml")


def test_every_link_in_the_documents_leads_somewhere():
    for page in PAGES:
        for target, anchor in re.findall(r"\]\(([^)#:]*)(?:#([^)]+))?\)", page.read_text()):
            there = page.parent / target if target else page
            assert there.exists(), (page, target)
            assert not anchor or anchor in _anchors(there), f"{page}: {target}#{anchor}"


def _anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them: lower case, spaces as hyphens, of other signs - and _."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(), re.M)
    return {re.sub(r"[^\w -]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def test_every_table_in_the_documents_has_a_heading():
    for page in PAGES:
        prose = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S)
        for table in re.findall(r"(?:^\|.*\n)+", prose, re.M):
            assert re.match(r".+\n\|[-:| ]+\|\n", table), f"{page}: rows without a heading: {table[:80]}"


def test_the_index_lists_every_page():
    linked = set(re.findall(r"\]\(([^)#:]+)", (ROOT / "docs" / "README.md").read_text()))
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in PAGES if page.is_relative_to(ROOT / "docs")}
    assert {page for page in pages if not page.startswith("decisions/")} - linked == {"README.md"}


# --- pages that are made

MADE = {"api": "api", "arms": "arms", "errors": "errors", "interfaces": "interfaces", "rig_file": "rig-file-reference"}
"""The programs of scripts/tools that make a page, without _page, and the pages."""


@pytest.mark.parametrize("program", MADE)
def test_page_equals_the_output_of_its_program(program, capsys):
    runpy.run_path(str(ROOT / "scripts" / "tools" / f"{program}_page.py"), run_name="__main__")
    assert _page(MADE[program]) == capsys.readouterr().out, f"run: scripts/dev {program}_page > docs/{MADE[program]}.md"


def _page(name: str) -> str:
    return (ROOT / "docs" / f"{name}.md").read_text()


def test_a_peer_that_disagrees_or_is_absent_is_reported():
    def disagrees() -> str:
        raise wire_peers.Disagrees("1.0 where 2.0 was sent")

    def absent() -> str:
        raise ModuleNotFoundError("missing peer")

    lines = [wire_peers.checked(wire_peers.Peer("a", ("ur_rtde",), "host", one)) for one in (disagrees, absent)]
    assert "DISAGREES: 1.0" in lines[0] and "skipped: " in lines[1]
    assert wire_peers.has_failed(lines) and not wire_peers.has_failed(lines[1:])


# --- files and functions that pages name

HOW_TO = ROOT / "docs" / "how-to"
TREES = (ROOT, *(HOW_TO / "examples").iterdir())
"""Where a file may be: in the tree, or in an example that a page adds to it."""
_PATH = re.compile(r"`((?:rigs|daq|analysis)/[\w/.]*?)(?::(\w+))?`")


def _named(page: Path) -> list[tuple[str, str]]:
    return sorted(set(_PATH.findall(page.read_text())))


# a copy of the project may lack the pages at its root
NAMES = sorted({name for page in (ROOT / "AGENTS.md", *PAGES) if page.exists() for name in _named(page)})


def _defined(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.parse(path.read_text()).body:
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.AnnAssign(target=ast.Name(id=name)):
                found.add(name)
            case ast.Assign(targets=targets):
                found |= {target.id for target in targets if isinstance(target, ast.Name)}
    return found


def test_every_path_and_name_of_a_page_exists():
    for path, name in NAMES:
        found = next((tree / path for tree in TREES if (tree / path).exists()), None)
        assert found is not None, path
        assert not name or name in _defined(found), f"{path} defines no {name}"
