"""Statements on the origin of points: the question, its error, exceptions by name, and files of changes."""

import numpy as np
import pytest
import yaml

from analysis.apps.correct import correction_report
from analysis.apps.correct.controller_entries import as_entered, controller_entries
from analysis.apps.correct.correct_rig import correct_rig
from analysis.apps.correct.entered_values import values_in
from analysis.apps.correct.point_question import hints_in
from analysis.apps.correct.stated_points import points_of
from analysis.apps.correct.work_area import WorkArea
from analysis.cli import dialogue
from analysis.correction.corrected_targets import corrected
from analysis.correction.point_origins import ChangedArm, ConvertedPoints
from analysis.correction.support import supports
from analysis.robot.kinematics.arm import arm_of, forward
from rigs.edit import extended
from rigs.effects import JointOffset
from tests.analysis.apps.correct.programs.cells import write_files
from tests.analysis.apps.correct.test_linuxcnc import rig_at
from tests.support.command_line import errors_of, failure_of, json_of, ran, succeeded
from tests.support.refusals import refused
from tests.support.stated_controller import load
from tests.support.written_files import contents
from tests.worlds.arms.faulty_arm import EFFECTS, found, known
from tests.worlds.interpreters.arms import rig_of

ARM = "DECL E6AXIS "
SOURCE = "DEF pick()\nPTP XHOME\nPTP XVIA1\nPTP XPICK\nEND\n"
DATA = (
    "DEFDAT PICK\n; XPICK touched up at the fixture\nDECL E6AXIS XHOME={A1 0, A2 -80, A3 100, A4 -20, A5 80, A6 0}\n"
    "DECL E6AXIS XVIA1={A1 5, A2 -75, A3 95, A4 -25, A5 70, A6 15}\n"
    "DECL E6AXIS XPICK={A1 10, A2 -75, A3 95, A4 -25, A5 70, A6 15}\nENDDAT\n"
)
VALUES = {"joint_zeros": [{"axis": 2, "add_deg": -0.08}, {"axis": 3, "add_deg": 0.15}]}


@pytest.fixture
def cell(tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text(extended(load("ur10e-cell")[1], list(EFFECTS), "cell"))
    write_files(tmp_path, {"pick.src": SOURCE, "pick.dat": DATA})
    (tmp_path / "values.yaml").write_text(yaml.safe_dump(VALUES))
    return path


def command(cell, *options):
    program = ("--program", cell.with_name("pick.src"), "--for", "kuka")
    return ("correct", cell, *program, "-o", cell.with_name("out"), *options)


def test_program_without_a_statement_is_refused_with_both_calls(cell):
    assert failure_of(*command(cell)) == (2, "answer.missing")
    text = errors_of(*command(cell), exit_code=2)
    for kind in ("computed", "taught"):
        assert f"-o {cell.with_name('out')} --points {kind}" in text
    assert "pick.dat line 2" in text and not cell.with_name("out").exists()


def test_question_at_a_terminal_repeats_until_it_is_answered(cell, monkeypatch):
    monkeypatch.setattr(dialogue, "has_person", lambda: True)
    monkeypatch.setattr(dialogue.Dialogue, "_has_typed", lambda self: True)
    answers = f"maybe\ntaught {cell}x\ntaught {cell.with_name('values.yaml')}\n"
    done = succeeded(*command(cell), typed=answers)
    assert done.stderr.count("error:") == 2
    assert contents(cell.with_name("out") / "corrections.yaml")["programs"][0]["points"][0]["treatment"] == "converted"


def test_taught_program_without_a_change_writes_no_program(cell):
    done = json_of(*command(cell, "--points", "taught"))
    (program,) = done["programs"]
    assert done["verdict"] == "correct" and program["corrected"] == 0 and program["left"] == []
    assert program["points"][0] | {"count": 3} == program["points"][0]
    assert program["points"][0]["treatment"] == "unchanged"
    assert [file.name for file in cell.with_name("out").iterdir()] == ["corrections.yaml"]
    assert "program_head_right" in {key for block in done["blocks"] for key in block["keys"]}


def test_mastered_zeros_are_converted_once(cell):
    done = json_of(*command(cell, "--points", "taught", "--since", cell.with_name("values.yaml")))
    (points,) = done["programs"][0]["points"]
    assert points["origin"] == "taught" and points["since"] == "values.yaml" and points["tool_moved_mm"] < 1e-3
    assert points["numbers_moved_mm"]["largest"] > 0.5
    text = (cell.with_name("out") / "pick.dat").read_text()
    assert "XVIA1={A1 5, A2 -75.080000, A3 95.150000, A4 -25, A5 70, A6 15}" in text and "converted by rig" in text
    assert "XHOME={A1 0, A2 -80, A3 100, A4 -20, A5 80, A6 0}" in text
    cell.with_name("pick.dat").write_text(text)
    again = command(cell, "--points", "taught", "--since", cell.with_name("values.yaml"))
    assert failure_of(*again) == (3, "correction.repeated")
    cell.with_name("values.yaml").write_text(yaml.safe_dump({"joint_zeros": [{"axis": 1, "add_deg": 0.1}]}))
    cell.with_name("out").rename(cell.with_name("first"))
    succeeded(*again)


def test_conversion_needs_neither_effects_nor_a_model(cell):
    cell.write_text(load("ur10e-cell")[1])
    succeeded(*command(cell, "--points", "taught", "--since", cell.with_name("values.yaml")))
    cell.with_name("out").rename(cell.with_name("first"))
    succeeded(*command(cell, "--points", "taught"))
    assert failure_of(*command(cell, "--points", "computed")) == (3, "calibration.missing")


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ("--points computed --since values.yaml", "usage"),
        ("--points computed --computed XVIA*", "usage"),
        ("--points taught --taught XHOME", "usage"),
        ("--points taught --computed XVIAA*", "usage"),
        ("--points computed --taught XHOME,P[7]", "usage"),
    ],
)
def test_statements_that_contradict_or_match_nothing_are_refused(options, code, cell, monkeypatch):
    monkeypatch.chdir(cell.parent)
    assert failure_of(*command(cell, *options.split())) == (2, code)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("a: 1\n", "controller.invalid"),
        ("{}", "controller.invalid"),
        ("controller: {name: kuka, entries: []}\n", "controller.invalid"),
    ],
)
def test_file_without_values_is_refused(text, code, cell):
    cell.with_name("values.yaml").write_text(text)
    assert failure_of(*command(cell, "--points", "taught", "--since", cell.with_name("values.yaml"))) == (3, code)


def test_exceptions_by_name_keep_the_other_origin(cell):
    done = json_of(*command(cell, "--points", "taught", "--computed", "xvia*"))
    groups = {group["origin"]: group for group in done["programs"][0]["points"]}
    assert groups["taught"]["count"] == 2 and groups["taught"]["treatment"] == "unchanged"
    assert groups["computed"]["count"] == 1 and groups["computed"]["numbers_moved_mm"]["largest"] > 0.1
    lines = (cell.with_name("out") / "pick.dat").read_text().splitlines()
    assert [line in lines for line in DATA.splitlines()] == [True, True, True, False, True, True]


def test_computed_points_stay_if_values_at_the_controller_correct_them(cell):
    options = ("--points", "taught", "--computed", "XVIA1", "--since", cell.with_name("values.yaml"))
    done = json_of(*command(cell, *options))
    groups = {group["origin"]: group["treatment"] for group in done["programs"][0]["points"]}
    assert groups == {"taught": "converted", "computed": "unchanged"}


def test_folder_of_programs_states_the_origin_of_each(tmp_path, cell):
    folder = tmp_path / "programs"
    texts = {f"{name}.script": "movej([0,-1.4,1.7,-0.3,1.4,0])\n" for name in ("a", "b")}
    write_files(folder, texts)
    words = ("correct", cell, "--program", folder, "-o", tmp_path / "out", "--points", "computed")
    done = json_of(*words, "--taught", "a.script:movej")
    assert [program["points"][0]["origin"] for program in done["programs"]] == ["taught", "computed"]
    assert sorted(file.name for file in (tmp_path / "out").glob("*.script")) == ["b.script"]


@pytest.mark.parametrize(("name", "code"), [("movej", 2), ("*:movej", 0), ("a.script:movej,b.script:movej", 0)])
def test_name_of_points_in_several_files_needs_a_file(name, code, tmp_path, cell):
    folder = tmp_path / "programs"
    write_files(folder, {f"{name}.script": "movej([0,-1.4,1.7,-0.3,1.4,0])\n" for name in ("a", "b")})
    done = ran("correct", cell, "--program", folder, "-o", tmp_path / "out", "--points", "computed", "--taught", name)
    assert done.returncode == code
    assert ("a.script, b.script" in done.stderr) == bool(code)


@pytest.mark.parametrize("maker", ["kuka", "fanuc", "ur"])
def test_written_values_are_read_as_they_were_computed(maker, tmp_path):
    """The changed controller computes the poses of corrected targets for a controller with these entries."""
    rig = known(rig_of({"kuka": "kuka-kr-10-r1100-2", "fanuc": "paper-fanuc", "ur": "ur10e"}[maker]))
    correction_report.write(correct_rig(rig, None, maker), tmp_path / "out")
    change = values_in(rig, tmp_path / "out" / "corrections.yaml")
    q = np.radians([[10.0, -70, 90, 20, 60, 30], [20, -80, 80, -30, 70, 10]])
    supported = supports(rig)
    targets = corrected(rig, supported, q)
    entered = as_entered(rig, targets, controller_entries(WorkArea(rig, supported), maker))
    origin = ConvertedPoints(rig, change)
    new = origin.renew(targets.q, targets.T)
    done = targets.done
    assert done.any()
    np.testing.assert_allclose(new.q[done], entered.q[done], atol=1e-9)
    np.testing.assert_allclose(new.T[done], entered.T[done], atol=1e-5)


def test_table_of_constants_states_the_change_from_the_controller(tmp_path):
    rig = known(rig_of("ur10e"))
    correction_report.write(correct_rig(rig, None), tmp_path)
    (constant,) = values_in(rig, tmp_path / "dh.csv").constants
    assert (constant.axis, constant.field, constant.delta) == (3, "a", pytest.approx(0.4, abs=1e-9))
    assert values_in(rig, tmp_path / "corrections.yaml").constants == (constant,)


@pytest.mark.parametrize("name", ["rig-arm.hal", "home-offsets.ini"])
@pytest.mark.parametrize("unit", ["mm", "inch"])
def test_files_of_linuxcnc_state_pins_and_home_offsets_together(tmp_path, name, unit):
    arm = tmp_path / unit
    arm.mkdir()
    rig = rig_at(arm, unit, EFFECTS[:3])
    correction_report.write(correct_rig(rig, None, "linuxcnc"), tmp_path / "out")
    change, stated = (values_in(rig, tmp_path / "out" / file) for file in (name, "corrections.yaml"))
    q = np.radians([[2.0, 45, -3, 180, 42, 2], [20, 30, 10, 160, -30, 40]])
    new, same = (ConvertedPoints(rig, each).renew(q, forward(arm_of(rig.robot), q)) for each in (change, stated))
    np.testing.assert_allclose(new.T, same.T, atol=1e-5)
    assert np.abs(np.degrees(new.q - q)).max() > 0.01


def test_new_constants_do_not_change_joint_targets(cell):
    """The controller drives to the same joint angles, so the tool stays without a conversion."""
    values = {"link_constants": [{"axis": 3, "key": "a_mm", "nominal": 0.0, "corrected": 0.8}]}
    cell.with_name("values.yaml").write_text(yaml.safe_dump(values))
    done = json_of(*command(cell, "--points", "taught", "--since", cell.with_name("values.yaml")))
    (points,) = done["programs"][0]["points"]
    assert points["treatment"] == "converted" and points["numbers_moved_mm"] == {"largest": 0.0, "rms": 0.0}
    assert (cell.with_name("out") / "pick.dat").read_text() == DATA


def test_calibration_of_another_type_of_arm_is_refused(cell):
    rig, other = load(cell)[0], cell.with_name("other.yaml")
    other.write_text(extended(load("paper-fanuc")[1], list(EFFECTS), "other"))
    with refused("robot.other", "FANUC-like elbow arm, uncoupled"):
        points_of(rig, "taught", other)
    other.write_text(load("ur10e-cell")[1])
    with refused("calibration.missing", "calibration, so the arm is unknown"):
        points_of(rig, "taught", other)


def test_points_of_another_arm_are_corrected_by_the_difference(cell):
    other = cell.with_name("other.yaml")
    text = load("ur10e-cell")[1].replace("robot:\n", "robot:\n  serial: B7\n", 1)
    other.write_text(extended(text, [JointOffset(axis=3, offset_deg=0.2, found=found(offset_deg=0.002))], "other"))
    origin = points_of(load(cell)[0], "taught", other).origin
    assert isinstance(origin, ChangedArm) and origin.is_another_arm
    done = succeeded(*command(cell, "--points", "taught", "--since", other))
    words = " ".join(done.stdout.split())
    assert "taught at another arm" in words and "master axis" not in words
    assert contents(cell.with_name("out") / "corrections.yaml")["joint_zeros"] == []


def test_only_remarks_and_names_of_systems_are_hints(tmp_path):
    texts = {
        "taught.src": "DEF taught( )\n; made with RoboDK\n; touched up on Monday\nEND\n",
        "plain.src": "DEF teach()\nTOUCHUP(1)\nEND\n",
        "form.src": "DEF a()\n;FOLD PTP P1 Vel=100 % PDAT1 Tool[1] Base[0];%{PE}%R 5.2\nEND\n",
    }
    write_files(tmp_path, texts)
    hints = hints_in([tmp_path])
    assert sorted((hint.file, hint.line, hint.kind) for hint in hints) == [
        ("form.src", 2, "taught"), ("taught.src", 2, "computed"), ("taught.src", 3, "taught")
    ]  # fmt: skip


def test_a_conversion_in_vain_says_not_to_run_the_program(cell):
    cell.with_name("pick.src").write_text("DEF pick()\nPTP XHOME\nEND\n")
    text = succeeded(*command(cell, "--points", "taught", "--since", cell.with_name("values.yaml"))).stdout
    words = " ".join(text.split())
    assert words.startswith("No point of pick.src was converted") and "do not run it before" in words
