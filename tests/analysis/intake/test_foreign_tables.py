import io
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest

from analysis import load_run
from analysis.cli import import_
from analysis.cli.dialogue import Dialogue
from analysis.intake.imports import propose_map
from analysis.intake.raw_table import layout_of, read_raw
from analysis.intake.table_map import load_map, map_text, parse_map
from analysis.runs.tables import PoseTable
from daq.store import read_run
from rigs.errors import FileError
from tests.support.command_line import ran
from tests.support.drawn_tables import drawn_tables, judged
from tests.support.foreign_tables import Foreign, Poses, foreign_tables, poses, rows, text, tried
from tests.support.nightly import cases
from tests.support.refusals import refused

TABLES = foreign_tables()
DAMAGE = [b'"', b",", b"\n", b"nan", b"1e400", b"#", b"\xff\xfe", b"''", b"\r", b";;;", b"[mm]", b"\0", b"-", b" "]
JOINTS = [f"joint_{k}" for k in range(1, 7)]


def imported(path: Path, run: Path, *options: str | Path) -> CompletedProcess[str]:
    return ran("import", path, "--rig", "ur10e-cell", "--test", "pose", "-o", run, *options)


def named(name: str) -> Foreign:
    return next(one for one in TABLES if one.name == name)


@pytest.mark.parametrize("foreign", TABLES, ids=lambda one: one.name)
def test_a_table_is_imported_or_asked_about_or_refused(foreign, tmp_path):
    if not foreign.is_here:
        pytest.skip("no data")
    done = tried(foreign, tmp_path)
    assert (done.outcome, done.asked, done.wrong) == (foreign.outcome, foreign.asks, ""), done.said


def test_the_run_keeps_the_map_which_imports_the_next_file(tmp_path):
    assert tried(named("kuka"), tmp_path).outcome == "without a word"
    kept = read_run(tmp_path / "run").manifest.table
    assert not kept.assumed
    done = ran(f"export {tmp_path}/run --to map -o {tmp_path}/again.yaml")
    assert done.returncode == 0 and (tmp_path / "again.yaml").read_text() == kept.map
    done = ran(f"import {tmp_path}/kuka.csv --rig ur10e-cell --test pose -o {tmp_path}/b --map {tmp_path}/again.yaml")
    assert done.returncode == 0, done.stderr
    assert read_run(tmp_path / "b").table.equals(read_run(tmp_path / "run").table)


def test_open_question_is_refused_and_its_answer_imported(tmp_path):
    foreign = named("jacobi-like")
    assert tried(foreign, tmp_path).asked == ("residual",)
    proposed = tmp_path / "run.map.yaml"
    command = f"import {tmp_path}/jacobi-like.csv --rig ur10e-cell --test pose -o {tmp_path}/a --map {proposed}"
    done = ran(command)
    assert done.returncode == 3 and "not answered" in done.stderr
    answer = next(line[4:].split("  #")[0] for line in proposed.read_text().splitlines() if line.startswith("#   {"))
    proposed.write_text(proposed.read_text().replace('"?"', answer))
    assert ran(command).returncode == 0
    table = load_run(tmp_path / "a").table
    assert isinstance(table, PoseTable) and foreign.truth
    assert np.abs(table.xyz_mm - foreign.truth.xyz_mm).max() < 1e-5


def test_a_person_at_a_terminal_is_asked(tmp_path, monkeypatch):
    foreign = named("jacobi-like")
    screen, answers = io.StringIO(), iter(["3", "x", "2"])
    monkeypatch.setattr(Dialogue, "line", lambda self, prompt: (screen.write(prompt), next(answers))[1])
    monkeypatch.setattr(import_, "has_person", lambda: True)
    done = ran("import", *foreign.written(tmp_path), "--rig", "ur10e-cell", "--test", "pose", "-o", tmp_path / "a")
    assert done.returncode == 0, done.stderr
    assert "1  x_dif … z_dif " in done.stderr
    table = load_run(tmp_path / "a").table
    assert isinstance(table, PoseTable) and foreign.truth
    target = foreign.truth.xyz_mm.round(1)
    assert np.abs(table.xyz_mm - (2 * target - foreign.truth.xyz_mm)).max() < 1e-5


def with_header(p: Poses, header: list[str], *columns: np.ndarray, tmp_path: Path) -> Path:
    path = tmp_path / "t.csv"
    path.write_bytes(text(rows(*columns), header))
    return path


def test_misfitting_unit_of_the_header_is_a_question(tmp_path):
    p = poses()
    header = [*(f"{name}_rad" for name in JOINTS), "x_mm", "y_m", "z_mm"]
    header[-3:] = ["tracker_x_m", "tracker_y_m", "tracker_z_m"]
    path = with_header(p, header, np.degrees(p.q), p.xyz_mm / 1e3, tmp_path=tmp_path)
    proposal = propose_map([path], "ur10e")
    assert [question.key for question in proposal.questions] == ["joints"]
    assert "order" in proposal.questions[0].asks
    assert proposal.table_map.joints and proposal.table_map.joints.unit == "deg"


def test_a_time_before_columns_without_names_is_no_joint(tmp_path):
    p = poses()
    table = np.column_stack([np.linspace(0, 17.3, len(p.q)), np.degrees(p.q), p.xyz_mm])
    np.savetxt(tmp_path / "t.csv", table, "%.5f", ",")
    found = propose_map([tmp_path / "t.csv"], "ur10e").table_map
    assert found.joints and found.joints.columns == tuple(f"column {k}" for k in range(2, 8))
    assert found.place and found.place.columns == tuple(f"column {k}" for k in range(8, 11))


def test_joints_numbered_in_brackets_are_read_and_a_second_joint_column_is_refused(tmp_path):
    p = poses()
    in_brackets = [f"Joint ({k})" for k in range(1, 7)]
    path = with_header(p, [*in_brackets, "x_mm", "y_mm", "z_mm"], np.degrees(p.q), p.xyz_mm, tmp_path=tmp_path)
    found = propose_map([path], "ur10e").table_map
    assert found.joints and found.joints.columns == tuple(in_brackets)
    path = with_header(p, ["joint"] * 6 + ["x_mm", "y_mm", "z_mm"], np.degrees(p.q), p.xyz_mm, tmp_path=tmp_path)
    with refused("table.invalid", "has two columns joint"):
        propose_map([path], "ur10e")


def test_arm_with_a_far_wrong_zero_is_imported_with_a_doubt(tmp_path):
    p = poses()
    q_deg, off_deg = np.degrees(p.q), np.array([0, 0, 4.0, 0, 0, 0])
    path = with_header(p, [*JOINTS, "x", "y", "z"], q_deg + off_deg, p.xyz_mm, tmp_path=tmp_path)
    proposal = propose_map([path], "ur10e")
    assert [question.key for question in proposal.questions] == []
    assert "far wrong" in proposal.table_map.assumed[0]
    farther = with_header(p, [*JOINTS, "x", "y", "z"], q_deg + 3 * off_deg, p.xyz_mm, tmp_path=tmp_path)
    (question,) = propose_map([farther], "ur10e").questions
    assert question.readings[1].value.zeros_deg[2] == pytest.approx(-12, abs=0.5)


def test_short_table_in_metres_is_refused_with_map_and_command(tmp_path):
    p, names = poses(), [*(f"q{axis}_deg" for axis in range(1, 7)), "x_m", "y_m", "z_m"]
    path = with_header(p, names, np.degrees(p.q), 1e-3 * p.xyz_mm, tmp_path=tmp_path)
    path.write_text("\n".join(path.read_text().splitlines()[:6]) + "\n")
    with refused("readings.too_few", "determine the meaning of the columns") as told:
        propose_map([path], "ur10e")
    written = told.value.remedy.partition("save ")[2].partition(" as MAP.yaml")[0]
    (tmp_path / "MAP.yaml").write_text(written)
    command = told.value.remedy.rpartition("run rig ")[2].replace("RIG", "ur10e").replace("RUN", str(tmp_path / "r"))
    done = ran(*command.replace("MAP.yaml", str(tmp_path / "MAP.yaml")).split())
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda lines: [*lines[:5], lines[5].rsplit(",", 1)[0], *lines[6:]], "line 6: has 8 fields, the table 9"),
        (
            lambda lines: [*lines[:5], lines[5].replace(lines[5].split(",")[2], "nan", 1), *lines[6:]],
            "line 6, joint_3: 'nan'",
        ),
        (lambda lines: lines[:8], "too few"),
        (lambda lines: [line.rsplit(",", 1)[0] for line in lines], "lacks columns x, y, z of a place"),
    ],
)
def test_a_bad_table_is_refused_in_words(change, says, tmp_path):
    p = poses()
    path = with_header(p, [*JOINTS, "x", "y", "z"], np.degrees(p.q), p.xyz_mm, tmp_path=tmp_path)
    good = propose_map([path], "ur10e").table_map
    path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")
    done = imported(path, tmp_path / "run")
    if done.returncode == 3 and says not in done.stderr:  # a bad cell hides its column from the proposal
        (tmp_path / "m.yaml").write_text(map_text(good))
        done = ran(f"import {path} --rig ur10e-cell --test pose -o {tmp_path}/run --map {tmp_path}/m.yaml")
    assert done.returncode == 3 and says in done.stderr, done.stderr


def test_a_circle_is_imported_by_a_map(tmp_path):
    assert ran(f"simulate paper-fanuc --test yaw -o {tmp_path}/sim").returncode == 0
    run = next(path for path in (tmp_path / "sim").iterdir() if "acw" in path.name)
    table = load_run(run).to_table().to_pandas()
    foreign = table.rename(columns={"t_s": "time", "g1_mm": "probe 1", "g2_mm": "probe 2"}).drop(columns="direction")
    foreign["time"] *= 1e3
    for k in range(1, 7):
        foreign[f"q{k}_deg"] = np.radians(foreign[f"q{k}_deg"])
    foreign.to_csv(tmp_path / "lap.csv", sep=";", decimal=",", index=False)
    (tmp_path / "map.yaml").write_text(
        "files: [{separator: semicolon, decimal: comma}]\n"
        "joints: {columns: [q1_deg, q2_deg, q3_deg, q4_deg, q5_deg, q6_deg], unit: rad}\n"
        "columns: {t_s: {column: time, unit: ms}, g1_mm: {column: probe 1}, g2_mm: {column: probe 2}}\n"
    )
    words = ("--rig", "paper-fanuc", "--test", "yaw", "--direction", "acw", "--map", tmp_path / "map.yaml")
    done = ran("import", tmp_path / "lap.csv", *words, "-o", tmp_path / "lap")
    assert done.returncode == 0, done.stderr
    again = load_run(tmp_path / "lap").to_table().to_pandas()
    for name in ("t_s", "q3_deg", "g1_mm", "g2_mm"):
        assert np.allclose(again[name], table[name], atol=1e-9)


def test_map_reports_every_mistake_with_its_line(tmp_path):
    path = tmp_path / "map.yaml"
    path.write_text(
        "files: [{separator: comma}]\njoints: {columns: [a], unit: turns}\nturn: {columns: [a, b], form: moving xxy}\n"
    )
    with pytest.raises(FileError) as caught:
        load_map(path)
    said = " ".join(caught.value.lines())
    assert "line 2, joints" in said and "line 3, turn" in said


def test_a_map_that_is_written_is_read_as_it_was(tmp_path):
    foreign = named("leica")
    table_map = propose_map(foreign.written(tmp_path), foreign.rig, foreign.options[1]).table_map
    assumed = table_map.model_copy(update={"assumed": ("the sign: 'as' it \"was\", # nobody knows",)})
    for one in (table_map, assumed):
        assert parse_map(map_text(one), "m") == one


@pytest.mark.parametrize("seed", range(6))
def test_a_damaged_table_is_read_or_refused_in_one_line(seed, tmp_path):
    rng = np.random.default_rng(seed)
    chosen = [one for one in TABLES if not one.real]
    foreign = chosen[int(rng.integers(len(chosen)))]
    files = []
    for name, content in foreign.files.items():
        data = bytearray(content)
        for _ in range(int(rng.integers(1, 5))):
            at = int(rng.integers(len(data)))
            data[at : at + int(rng.integers(0, 60))] = bytes(rng.choice(DAMAGE))
        files.append(tmp_path / name)
        files[-1].write_bytes(bytes(data or b"x"))
    try:
        propose_map(files, foreign.rig, foreign.options[1] if foreign.options else "")
    except FileError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize(("line", "lost"), [("###,2.5,3.5", False), ("#1.5,2.5,3.5", True), ("### a remark", True)])
def test_a_number_too_wide_for_its_cell_begins_no_comment(line, lost):
    lines = ["1.0,2.0,3.0", "4.0,5.0,6.0", line, "7.0,8.0,9.0"]
    raw = read_raw(lines, layout_of(lines, "utf-8", "a.csv"), "a.csv")
    assert (3 in raw.lines.tolist()) is not lost


DRAWN = drawn_tables()
# Two files without a header, of which one has decimal commas; a tracker that was moved before the last six of 25 rows;
# a sound arm within 0.1 mm of its nominal constants.
EACH_COMMIT = ["old-155", "old-520", "old-538"]


@pytest.mark.cpu_limit(120)
@pytest.mark.parametrize("name", cases(DRAWN, EACH_COMMIT))
def test_drawn_table_is_read_correctly_or_questioned(name, tmp_path):
    table = DRAWN[name]
    done = judged(table, tmp_path)
    assert not done.wrong, done.lines
    assert done.outcome != "wrong guess", done.lines
    if table.sound:
        assert done.outcome != "refused", done.lines
