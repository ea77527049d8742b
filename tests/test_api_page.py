"""docs/api.md is what the docstrings of the public API say, and has every public name."""

import subprocess
import sys
from pathlib import Path

import analysis

ROOT = Path(__file__).parents[1]


def test_the_page_is_what_the_docstrings_say() -> None:
    script = ROOT / "dev" / "api_page.py"
    page = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, encoding="utf-8").stdout
    written = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    assert written == page, "run: scripts/dev api_page > docs/api.md"
    assert [name for name in analysis.__all__ if f"\n### {name}\n" not in page] == []
