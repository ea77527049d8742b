import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def _code(notebook: Path) -> list[str]:
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


def _run(code: str, directory: Path) -> str:
    """Output of a script run as by a user of the package, with warnings as errors."""
    environment = os.environ | {"MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8"}
    environment |= {"TMPDIR": str(directory)}
    command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(
        command, capture_output=True, text=True, encoding="utf-8", check=False, env=environment, cwd=directory
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_first_steps_names_the_hidden_play(tmp_path):
    told = _run("\n".join(_code(ROOT / "docs/notebook/first-steps.ipynb")), tmp_path).splitlines()
    assert "named" in told
    (play,) = [line for line in told if line.startswith("backlash of ")]
    size, u = (float(word.rstrip("°")) for word in play.split(": ")[1].split(" ± "))
    assert abs(size - 0.06) < 5 * u < 0.01
