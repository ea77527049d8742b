"""Programs of ABB: a rail, a start posture, variants of a program, patterns, and the configuration of a target."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.apps.makers.abb.instructions import EFFECTS, FUNCTIONS, MOVE, SWITCHES
from analysis.apps.makers.reading import programs_at
from rigs.schema.robot import Rail
from tests.analysis.apps.correct.programs.cases import case_of, cases_of
from tests.analysis.apps.correct.programs.cells import (
    ABB_TOOL,
    abb_files,
    corrected,
    corrected_cell,
    corrected_files,
    module_of,
    robtarget_of,
    write_files,
)
from tests.support.changed_rigs import with_robot
from tests.worlds.arms.faulty_arm import frame, joints_of
from tests.worlds.interpreters.arms import rig_of


@pytest.mark.parametrize(("value", "left"), [("9E9", []), ("0", []), ("120", ["external_axes"])])
def test_rail_of_the_rig_file_must_be_at_zero(value, left, tmp_path):
    railed = with_robot(rig_of("abb-irb-120"), rail=Rail(direction=(0, 1, 0), limits_mm=(-500, 500)))
    _, files = abb_files(module_of(f"MoveJ {{p1={value}}},v9,fine,t;\n"))
    assert [one.reason for one in corrected_files(railed, tmp_path, files).left] == left


VARIANTS = {name: text for name, text in cases_of("abb").items() if name.startswith("tool h declared")}


@pytest.mark.parametrize("name", VARIANTS)
def test_stated_tool_counts_if_variants_declare_it_with_other_numbers(name, tmp_path):
    case = case_of("abb", VARIANTS[name])
    assert bool(case.corrected(tmp_path).notices) == bool(case.left)
    stated = corrected_files(case.rig, tmp_path, case.files, ["h=5,0,90,0,45,0"])
    assert not stated.left and len(stated.names) == 1 and not stated.overruled


def test_external_axis_that_is_constant_everywhere_is_noticed(tmp_path):
    cases = cases_of("abb")
    assert case_of("abb", cases["external axis: constant everywhere"]).corrected(tmp_path).notices
    assert not case_of("abb", cases["external axis: zero everywhere"]).corrected(tmp_path).notices


def test_every_name_has_a_single_effect():
    names = [name for effect in EFFECTS.values() for name in effect]
    assert len(names) == len(set(names)) and not set(names) & set(SWITCHES)
    assert not [name for name in names if MOVE.fullmatch(name)]
    assert not FUNCTIONS & {"load", "callbyvar"}


def test_modules_of_a_backup_are_read_from_the_folder_of_the_task(tmp_path):
    rig, files = abb_files(
        {
            "a.mod": "MODULE a\nPROC main()\nMoveJ {p1},v9,fine,t;\nENDPROC\nENDMODULE\n",
            "b.sys": "MODULE b\n{t}\nENDMODULE\n",
        }
    )
    for task, tool in (("TASK1", "[5,0,90]"), ("TASK2", "[0,0,300]")):
        folder = tmp_path / "RAPID" / task
        write_files(folder, {"PROGMOD/a.mod": files["a.mod"], "SYSMOD/b.sys": files["b.sys"].replace("[5,0,90]", tool)})
    found = corrected(rig, tmp_path / "RAPID" / "TASK1" / "PROGMOD" / "a.mod")
    assert found.names == ("MoveJ",) and not found.left


@pytest.mark.parametrize(
    ("q_deg", "axis"),
    [
        ((20, 10, 20, 89.97, 60, -40), 3), ((20, 10, 20, 30, 60, 90.02), 5), ((20, 10, 20, 30, 60, -180.0), 5),
        ((20, 10, 20, 30, 60, 0.0), 5), ((20, 10, 20, 30, 60, 180.0), 5), ((20, 10, 20, 30, 60, -90.0), 5),
    ],
)  # fmt: skip
def test_configuration_follows_a_correction_across_the_end_of_a_quadrant(q_deg, axis, tmp_path):
    rig = rig_of("abb-irb-120")
    found = corrected_cell("abb", tmp_path, module_of(f"MoveJ {robtarget_of(rig, q_deg, np.eye(4))},v9,fine,t;\n"))
    written = re.findall(r"\[([^\[\]]*)\]", found.files["a.mod"].decode().split("\n")[4])
    place_mm, turned, conf = ([float(value) for value in numbers.split(",")] for numbers in written[:3])
    pose = frame(place_mm, Rotation.from_quat(turned, scalar_first=True))
    q = joints_of(rig, pose @ np.linalg.inv(ABB_TOOL), np.radians(q_deg))
    place = (0, 3, 5).index(axis)
    assert (
        not found.left
        and conf[place] != int(q_deg[axis] // 90)
        and conf[:3] == [int(np.floor(q[k] / (np.pi / 2) + 1e-9)) for k in (0, 3, 5)]
    )


@pytest.mark.parametrize("name", ["a.mod", "a.MOD", "a.modx", "a.prg", "A.PRG"])
def test_files_of_a_program(name, tmp_path):
    files = {name: module_of("MoveAbsJ {q0},v9,fine,t;\nMoveL {p1},v9,fine,t;\n")["a.mod"]}
    assert len(corrected_cell("abb", tmp_path, files).names) == 2


@pytest.mark.parametrize(
    "encoded", [b"MODULE x\0\x93\x17ENDMODULE", bytes(range(256)) * 4, "MODULE x".encode("utf-16")]
)
def test_encoded_module_leaves_the_others_corrected_and_is_listed(encoded, tmp_path):
    rig, files = abb_files(module_of("MoveJ {p1},v9,fine,t;\nMoveL {p2},v9,fine,t;\n"))
    write_files(tmp_path, files)
    (tmp_path / "secret.mod").write_bytes(encoded)
    assert programs_at(tmp_path) == [tmp_path / "a.mod"]
    found = corrected(rig, tmp_path / "a.mod")
    assert len(found.names) == 2 and not found.left
    assert [found.sources[one.file] for one in found.notices] == ["secret.mod"]


def test_call_of_an_encoded_module_makes_the_state_unknown(tmp_path):
    rig, files = abb_files(module_of("MoveJ {p1},v9,fine,t;\nSecret;\nMoveL {p2},v9,fine,t;\n"))
    write_files(tmp_path, files)
    (tmp_path / "secret.mod").write_bytes(b"MODULE x\0\x93")
    found = corrected(rig, tmp_path / "a.mod")
    assert [one.reason for one in found.left] == ["not_understood", "not_understood"]
