import csv
import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from tests.trials.ground.plain_arm import XYZ, read_columns, read_poses, write_rows
from tests.trials.ground.score import scored
from tests.trials.ground.table import markdown
from tests.trials.ground.tasks import TINY, make, read_tasks

ROOT = Path(__file__).parents[3]
SEED = 97
PERFECT_NM = 20
"""Answers are written to 10 nm."""


@pytest.fixture(scope="module")
def ground(tmp_path_factory):
    """Two tasks of one simulated arm."""
    directory = tmp_path_factory.mktemp("ground") / "small"
    left_out = make(directory, SEED, TINY, None)
    assert len(left_out) == 3 and all("--data" in line for line in left_out)
    return directory


def truths(ground: Path, answers: Path) -> None:
    for task in read_tasks(ground / "tasks"):
        true = read_columns(ground / "truth" / f"{task.name}.csv")
        rows = [[str(int(pose)), *(str(true[name][k]) for name in XYZ), "0.01"]
                for k, pose in enumerate(true["pose"])]  # fmt: skip
        write_rows(answers / f"{task.name}.csv", ("pose", *XYZ, "u_mm"), rows)


def test_the_truth_scores_perfectly(ground, tmp_path):
    truths(ground, tmp_path)
    found = scored(ground, tmp_path)
    assert len(found) == 2
    for own in found.values():
        assert own["error_um"].value < 1e-3 * PERFECT_NM
        assert own["removed"].value == pytest.approx(1, abs=1e-4)
        assert own["within_2u"].value == own["answered"].value == 1


def test_an_empty_answer_scores_nothing(ground, tmp_path):
    found = scored(ground, tmp_path)
    for own in found.values():
        assert own["answered"].value == own["removed"].value == 0
        assert own["error_um"].value == own["nominal_um"].value > 100


def test_half_an_answer_with_words_and_unknown_poses_is_half_answered(ground, tmp_path):
    for task in read_tasks(ground / "tasks"):
        count = len(read_poses(ground / "tasks" / task.name / "test.csv").q)
        rows = [[str(k), "0", "0", "0", "1"] for k in range(1, count // 2 + 1)]
        more = [["999", "0", "0", "0", "1"], ["20", "far", "0", "0", "1"], ["x", "0", "0", "0", "1"]]
        write_rows(tmp_path / f"{task.name}.csv", ("pose", *XYZ, "u_mm"), [*rows, *more])
    for own in scored(ground, tmp_path).values():
        assert own["answered"].value == 0.5
        assert own["removed"].value < 0 and own["error_over_u"].value > 100


def test_the_entry_of_the_page_enters(ground, tmp_path, monkeypatch):
    """The nominal arm with its frame and target fitted, which removes nothing."""
    page = (ROOT / "docs" / "how-to" / "enter-the-proving-ground.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", page, re.M | re.S)
    assert len(code.splitlines()) < 15
    (tmp_path / "try").mkdir()
    (tmp_path / "try" / "ground").symlink_to(ground)
    monkeypatch.chdir(tmp_path)
    exec(compile(code.replace("try/ground/answers", "answers"), "the page", "exec"), {})  # noqa: S102 - our page
    own = next(iter(scored(ground, tmp_path / "answers").values()))
    assert own["answered"].value == 1
    assert own["removed"].value == pytest.approx(0, abs=1e-3)
    assert own["error_um"].low < own["error_um"].value < own["error_um"].high


def test_tasks_tell_nothing_of_the_truth(ground):
    assert not list((ground / "tasks").rglob("*.json"))
    for path in (ground / "tasks").rglob("*.csv"):
        with path.open(encoding="utf-8", newline="") as file:
            names = next(csv.reader(file))
        assert not {"nominal_x_mm", "group", "hidden", "use"} & set(names), path
    for path in (ground / "tasks").rglob("test.csv"):
        assert np.isnan(read_poses(path).xyz_mm).all()


def test_the_commands_make_and_score(tmp_path, capsys):
    main = runpy.run_path(str(ROOT / "tests" / "trials" / "ground" / "__main__.py"))["main"]
    directory = tmp_path / "tiny"
    make_tiny = ["make", str(directory), "--seed", "3", "--tiny"]
    assert main(make_tiny) == 0
    truths(directory, tmp_path / "answers")
    assert main(["score", str(directory), str(tmp_path / "answers")]) == 0
    assert "100 %" in capsys.readouterr().out
    for words in (make_tiny, ["score", str(tmp_path), str(tmp_path)]):
        with pytest.raises(SystemExit) as end:
            main(words)
        assert end.value.code == 2
    found = {"nobody": scored(directory, tmp_path), "the truth": scored(directory, tmp_path / "answers")}
    assert "not entered" in markdown(found)


def test_front_page_has_the_table_of_the_proving_ground():
    front, page = ((ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "docs/proving-ground.md"))
    rows = [line for line in front.splitlines() if line.startswith(("| task |", "| UR10 ", "| UR5,", "| WAM "))]
    assert len(rows) > 5
    assert set(rows) <= set(page.splitlines())
