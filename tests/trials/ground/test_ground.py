"""The proving ground from end to end: tasks are made, answered and scored."""

from __future__ import annotations

import csv
import json
import re
import runpy
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from analysis.runs.tables import TouchTable
from rigs.arms import load_arm
from tests.trials.ground.arms import BALL_MM, effects_of, write_seen
from tests.trials.ground.plain_arm import read_columns, read_poses, write_rows
from tests.trials.ground.score import scored
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
    """Answer with the truth itself."""
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


def test_the_truth_scores_perfectly(ground: Path, tmp_path: Path) -> None:
    truths(ground, tmp_path)
    found = scored(ground, tmp_path)
    for row in ("arms with joint curves, 40 poses", "arms with joint curves, 12 poses"):
        assert found[row]["error_um"].value < 1e-3 * PERFECT_NM
        assert found[row]["removed"].value == pytest.approx(1, abs=1e-4)
        assert found[row]["within_2u"].value == found[row]["answered"].value == 1
    for row in (
        "one fault that shows: named first",
        "names that are right",
        "sizes within 2 u",
        "one circle each way, sound: no part named",
        "poses, sound: no part named",
        "touches, sound: no part named",
        "touches, one or two faults: those that show are named",
        "touches: names that are right",
        "touches: sizes within 2 u",
    ):
        assert (found[row]["share"].value, found[row]["share"].of) == (1, 1), row
    for what in (", one or two faults: those that show are named", ": names that are right", ": sizes within 2 u"):
        assert (found[f"poses{what}"]["share"].value, found[f"poses{what}"]["share"].of) == (1, 2)


def test_an_empty_answer_scores_nothing(ground: Path, tmp_path: Path) -> None:
    found = scored(ground, tmp_path)
    for row in ("arms with joint curves, 40 poses", "arms with joint curves, 12 poses"):
        assert found[row]["answered"].value == found[row]["removed"].value == 0
        assert found[row]["error_um"].value == found[row]["nominal_um"].value > 100
    assert found["one fault that shows: named first"]["share"].value == 0
    assert found["one circle each way, sound: no part named"]["share"].value == 0
    for seen in ("poses", "touches"):
        assert found[f"{seen}, sound: no part named"]["share"].value == 0
        assert found[f"{seen}, one or two faults: those that show are named"]["share"].value == 0
        assert found[f"{seen}: names that are right"]["answered"].value == 0
    assert found["names that are right"]["share"].of == found["sizes within 2 u"]["share"].of == 0


def wrong_fault(answers: Path, tasks: dict[str, Path]) -> None:
    """Name what is not there, with a size that is no number, in cells and arms."""
    for name in tasks:
        write_rows(answers / f"{name}.csv", ("part", "axis", "size", "u"), [["clock_rate", "", "much", ""]])


def half_a_file(answers: Path, tasks: dict[str, Path]) -> None:
    """Answer half of the poses, some of them with words and of poses that are not there."""
    for name, path in tasks.items():
        poses = read_poses(path / "test.csv")
        rows = [[str(k), "0", "0", "0", "1"] for k in range(1, len(poses.q) // 2 + 1)]
        write_rows(answers / f"{name}.csv", ("pose", "x_mm", "y_mm", "z_mm", "u_mm"), [
            *rows, ["999", "0", "0", "0", "1"], ["20", "far", "0", "0", "1"], ["x", "0", "0", "0", "1"],
        ])  # fmt: skip


@pytest.mark.parametrize("answer", [wrong_fault, half_a_file])
def test_wrong_and_broken_answers_are_scored_as_such(
    ground: Path, tmp_path: Path, answer: Callable[[Path, dict[str, Path]], None]
) -> None:
    kind = "fault" if answer is wrong_fault else "poses"
    names = [task.name for task in read_tasks(ground / "tasks") if task.kind.startswith(kind)]
    answer(tmp_path, {name: ground / "tasks" / name for name in names})
    found = scored(ground, tmp_path)
    if kind == "fault":
        assert found["one circle each way, sound: no part named"]["share"].value == 0
        assert found["names that are right"]["share"].value == 0
        for seen, arms in (("poses", 2), ("touches", 2)):
            own = {row.removeprefix(seen): figures["share"] for row, figures in found.items() if row.startswith(seen)}
            assert (
                own[", sound: no part named"].value == own[", one or two faults: those that show are named"].value == 0
            )
            assert (own[": names that are right"].value, own[": names that are right"].of) == (0, arms)
            assert own[": sizes within 2 u"].of == 0
    else:
        own = found["arms with joint curves, 40 poses"]
        assert own["answered"].value == 0.5
        assert own["removed"].value < 0 and own["error_over_u"].value > 100


def test_the_entry_of_the_page_enters(ground: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The nominal arm with its frame and target fitted, which removes nothing."""
    page = (ROOT / "docs" / "how-to" / "enter-the-proving-ground.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", page, re.M | re.S)
    assert len(code.splitlines()) < 15
    (tmp_path / "try").mkdir()
    (tmp_path / "try" / "ground").symlink_to(ground)
    monkeypatch.chdir(tmp_path)
    exec(compile(code.replace("try/ground/answers", "answers"), "the page", "exec"), {})  # noqa: S102 - our page
    own = scored(ground, tmp_path / "answers")["arms with joint curves, 40 poses"]
    assert own["answered"].value == 1
    assert own["removed"].value == pytest.approx(0, abs=1e-3)
    assert own["error_um"].low < own["error_um"].value < own["error_um"].high


@pytest.mark.parametrize("seen", ["poses", "touches"])
def test_the_oracle_knows_what_a_fault_does(seen: str) -> None:
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


def test_faults_in_poses_and_touches_are_told_with_what_looks_alike(ground: Path) -> None:
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


def test_rig_names_the_fault_in_touches_from_the_files_alone(ground: Path, tmp_path: Path) -> None:
    entry = runpy.run_path(str(ROOT / "tests" / "trials" / "ground" / "rig_entry.py"))
    tasks, truth = read_tasks(ground / "tasks"), ground / "truth"
    (task,) = (
        one for one in tasks
        if one.kind == "fault_in_touches" and json.loads((truth / f"{one.name}.json").read_text("utf-8"))["hidden"]
    )  # fmt: skip
    entry["answer"](task, ground / "tasks" / task.name, tmp_path / f"{task.name}.csv", tmp_path)
    found = scored(ground, tmp_path)
    assert found["touches, one or two faults: those that show are named"]["share"].value == 1
    assert found["touches: names that are right"]["share"].value == 1


@pytest.mark.parametrize("seen", ["poses", "touches"])
def test_least_squares_names_a_zero(tmp_path: Path, seen: str) -> None:
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


def test_tasks_tell_nothing_of_the_truth(ground: Path) -> None:
    assert not list((ground / "tasks").rglob("*.json"))
    for path in (ground / "tasks").rglob("*.csv"):
        with path.open(encoding="utf-8", newline="") as file:
            names = next(csv.reader(file))
        assert not {"nominal_x_mm", "group", "hidden", "use"} & set(names), path
    for path in (ground / "tasks").rglob("test.csv"):
        assert np.isnan(read_poses(path).xyz_mm).all()
    assert "effects: []" in next((ground / "tasks").rglob("cell.yaml")).read_text(encoding="utf-8")


def test_the_commands_make_score_and_draw(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main = runpy.run_path(str(ROOT / "tests" / "trials" / "ground" / "__main__.py"))["main"]
    directory = tmp_path / "tiny"
    assert main(["make", str(directory), "--seed", "3", "--tiny"]) == 0
    assert "left out: the UR10" in capsys.readouterr().out
    truths(directory, tmp_path / "answers")
    assert main(["score", str(directory), str(tmp_path / "answers")]) == 0
    said = capsys.readouterr().out
    assert "| arms with joint curves, 40 poses | 20 |" in said and "100 %" in said
    with pytest.raises(SystemExit):
        main(["make", str(directory), "--seed", "3", "--tiny"])
    assert "exists" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["score", str(tmp_path), str(tmp_path)])
    assert "is not there" in capsys.readouterr().err
    found = {"nobody": scored(directory, tmp_path), "the truth": scored(directory, tmp_path / "answers")}
    assert "not entered" in markdown(found)
    draw(found, tmp_path / "table.png")
    assert (tmp_path / "table.png").stat().st_size > 10_000


def test_the_table_of_the_front_page_is_that_of_the_proving_ground() -> None:
    front, page = ((ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "docs/proving-ground.md"))
    rows = [line for line in front.splitlines() if line.startswith(("| task |", "| UR10 ", "| UR5,", "| WAM "))]
    assert len(rows) > 5
    assert set(rows) <= set(page.splitlines())
