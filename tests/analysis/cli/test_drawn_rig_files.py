"""Rig files with one part missing, or in another unit, through the commands that take a rig file: each ends in a line
that says what is wrong, before anything is driven or written, and none in a traceback."""

from pathlib import Path

import numpy as np
import pytest

from analysis.apps.planning import pose_plan
from rigs.errors import RigError
from rigs.load import load
from rigs.readiness import missing_for, readiness_lines
from rigs.schema.vocabulary import OF_ISO9283
from tests.support.command_line import ran
from tests.support.drawn_rig_files import DrawnFile, drawn
from tests.support.written_files import JOINTS, write_columns

_COMMANDS = """\
check CELL
program CELL --for ur --test yaw -o made
program CELL --for ur --test radial -o made
import circle.csv --rig CELL --test yaw -o made
import touches.csv --rig CELL --test touch -o made
export-urdf CELL -o made
correct CELL -o made
versions CELL
plan CELL --poses 6 -o made
simulate CELL --test yaw --direction acw -o made
simulate CELL --test roll --direction acw -o made
simulate CELL --test radial -o made
simulate CELL --test repeatability -o made
simulate CELL --test iso9283 -o made"""
_CODES = (0, 2, 3, 4)


def told(folder: Path, file: DrawnFile, *words: str) -> tuple[int, str]:
    (folder / "cell.yaml").write_text(file.text)
    done = ran(*("cell.yaml" if word == "CELL" else word for word in words), cwd=folder)
    assert done.returncode in _CODES and "Traceback" not in done.stderr, (file.title, words, done.stderr)
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert bool(errors) == bool(done.returncode), (file.title, words, done.stderr)
    made = folder / "made"
    assert not errors or not [path for path in made.rglob("*") if path.name != ".lock"], (file.title, words)
    return done.returncode, errors[0] if errors else ""


@pytest.mark.cpu_limit(120)
@pytest.mark.parametrize("seed", (0, 3, 17))
def test_one_mistake_is_answered_in_a_line(seed, tmp_path, monkeypatch):
    monkeypatch.setattr(pose_plan, "_POOL", 60)
    file = drawn(seed)
    try:
        (tmp_path / "cell.yaml").write_text(file.text)
        rig, _ = load(tmp_path / "cell.yaml")
    except RigError as error:
        rig, line = None, error.lines()[0].replace(f"{tmp_path}/", "")
    for number, words in enumerate(map(str.split, _COMMANDS.splitlines())):
        folder = tmp_path / str(number)
        folder.mkdir()
        tables(folder)
        code, first = told(folder, file, *words)
        if rig is None:
            assert code == 3 and line in first, (file.title, words, first)
        if rig is not None and words[0] == "simulate":
            test = words[3]
            tests = OF_ISO9283 if test == "iso9283" else (test,)
            missing = missing_for(rig, tests[0])
            assert not missing or f"cell.yaml: {missing[0].problem}" in first, (file.title, words, first)
            assert not missing or missing[0].key in "\n".join(readiness_lines(rig))


def tables(folder: Path) -> None:
    t_s = np.arange(20.0)
    q, g_mm = t_s[:, None] + 10.0 * np.arange(6), np.tile([0.1, 0.2], (20, 1))
    names = ["t_s", "direction", *JOINTS, "g1_mm", "g2_mm"]
    write_columns(folder / "circle.csv", names, t_s, np.full(20, "acw"), q, g_mm)
    write_columns(folder / "touches.csv", ["socket", *JOINTS], ["A", "B"] * 10, q)
