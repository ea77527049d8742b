"""docs/arms.md is what the arm library and its second sources say."""

import subprocess
import sys
from pathlib import Path

from rigs.arms import arm_names

ROOT = Path(__file__).parents[1]


def test_the_page_is_what_the_library_says() -> None:
    script = ROOT / "dev" / "arms_page.py"
    page = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, encoding="utf-8").stdout
    written = (ROOT / "docs" / "arms.md").read_text(encoding="utf-8")
    assert written == page, "run: scripts/dev arms_page > docs/arms.md"
    assert [name for name in arm_names() if f"\n| `{name}` |" not in page] == []
