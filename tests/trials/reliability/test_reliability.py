"""`scripts/dev reliability`: the table and the diagram of a trial, from what was kept of it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]
PLAY = {"effect": "backlash", "axis": 1, "parameters": {}, "posterior": 0.995, "rivals": []}
FAULT = {"name": "backlash 1", "size": "width_deg", "parameters": {"width_deg": 0.1}, "class": ["backlash 1"]}


def _kept(root: Path, count: int) -> None:
    for number in range(count):
        case = root / "cases" / f"case-{number}"
        case.mkdir(parents=True)
        (root / "truth").mkdir(exist_ok=True)
        truth = {"case": case.name, "kind": "one", "seed": number, "outside": [], "background": []}
        hidden = [FAULT | {"testable": True}]
        (root / "truth" / f"{case.name}.json").write_text(json.dumps(truth | {"hidden": hidden}))
        (case / "answer.json").write_text(json.dumps({"condition": "named", "effects": [PLAY], "seconds": 2.0}))
    (root / "cases" / "case-begun").mkdir()


def test_table_and_diagram_of_kept_cases_without_those_that_were_only_begun(tmp_path: Path) -> None:
    _kept(tmp_path, 3)
    picture = tmp_path / "reliability.png"
    command = [sys.executable, "tests/trials/reliability/__main__.py", str(tmp_path), "--picture", str(picture)]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("3 cases\n") and "3 of 3" in done.stdout
    assert "one: 3 of 3 testable; 3 named; 2.0 s a case" in done.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")
