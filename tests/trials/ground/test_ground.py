from __future__ import annotations

import csv
import json
import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from analysis.runs.tables import TouchTable
from rigs.arms import load_arm
from tests.trials.ground.arms import BALL_MM, effects_of, write_seen
from tests.trials.ground.plain_arm import read_columns, read_poses, write_rows
from tests.trials.ground.score import Figure, Scores, scored
from tests.trials.ground.table import draw, markdown
from tests.trials.ground.tasks import Size, make, read_tasks
from tests.worlds.arms.seven_axes import Fault, came_from, draw_truth, pose_table, touch_table

ROOT = Path(__file__).parents[3]
SMALL = Size(
    {"one": 1}, {"healthy": 1}, arms=1, many=40, few=12, asked=20,
    in_poses={"sound": 1, "two": 1}, in_touches={"sound": 1, "one": 1}, poses=60,
)  # fmt: skip
SEED = 97
PERFECT_NM = 20
"""Answers are written to 10 nm."""


@pytest.fixture(scope="module")
def ground(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two tasks of poses; a cell with a fault, an arm with faults in poses and one in touches, and a sound one each."""
    directory = tmp_path_factory.mktemp("ground") / "small"
    left_out = make(directory, SEED, SMALL, None)
    assert len(left_out) == 3 and all("--data" in line for line in left_out)
    return directory


def truths(ground: Path, answers: Path) -> None:
    for task in read_tasks(ground / "tasks"):
        path = answers / f"{task.name}.csv"
        if task.kind == "poses":
            true = read_columns(ground / "truth" / f"{task.name}.csv")
            rows = [[str(int(pose)), *(str(true[name][k]) for name in ("x_mm", "y_mm", "z_mm")), "0.01"]
                    for k, pose in enumerate(true["pose"])]  # fmt: skip
            write_rows(path, ("pose", "x_mm", "y_mm", "z_mm", "u_mm"), rows)
            continue
        hidden = json.loads((ground / "truth" / f"{task.name}.json").read_text(encoding="utf-8"))["hidden"]
        rows = []
        for one in hidden:
            part, _, axis = one["name"].partition(" ")
            rows.append([part, axis, str(one["parameters"][one["size"]]), str(one["healthy"])])
        write_rows(path, ("part", "axis", "size", "u"), rows)


def shares(found: Scores) -> list[tuple[float, int]]:
    return [(own["share"].value, own["share"].of) for own in found.values() if "share" in own and own["share"].of]


def poses_of(found: Scores) -> list[dict[str, Figure]]:
    return [own for own in found.values() if "error_um" in own]


def test_the_truth_scores_perfectly(ground, tmp_path):
    truths(ground, tmp_path)
    found = scored(ground, tmp_path)
    assert len(poses_of(found)) == 2
    for own in poses_of(found):
        assert own["error_um"].value < 1e-3 * PERFECT_NM
        assert own["removed"].value == pytest.approx(1, abs=1e-4)
        assert own["within_2u"].value == own["answered"].value == 1
    assert len(shares(found)) == 12 and {share for share, _ in shares(found)} == {1}


def test_an_empty_answer_scores_nothing(ground, tmp_path):
    found = scored(ground, tmp_path)
    for own in poses_of(found):
        assert own["answered"].value == own["removed"].value == 0
        assert own["error_um"].value == own["nominal_um"].value > 100
    assert {share for share, _ in shares(found)} == {0}


def test_wrong_faults_are_scored_as_such(ground, tmp_path):
    """A part that is not wrong, with a size that is no number, in cells and arms."""
    for task in read_tasks(ground / "tasks"):
        if task.kind != "poses":
            write_rows(tmp_path / f"{task.name}.csv", ("part", "axis", "size", "u"), [["clock_rate", "", "much", ""]])
    assert {share for share, _ in shares(scored(ground, tmp_path))} == {0}


def test_half_an_answer_with_words_and_unknown_poses_is_half_answered(ground, tmp_path):
    for task in read_tasks(ground / "tasks"):
        if task.kind == "poses":
            count = len(read_poses(ground / "tasks" / task.name / "test.csv").q)
            rows = [[str(k), "0", "0", "0", "1"] for k in range(1, count // 2 + 1)]
            more = [["999", "0", "0", "0", "1"], ["20", "far", "0", "0", "1"], ["x", "0", "0", "0", "1"]]
            write_rows(tmp_path / f"{task.name}.csv", ("pose", "x_mm", "y_mm", "z_mm", "u_mm"), [*rows, *more])
    for own in poses_of(scored(ground, tmp_path)):
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
    own = poses_of(scored(ground, tmp_path / "answers"))[0]
    assert own["answered"].value == 1
    assert own["removed"].value == pytest.approx(0, abs=1e-3)
    assert own["error_um"].low < own["error_um"].value < own["error_um"].high


@pytest.mark.parametrize("seen", ["poses", "touches"])
def test_oracle_knows_the_effect_of_a_fault(seen):
    """Places of an arm with a fault less those without, by the generator itself: the effect times its size."""
    robot, ball = load_arm("franka-fr3").robot, BALL_MM
    faults = [Fault("zero", 4, 0.01), Fault("length", 3, 0.1, "d"), Fault("twist", 5, 0.01, "alpha"),
              Fault("play", 2, 0.01), Fault("compliance", 4, 1e-4)]  # fmt: skip
    for fault in faults:
        sound, faulty = (draw_truth(robot, np.random.default_rng(5), own) for own in ((), (fault,)))
        rng = np.random.default_rng(6)
        table = (
            touch_table(robot, sound, rng, ball, 2, 8) if seen == "touches" else pose_table(robot, sound, rng, ball, 8)
        )
        assert isinstance(table, TouchTable) == (seen == "touches")
        before = came_from(table)
        really = (faulty.places(table.q, before, ball) - sound.places(table.q, before, ball)).ravel()
        (effect,) = (one for one in effects_of(robot, table.q, before, ball) if one.name == fault.name)
        np.testing.assert_allclose(fault.size * effect.places, really, atol=0.03 * np.abs(really).max())


def test_faults_in_poses_and_touches_are_scored_with_their_rivals(ground):
    for task in read_tasks(ground / "truth"):
        if not task.kind.startswith("fault_in"):
            continue
        truth = json.loads((ground / "truth" / f"{task.name}.json").read_text(encoding="utf-8"))
        parts = read_columns(ground / "tasks" / "parts.csv")
        known = {f"{part} {axis}".strip() for part, axis in zip(parts["part"], parts["axis"], strict=True)}
        for one in truth["hidden"]:
            assert one["name"] in one["class"] and one["testable"] == (one["sigma"] >= 7)
            assert abs(one["parameters"][one["size"]]) >= 5 * one["healthy"]
            assert set(one["class"]) <= known
        assert {one["name"] for one in truth["background"]} <= known


def test_rig_names_the_fault_in_touches_from_the_files_alone(ground, tmp_path):
    entry = runpy.run_path(str(ROOT / "tests" / "trials" / "ground" / "rig_entry.py"))
    tasks, truth = read_tasks(ground / "tasks"), ground / "truth"
    (task,) = (
        one for one in tasks
        if one.kind == "fault_in_touches" and json.loads((truth / f"{one.name}.json").read_text("utf-8"))["hidden"]
    )  # fmt: skip
    entry["answer"](task, ground / "tasks" / task.name, tmp_path / f"{task.name}.csv", tmp_path)
    found = scored(ground, tmp_path)
    own = [figures["share"] for row, figures in found.items() if row.startswith("touches") and "sound" not in row]
    assert [one.value for one in own] == [1, 1, 1]


@pytest.mark.parametrize("seen", ["poses", "touches"])
def test_least_squares_names_a_zero(tmp_path, seen):
    robot, rng = load_arm("franka-fr3").robot, np.random.default_rng(5)
    truth = draw_truth(robot, rng, (Fault("zero", 4, 0.4),))
    table = (
        touch_table(robot, truth, rng, BALL_MM, 2, 40)
        if seen == "touches"
        else pose_table(robot, truth, rng, BALL_MM, 80)
    )
    write_seen(tmp_path, robot, table)
    (row,) = runpy.run_path(str(ROOT / "tests" / "trials" / "ground" / "constants_entry.py"))[f"named_in_{seen}"](
        tmp_path
    )
    assert row[:2] == ["joint_offset", "4"]
    assert abs(float(row[2]) - 0.4) < 0.06


def test_tasks_tell_nothing_of_the_truth(ground):
    assert not list((ground / "tasks").rglob("*.json"))
    for path in (ground / "tasks").rglob("*.csv"):
        with path.open(encoding="utf-8", newline="") as file:
            names = next(csv.reader(file))
        assert not {"nominal_x_mm", "group", "hidden", "use"} & set(names), path
    for path in (ground / "tasks").rglob("test.csv"):
        assert np.isnan(read_poses(path).xyz_mm).all()
    assert "effects: []" in next((ground / "tasks").rglob("cell.yaml")).read_text(encoding="utf-8")


def test_the_commands_make_score_and_draw(tmp_path, capsys):
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
    draw(found, tmp_path / "table.png")
    assert (tmp_path / "table.png").stat().st_size > 10_000


def test_front_page_has_the_table_of_the_proving_ground():
    front, page = ((ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "docs/proving-ground.md"))
    rows = [line for line in front.splitlines() if line.startswith(("| task |", "| UR10 ", "| UR5,", "| WAM "))]
    assert len(rows) > 5
    assert set(rows) <= set(page.splitlines())
