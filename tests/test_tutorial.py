"""docs/tutorial.md, followed in an empty directory: every command runs and prints the lines quoted below it."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[1] / "docs" / "tutorial.md").read_text()
BLOCKS = re.findall(r"^```(sh|text)\n(.*?)^```", PAGE, re.S | re.M)
LIKE = 0.03
"""Relative difference allowed between the figures of the page, which are rounded, and the printed ones."""
_NUMBER = r"\d+(?:\.\d+)?"


def _words(text: str) -> str:
    return " ".join(text.replace("│", " ").split())


@pytest.mark.nightly  # half a minute of processor time; every command line of the documents is parsed in each commit
@pytest.mark.cpu_limit(300)
@pytest.mark.timeout(600)
def test_commands_print_the_output_of_the_page(tmp_path):
    env = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "COLUMNS": "90"}
    printed, quoted = "", 0
    for language, block in BLOCKS:
        if language == "sh":
            shell = ["bash", "-ec", block]
            done = subprocess.run(shell, capture_output=True, text=True, check=False, cwd=tmp_path, env=env)
            assert done.returncode == 0, (block, done.stderr)
            printed = _words(done.stdout)
            continue
        for part in filter(None, map(str.strip, re.split(r"…|\n(?=│)", block))):
            pattern = f"({_NUMBER})".join(map(re.escape, re.split(_NUMBER, _words(part))))
            found = re.search(pattern, printed)
            assert found, (part, printed)
            figures = [float(one) for one in re.findall(_NUMBER, part)]
            assert [float(one) for one in found.groups()] == pytest.approx(figures, rel=LIKE), part
            quoted += 1
    assert quoted > 5
    assert (tmp_path / "report.html").stat().st_size > 100_000
