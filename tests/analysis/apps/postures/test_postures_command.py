import re
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.report.texts import LANGUAGES, texts_of
from tests.support import written_files
from tests.support.command_line import errors_of, failure_of, json_of, ran, succeeded
from tests.support.every import in_every_language
from tests.support.written_files import contents, rows_in, write_columns

POSES = """name,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg
near,350,-100,200,180,0,0
middle,450,0,200,180,0,30
far,2000,0,200,180,0,0
"""
JOINTS = ",".join(written_files.JOINTS)


def _files(directory: Path, targets: str = POSES) -> Path:
    path = directory / "targets.csv"
    path.write_text(targets)
    return path


def test_the_chosen_postures_are_written_in_every_form(tmp_path):
    _files(tmp_path)
    done = ran("postures targets.csv --arm ur5 --for ur --part 200,100,50 -o out", cwd=tmp_path)
    assert done.returncode == 3  # one target is out of reach
    assert done.stdout.startswith("This arm ")
    assert "error: targets.csv, line 4: " in done.stderr
    chosen = rows_in(tmp_path / "out" / "postures.csv")
    assert [row["name"] for row in chosen] == ["near", "middle"]
    every = rows_in(tmp_path / "out" / "all-postures.csv")
    expected = [float(row["expected_mm"]) for row in every if row["target"] == "line 2"]
    assert expected == sorted(expected)
    assert len(expected) >= 8
    program = (tmp_path / "out" / "postures_ur5.script").read_text()
    numbers = np.array([float(number) for number in re.findall(r"-?[0-9]+\.[0-9]{8,}", program)])
    for row in chosen:
        for axis in range(1, 7):
            assert np.abs(numbers - np.radians(float(row[f"q{axis}_deg"]))).min() < 1e-6
    assert (tmp_path / "out" / "postures.png").read_bytes().startswith(b"\x89PNG")
    assert "give another --output" in errors_of("postures targets.csv --arm ur5 -o out", cwd=tmp_path)


def test_chosen_postures_are_targets_again(tmp_path):
    _files(tmp_path, "".join(POSES.splitlines(keepends=True)[:3]))
    succeeded("postures targets.csv --arm ur5 -o out", cwd=tmp_path)
    found = json_of("postures out/postures.csv --arm ur5", cwd=tmp_path)
    assert found["usual"]["given"]
    assert found["usual"]["rms_mm"] == pytest.approx(found["sequence"]["rms_mm"], rel=0.02)
    assert found["knowledge"] == "typical"
    assert [target["line"] for target in found["targets"]] == [2, 3]
    assert found["targets"][0]["postures"][0].keys() >= {
        "q_deg",
        "expected_mm",
        "u_mm",
        "approach",
        "covered",
        "branch",
    }


@pytest.mark.parametrize(
    ("targets", "code"),
    [
        ("", "targets.empty"),
        ("x_mm,y_mm\n1,2\n", "targets.column"),
        (f"{JOINTS}\n", "targets.empty"),
        ("x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg\n0.4,0.1,0.2,180,0,0\n", "targets.units"),
        (f"{JOINTS}\n0.4,-1.1,1.2,0.5,1.5,0\n", "targets.units"),
        (f"{JOINTS}\n40,-500,120,3,90,0\n", "targets.limits"),
        (f"{JOINTS}\n40,a,120,3,90,0\n", "table.value"),
    ],
)
def test_other_tables_are_refused(tmp_path, targets, code):
    _files(tmp_path, targets)
    assert failure_of("postures targets.csv --arm ur5 -o out", cwd=tmp_path) == (3, code)
    assert not (tmp_path / "out").exists()


def test_five_axis_arm_reaches_only_poses_of_its_postures(tmp_path):
    taught = [[10.0, 20.0, -30.0, 25.0, 40.0], [-35.0, -20.0, 45.0, -10.0, 15.0]]
    write_columns(tmp_path / "taught.csv", written_files.JOINTS[:5], taught)
    found = json_of("postures taught.csv --arm so-101", cwd=tmp_path)
    for target, row in zip(found["targets"], taught, strict=True):
        away = [np.abs(np.subtract(posture["q_deg"], row)).max() for posture in target["postures"]]
        assert min(away) < 1e-3
    assert errors_of("postures", str(_files(tmp_path)), "--arm", "so-101", cwd=tmp_path).count("error: ") >= 1


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("--arm ur5 --for ur", "postures.option"),
        ("--arm ur5 --part 3,x", "postures.part"),
        ("--arm ur5 --part 0.3,0.2,0.1", "postures.part"),
        ("--arm franka-fr3 --for ur -o out", "postures.option"),
        ("", "usage"),
    ],
)
def test_wrong_use_is_refused(tmp_path, words, code):
    assert failure_of("postures", _files(tmp_path), *words.split(), cwd=tmp_path) == (2, code)


@in_every_language
def test_the_screen_is_in_each_language(tmp_path, language):
    done = ran("postures", str(_files(tmp_path)), "--arm", "ur5", "--lang", language, cwd=tmp_path, COLUMNS="200")
    texts = texts_of(language)
    assert done.stdout.startswith(texts("postures_typical"))
    assert texts("postures_collisions") in done.stdout


def test_every_key_of_the_texts_is_used_with_its_values():
    folder = Path(__file__).parents[4] / "analysis" / "templates"
    keys = [contents(folder / f"texts.{one}.yaml")["words"] for one in LANGUAGES]
    own = [{key for key in words if key.startswith("postures_")} for words in keys]
    assert own[0] == own[1] == own[2]
