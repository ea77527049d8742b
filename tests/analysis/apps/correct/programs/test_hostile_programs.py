"""Files that are no programs, or programs that mean harm: one line, or what cannot be corrected is listed, in time."""

import json
import re
from pathlib import Path

import pytest

from analysis.apps.correct.corrected_program import CorrectedProgram, correct_program
from analysis.apps.correct.program_report import blocks
from analysis.apps.correct.stated_frames import frames_of
from analysis.apps.correct.stated_points import computed_points
from analysis.correction.support import ANYWAY
from analysis.robot.description.controller_constants import largest_correction_mm
from rigs.arms import load_arm
from rigs.edit import extended
from rigs.effects import Backlash, Compliance, Effect, JointOffset
from tests.support.answers import words_of
from tests.support.command_line import errors_of, failure_of, ran, succeeded
from tests.support.stated_controller import load
from tests.support.written_files import contents
from tests.worlds.arms.faulty_arm import EFFECTS, found, known

RIG = known(load("ur10e-cell")[0])
MANY = 10_000


def _corrected(path: Path, *effects: Effect) -> CorrectedProgram:
    rig = RIG.model_copy(update={"effects": effects or EFFECTS})
    return correct_program(computed_points(rig), path, frames_of(rig.robot, ["tcp=rig"], []), None)


@pytest.fixture
def cell(tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text(extended(load("ur10e-cell")[1], list(EFFECTS), "cell"))
    return path


@pytest.fixture
def script(tmp_path):
    path = tmp_path / "a.script"
    path.write_text("movej([0,-1.4,1.7,-0.3,1.4,0])\n")
    return path


@pytest.mark.parametrize(
    ("name", "data", "code"),
    [
        ("a.txt", b"movej([0,0,0,0,0,0])", "program.invalid"),
        ("a.dat", b"DEFDAT A\nENDDAT\n", "program.invalid"),
        ("a.script", b"\x7fELF\x00\x00", "file.invalid"),
        ("a.ls", "/PROG A".encode("utf-16"), "file.invalid"),
        ("a.mod", b"x" * 10_000_001, "file.too_large"),
        ("gone.jbi", None, "file.unreadable"),
    ],
)
def test_other_files_are_refused(name, data, code, tmp_path, cell):
    path = tmp_path / name
    if data is not None:
        path.write_bytes(data)
    assert failure_of(f"correct {cell} --program {path} --points computed -o {tmp_path}/out") == (3, code)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.script", "movej(" + "[" * MANY + "]" * MANY + ")\n"),
        ("a.script", "movej(" + "get_inverse_kin(" * MANY + ")" * MANY + ")"),
        ("a.script", "movej([" + "1" * MANY * 100 + "])"),
        ("a.mod", "a " * MANY * 10),
        ("a.mod", "CONST robtarget p" + " " * MANY * 10 + "x;"),
        ("a.src", " " * MANY * 10 + "\n$BASE=x" + " " * MANY * 10 + "x\nLIN x" + " " * MANY * 10 + "x\n"),
        ("a.ls", "/MN\n" + " " * MANY * 10 + "\n 1:" + "P[1:" * MANY * 10 + "\n"),
        ("a.jbi", " " * MANY * 10 + "\n///RCONF " + "9" * MANY + "\n//INST\n" + " " * MANY * 10),
        ("a.script", "movel(p[1e999, nan, inf, 0, 0, 0])\nmovej([1e308, 0, 0, 0, 0, 1e999])\n"),
        ("a.mod", "CONST robtarget p:=" + "[" * MANY + "1" + "]" * MANY + ";\nMoveL p,v,z,t;\n"),
        ("a.mod", "MoveL [[1e999,2,3],[0,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v1,fine,tool0;\n" + "IF " * MANY),
        (
            "a.src",
            "DEF a()\n$BASE={X 1e999, Y 0, Z 0, A 0, B 0, C 0}\nPTP {X 1, Y 2, Z 3, A 0, B 0, C 0, S 2, T 1e9}\n",
        ),
        (
            "a.src",
            "DEF a()\n$BASE={X 2e5, Y 0, Z 0, A 0, B 0, C 0}\nPTP {X 3e5, Y 2, Z 3, A 0, B 0, C 500, S 2, T 1}\n",
        ),
        ("a.ls", "/MN\n 1:J P[99999999999] 1% FINE ;\n/POS\nP[1]{UF:0,UT:0,CONFIG:'N U T, 999999999, 0, 0',X=1 mm};\n"),
        ("a.jbi", "///POSTYPE BASE\n///RECTAN\nC00000=1e999,nan,,,,\nC1=" + "1," * MANY + "\n//INST\nMOVJ C00000\n"),
    ],
)
def test_a_hostile_program_is_read_to_its_end_and_stays_as_it_is(name, text, tmp_path):
    path = tmp_path / name
    path.write_text(text)
    assert _corrected(path).files[name] == text.encode() or name == "a.script"


def test_no_text_of_a_program_reaches_the_terminal_raw(tmp_path, cell):
    path = tmp_path / "a.script"
    path.write_bytes(b"movej(\x1b[31mred\x1b[0m)\nmovej(evil\xe2\x80\xae)\n")
    done = succeeded(f"correct {cell} --program {path} --points computed -o {tmp_path}/out")
    assert "\x1b" not in done.stdout and "\x1b" not in done.stderr


@pytest.mark.parametrize(("arm", "most_mm"), [("ur10e", 15.5), ("fanuc-lr-mate-200id", 7.2)])
def test_largest_correction_scales_with_the_reach(arm, most_mm):
    assert largest_correction_mm(load_arm(arm).robot) == pytest.approx(most_mm, abs=0.1)


def test_a_correction_beyond_what_is_plausible_is_refused(script):
    huge = JointOffset(axis=1, offset_deg=1.1, found=found(offset_deg=0.01))
    refused = _corrected(script, huge)
    assert [one.reason for one in refused.left] == ["too_large"]
    assert refused.files["a.script"] == script.read_bytes()


def test_gravity_is_corrected_and_a_target_outside_the_driven_range_is_marked(tmp_path):
    """The twist under gravity is corrected as modelled. The joint zero is known only in another range."""
    path = tmp_path / "a.script"
    path.write_text("movej([0,-1.4,1.7,-0.3,1.4,0])\nmovej([1.5,-1.4,1.7,-0.3,1.4,0])\n")
    driven = ((-20.0, 20.0), *(((-180.0, 180.0),) * 5))
    soft = Compliance(axis=2, deg_per_Nm=1e-3, payload_kg=10, found=found(deg_per_Nm=1e-5))
    soft = soft.model_copy(update={"found": found(deg_per_Nm=1e-5).model_copy(update={"joints_deg": driven})})
    done = _corrected(path, soft)
    assert done.unknown[0] == "" and done.moved_mm.min() > 0.1
    assert re.fullmatch(r"axis \d \(\w+\) .*°, .*° to .*°", done.unknown[1])
    assert f": {done.unknown[1]}" in "\n".join(words_of(blocks(done)))


def test_command_writes_the_program_and_reports_it(tmp_path, cell):
    path, out = tmp_path / "a.script", tmp_path / "out"
    path.write_text("movej([0,-1.4,1.7,-0.3,1.4,0])\nmovel(p[0.5,0.2,0.3,0,3.1,0])\nmovej(home)\n")
    given = path.read_bytes()
    done = succeeded(f"correct {cell} --program {path} --points computed -o {out}")
    assert path.read_bytes() == given != (out / "a.script").read_bytes()
    assert "1 target corrected, 2 places unchanged" in done.stdout
    assert "movel (line 2)" in done.stdout
    assert "reduced speed" in done.stderr
    (held,) = contents(out / "corrections.yaml")["programs"]
    assert held["corrected"] == 1 and [one["line"] for one in held["left"]] == [2, 3]
    for folder in (out, tmp_path):
        assert "exists already" in errors_of(f"correct {cell} --program {path} --points computed -o {folder}")
    assert path.read_bytes() == given
    whole = ran(f"correct {cell} --program {path} --points computed -o {out}2 --json --all-or-nothing")
    assert whole.returncode == 3 and "a.script" in whole.stderr and "next:" not in whole.stderr
    assert json.loads(whole.stdout)["programs"][0]["targets"][0]["line"] == 1


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("--tool 1 --program a.script --points computed", "usage"),
        ("--tool 1=1,2 --program a.script --points computed", "usage"),
        ("--frame 1=nan,0,0,0,0,0 --program a.script --points computed", "usage"),
        ("--frame 1=rig --program a.script --points computed", "usage"),
        ("--start-joints 0,0,0,0,0,0", "usage"),
        ("--near 0,-80,100,-20,80,0", "usage"),
    ],
)
def test_options_of_programs_without_a_value_or_a_program_are_refused(words, code, script, cell):
    assert failure_of(f"correct {cell} -o out {words}", cwd=script.parent) == (2, code)


def test_a_start_from_which_no_posture_comes_is_said(tmp_path, script, cell):
    done = succeeded(
        f"correct {cell} --program {script} --points computed -o {tmp_path}/out --start-joints 0,-80,100,-20,80,0"
    )
    assert "a.script: --start-joints" in done.stderr


@pytest.mark.parametrize(("text", "reasons"), [("x=1\n", []), ("movej([0,-9,0,0,0,0])\n", ["beyond_limits"])])
def test_program_without_corrections_is_read_despite_a_play(text, reasons, tmp_path):
    path = tmp_path / "a.script"
    path.write_text(text)
    done = _corrected(path, *EFFECTS, Backlash(axis=1, width_deg=0.2))
    assert [target.reason for target in done.left] == reasons and not done.names and not len(done.u_mm)


def test_computed_points_that_are_left_are_not_called_taught(tmp_path, cell):
    path = tmp_path / "a.script"
    path.write_text("set_tcp(p[0,0,0,0,0,0])\nmovel(p[-0.5, -0.17, 0.6, 0, 3.14, 0])\n")
    done = ran(f"correct {cell} --program {path} --points computed -o {tmp_path}/out")
    words = " ".join(done.stdout.split())
    assert "state it: --near" in words
    assert "taught points" not in words


def test_programs_of_one_name_are_refused(tmp_path, cell):
    paths = [tmp_path / name / "a.script" for name in ("x", "y")]
    for path in paths:
        path.parent.mkdir()
        path.write_text("movej([0,-1.4,1.7,-0.3,1.4,0])\n")
    words = ("--program", paths[0], "--program", paths[1], "--points", "computed", "-o", tmp_path / "out")
    assert failure_of("correct", cell, *words) == (3, "output.invalid")


def test_a_program_of_another_makers_robot_is_refused_unless_it_is_said(tmp_path, cell):
    path = tmp_path / "a.src"
    path.write_text("DEF a()\nPTP {A1 0, A2 -80, A3 100, A4 -20, A5 80, A6 0}\nEND\n")
    for words in ((), ("--for", "fanuc")):
        code = failure_of("correct", cell, "--program", path, "--points", "computed", "-o", tmp_path / "out", *words)
        assert code == (3, "robot.other")
    assert not (tmp_path / "out").exists()
    done = succeeded(f"correct {cell} --program {path} --points computed -o {tmp_path}/out --for kuka")
    assert "a.src (kuka): 1 target corrected" in done.stdout


@pytest.mark.parametrize(
    "effect",
    [JointOffset(axis=3, offset_deg=0.0008, found=found(offset_deg=0.00079)), Backlash(axis=1, width_deg=0.02)],
    ids=["a sound arm", "a play alone"],
)
def test_no_program_is_written_without_a_gain(effect, tmp_path, script, cell):
    cell.write_text(extended(load("ur10e-cell")[1], [effect], "cell"))
    out = tmp_path / "out"
    done = ran(f"correct {cell} --program {script} --points computed -o {out} --json")
    assert done.returncode == 3 and json.loads(done.stderr.splitlines()[-1])["error"]["code"] == "correction.impossible"
    assert "next:" not in done.stderr and [file.name for file in out.iterdir()] == ["corrections.yaml"]
    assert contents(out / "corrections.yaml")["verdict"] == "nothing"
    succeeded(f"correct {cell} --program {script} --points computed -o {tmp_path}/anyway --anyway")
    assert ANYWAY in (tmp_path / "anyway" / "a.script").read_text()
    assert "next:" not in ran(f"correct {cell} -o {tmp_path}/bare --anyway").stderr


def test_corrected_program_excludes_values_to_enter(tmp_path, script, cell):
    """Programs and entered values together would correct twice."""
    out = tmp_path / "out"
    done = ran(f"correct {cell} --program {script} --points computed -o {out}")
    assert "calibration.conf" in ran(f"correct {cell} -o {tmp_path}/entered").stdout
    assert "calibration.conf" not in done.stdout and "correct twice" in " ".join(done.stdout.split())
    assert "--for" not in done.stderr
    assert contents(out / "corrections.yaml")["controller"] is None
