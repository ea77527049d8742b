from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, get_args

import pytest
import typer
import yaml
from typer.testing import CliRunner

from analysis.cli.commands import app
from daq.service.rigd import app as rigd_app
from rigs.arms import arm_names
from rigs.interfaces import NO_DEFAULT, list_interfaces, models, name_of
from rigs.load import SHIPPED, parse
from rigs.rig import Rig
from rigs.schema.gauges import Gauge
from tests.support.command_line import all_imported
from tests.trials import wire_peers

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(ROOT.glob("docs/**/*.md"))]
_SOURCES = [
    *sorted(ROOT.glob("analysis/cli/*.py")),
    *sorted(ROOT.glob("analysis/apps/*/cli_*.py")),
    ROOT / "daq" / "service" / "rigd.py",
]


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


def _commands() -> list[tuple[str, ...]]:
    names = sorted(RIG.commands)
    below = [(group, name) for group, names_below in GROUPS.items() for name in names_below]
    return [(), *((name,) for name in names), *below]


@pytest.mark.parametrize("command", _commands(), ids=" ".join)
def test_80_columns_hold_the_help_of_every_command_whole(command):
    done = CliRunner().invoke(app, [*command, "--help"], env={"COLUMNS": "80"})
    assert done.exit_code == 0
    assert "…" not in re.sub(r"[A-Z]+…| … ", "", done.stdout)  # RUN… is one or several
    # typer keeps the line breaks of a docstring: one written 120 columns wide is broken there and at 80.
    for paragraph in re.split(r"\n\s*\n", done.stdout.partition("╭")[0].strip()):
        assert all(len(line.rstrip()) > 50 for line in paragraph.splitlines()[:-1]), paragraph


def test_no_help_is_lost_as_markup():
    """rich interprets brackets as markup, so `[default: the user]` would disappear."""
    told = re.findall(r'help="([^"]*)"', "".join(path.read_text() for path in _SOURCES))
    assert len(told) > 50
    assert [one for one in told if "[" in one] == []


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


def test_the_index_lists_every_page():
    linked = set(re.findall(r"\]\(([^)#:]+)", (ROOT / "docs" / "README.md").read_text()))
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in PAGES if page.is_relative_to(ROOT / "docs")}
    assert {page for page in pages if not page.startswith("decisions/")} - linked == {"README.md"}


def _rows() -> dict[str, list[str]]:
    text = (ROOT / "docs" / "rig-file.md").read_text().partition("## gauges")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| `(\w+)` \| (.*)\|$", text, re.M)
    return {name: [cell.strip() for cell in cells.split("|")] for name, cells in rows}


def _choices(name: str) -> set[str]:
    (model,) = (one for one in models(Gauge) if name_of(one) == name)
    kinds = [get_args(field.annotation) for field in model.model_fields.values()]
    return {word for kind in kinds for word in kind if isinstance(word, str)}


@pytest.mark.parametrize(
    "interface", [one for one in list_interfaces() if one.kind == "gauge"], ids=lambda one: one.name
)
def test_the_table_of_gauges_is_the_schema(interface):
    what, line, keys = _rows()[interface.name]
    assert line == ("to be given" if interface.line == NO_DEFAULT else interface.line)
    own, listed = set(interface.keys) - {"line", "units"}, set(re.findall(r"`(\w+)`", keys))
    assert own <= listed <= own | _choices(interface.name)
    standing = interface.origin.standing
    assert ("(" + standing + ")" in what) == (standing != "confirmed")


def test_the_table_of_gauges_names_no_other():
    assert list(_rows()) == [one.name for one in list_interfaces() if one.kind == "gauge"]


def _options(command: Any) -> Iterator[Any]:
    """Every option of a command and of those below it."""
    yield from (one for one in command.params if one.param_type_name == "option" and one.name != "help")
    for below in getattr(command, "commands", {}).values():
        yield from _options(below)


def test_every_option_documents_value_and_default():
    options = [*_options(RIG), *_options(typer.main.get_command(rigd_app))]
    assert len(options) > 60
    for one in options:
        assert one.help and one.help[0].isupper() and one.help.endswith("."), one.name
        shown = one.required or one.is_flag or one.default not in (None, "", ())
        assert shown or "default: " in one.help, (one.name, one.help)


# --- pages that are made

MADE = {"api": "api", "arms": "arms", "errors": "errors", "interfaces": "interfaces", "rig_file": "rig-file-reference"}
"""The programs of scripts/tools that make a page, without _page, and the pages."""


@pytest.mark.parametrize("program", MADE)
def test_page_equals_the_output_of_its_program(program):
    script = ROOT / "scripts" / "tools" / f"{program}_page.py"
    page = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, encoding="utf-8").stdout
    assert _page(MADE[program]) == page, f"run: scripts/dev {program}_page > docs/{MADE[program]}.md"


def _page(name: str) -> str:
    return (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")


def test_the_page_of_arms_has_every_arm():
    assert [name for name in arm_names() if f"\n| `{name}` |" not in _page("arms")] == []


def test_every_key_of_the_schema_is_listed():
    schema: dict[str, Any] = Rig.model_json_schema()
    written_as_text, chosen_by = {"Line"}, {"interface", "effect"}
    mappings = [schema, *(one for name, one in schema["$defs"].items() if name not in written_as_text)]
    keys = {key for one in mappings for key in one["properties"]} - chosen_by
    assert keys - set(re.findall(r"^- `(\w+)`: ", _page("rig-file-reference"), re.M)) == set()


def test_every_interface_and_effect_has_a_section():
    headings = set(re.findall(r"^##+ [\w., ]+: (\w+)$", _page("rig-file-reference"), re.M))
    effects = {path.stem for path in (ROOT / "rigs" / "effects").glob("*.py")} - {"__init__"}
    assert headings == {one.name for one in list_interfaces()} | effects


def test_every_interface_has_a_section_and_every_peer_an_interface():
    names = {one.name for one in list_interfaces()}
    sections = dict(re.findall(r"^### (\w+)\n(.*?)(?=^#)", _page("interfaces"), re.M | re.S))
    assert set(sections) >= names
    for peer in wire_peers.PEERS:
        assert set(peer.interfaces) <= names
        assert all(peer.name in " ".join(sections[name].split()) for name in peer.interfaces)


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
    return sorted(set(_PATH.findall(page.read_text(encoding="utf-8"))))


# a copy of the project may lack the pages at its root
NAMES = sorted({name for page in (ROOT / "AGENTS.md", *PAGES) if page.exists() for name in _named(page)})


def _defined(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
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
