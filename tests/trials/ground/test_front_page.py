import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.nightly import cases
from tests.trials.ground.score import scored
from tests.trials.ground.tasks import Size, make, read_tasks

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "README.md").read_text(encoding="utf-8")
DATA = ROOT.parent / "shared" / "data"
ROWS = {"ur5": "UR5, 1000 poses", "ur5-few": "UR5, 30 poses"}
LIKE = 0.03
"""By which figures may differ: those of the page are rounded."""


def _section(heading: str) -> str:
    return PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def _commands(heading: str) -> list[str]:
    (block,) = re.findall(r"^```sh\n(.*?)^```", _section(heading), re.S | re.M)
    return [line for line in block.splitlines() if line.strip()]


def _ran(line: str, directory: Path) -> str:
    env = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "COLUMNS": "80"}
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False, cwd=directory, env=env)
    assert done.returncode == 0, (line, done.stdout + done.stderr)
    return " ".join(done.stdout.split())


def _with_numbers_out(text: str) -> tuple[str, list[float]]:
    number = r"\d+(?:\.\d+)?"
    return re.sub(number, "#", text), [float(one) for one in re.findall(number, text)]


@pytest.mark.cpu_limit(300)
@pytest.mark.timeout(600)
def test_diagnosis_finds_the_effects_of_the_page(tmp_path):
    lines = _commands("A first diagnosis")
    said = {line.partition("#")[0].strip(): _ran(line, tmp_path) for line in lines}
    (first, second) = (text for line, text in said.items() if line.startswith("rig diagnose"))
    quoted = re.findall(r"(?<!\*)\*([A-Z0-9][^*]+)\*(?!\*)", _section("A first diagnosis"))
    assert len(quoted) == 4
    for sentence in quoted:
        words, figures = _with_numbers_out(" ".join(sentence.split()))
        around = re.search(re.escape(words).replace("\\#", "#"), _with_numbers_out(first)[0])
        assert around, (words, first)
        before = _with_numbers_out(first)[0][: around.start()].count("#")
        printed = _with_numbers_out(first)[1][before : before + len(figures)]
        assert printed == pytest.approx(figures, rel=LIKE), sentence
    assert "is complete" in second
    found = [path.name for path in (tmp_path / "try/found").iterdir()]
    assert {"paper-fanuc.yaml", "paper-fanuc.calibration.json", "diagnosis.png"} <= set(found)


@pytest.mark.skipif(not (DATA / "jacobi").is_dir(), reason="no data")
@pytest.mark.cpu_limit(120)
@pytest.mark.parametrize(("task_name", "row"), cases(ROWS.items(), [("ur5-few", "UR5, 30 poses")]))
def test_table_of_real_arms_is_reproduced(task_name, row, tmp_path):
    """The rows of the UR5; the others take minutes: `scripts/dev ground run`."""
    make(tmp_path, 97, Size(arms=0), DATA)
    answer = runpy.run_path(str(ROOT / "tests" / "trials" / "ground" / "rig_entry.py"))["answer"]
    (task,) = (one for one in read_tasks(tmp_path / "tasks") if one.name == task_name)
    answer(tmp_path / "tasks" / task.name, tmp_path / f"{task.name}.csv", tmp_path)
    found = scored(tmp_path, tmp_path)
    (told,) = re.findall(rf"^\| {row} \| 20 \| \d+ \| (\d+) ", _section("What it reached on real arms"), re.M)
    assert found[row]["error_um"].value == pytest.approx(float(told), rel=LIKE)
