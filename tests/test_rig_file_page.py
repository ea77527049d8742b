"""docs/rig-file-reference.md is what the schema says, and has every key, interface and effect."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from rigs.interfaces import known
from rigs.rig import Rig

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "rig-file-reference.md"


def test_the_page_is_what_the_schema_says() -> None:
    script = ROOT / "dev" / "rig_file_page.py"
    page = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, encoding="utf-8").stdout
    assert PAGE.read_text(encoding="utf-8") == page, "run: scripts/dev rig_file_page > docs/rig-file-reference.md"


def test_every_key_of_the_schema_has_a_row() -> None:
    schema: dict[str, Any] = Rig.model_json_schema()
    written_as_text, chosen_by = {"Line"}, {"interface", "effect"}
    mappings = [schema, *(one for name, one in schema["$defs"].items() if name not in written_as_text)]
    keys = {key for one in mappings for key in one["properties"]} - chosen_by
    assert keys - set(re.findall(r"^\| `(\w+)` \|", PAGE.read_text(encoding="utf-8"), re.M)) == set()


def test_every_interface_and_effect_has_a_section() -> None:
    headings = set(re.findall(r"^##+ [\w., ]+: (\w+)$", PAGE.read_text(encoding="utf-8"), re.M))
    effects = {path.stem for path in (ROOT / "rigs" / "effects").glob("*.py")} - {"__init__"}
    assert headings == {one.name for one in known()} | effects


def test_every_link_within_the_page_has_its_heading() -> None:
    page = PAGE.read_text(encoding="utf-8")
    titles = re.findall(r"^##+ (.*)$", page, re.M)
    anchors = {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}
    assert set(re.findall(r"\]\(#([^)]+)\)", page)) <= anchors
    assert len(anchors) == len(titles), "two sections of one name"
