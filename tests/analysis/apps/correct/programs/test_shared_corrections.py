"""Approaches and via points of arcs share the correction of a point: the point is right, and their error is listed."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.apps.correct import program_report
from rigs.rig import Rig
from tests.analysis.apps.correct.programs.cells import (
    ABB,
    ABB_TOOL,
    L2,
    NUMBER,
    TCP,
    UR,
    UR_TOOL,
    ZERO,
    abb_files,
    corrected_cell,
    corrected_files,
    module_of,
    selecting,
    ur_pose,
)
from tests.support.answers import words_of
from tests.worlds.arms.faulty_arm import Array, flange_at, frame, hidden, joints_of
from tests.worlds.interpreters.arms import rig_of

APPROACHES = {
    "Offs(p,0,0,150)": frame((0, 0, 150), Rotation.identity()),
    "Offs(p,-90,-160,120)": frame((-90, -160, 120), Rotation.identity()),
    "RelTool(p,0,0,-250)": frame((0, 0, -250), Rotation.identity()),
    "RelTool(p,0,0,-80\\Rz:=70)": frame((0, 0, -80), Rotation.from_euler("z", 70, degrees=True)),
    "RelTool(p,20,0,-60\\Ry:=35)": frame((20, 0, -60), Rotation.from_euler("y", 35, degrees=True)),
    "RelTool(p,0,-40,-90\\Rx:=-25)": frame((0, -40, -90), Rotation.from_euler("x", -25, degrees=True)),
    "Offs(p,0,-i*60,0)": frame((0, -180, 0), Rotation.identity()),
}
"""The last one is the worst place of a pattern."""


def _off_mm(rig: Rig, commanded: Array, wanted: Array, tool: Array, near_deg: tuple[float, ...]) -> float:
    q = joints_of(rig, commanded @ np.linalg.inv(tool), np.radians(near_deg))
    return float(np.linalg.norm(((flange_at(rig, q, hidden()) @ tool) - wanted)[:3, 3]))


def _pose_of_p(text: str) -> Array:
    ((at, turned),) = re.findall(r"robtarget p:=\[\[([^]]*)\],\[([^]]*)\]", text)
    at_mm, wxyz = ([float(value) for value in re.findall(NUMBER, part)] for part in (at, turned))
    return frame(np.array(at_mm), Rotation.from_quat(np.roll(wxyz, -1)))


@pytest.mark.parametrize("approach", APPROACHES)
def test_work_point_is_corrected_and_its_approach_listed_with_its_error(approach, tmp_path):
    rig, files = abb_files(
        module_of(
            "MoveAbsJ {q1},v9,fine,t;\nConfJ\\Off;\nConfL\\Off;\nMoveL p,v9,fine,t;\n"
            f"FOR i FROM 0 TO 3 DO\nMoveL {approach},v9,fine,t;\nENDFOR\n",
            data="CONST robtarget p:={p1};",
        )
    )
    found = corrected_files(rig, tmp_path, files)
    before, after = _pose_of_p(files["a.mod"]), _pose_of_p(found.files["a.mod"].decode())
    shift = APPROACHES[approach]
    away = [shift @ p if approach.startswith("Offs") else p @ shift for p in (before, after)]
    assert not found.left
    assert _off_mm(rig, before, before, ABB_TOOL, ABB[1]) > 0.1
    assert _off_mm(rig, after, before, ABB_TOOL, ABB[1]) < 0.002
    (listed,) = found.shared
    assert (listed.kind, listed.line) == ("offset", 10)
    expected = [_off_mm(rig, commanded, away[0], ABB_TOOL, ABB[1]) for commanded in away]
    assert (listed.before_mm, listed.after_mm) == pytest.approx(expected, abs=2e-3)
    assert listed.after_mm > 0.1 * listed.before_mm


def test_fanuc_approach_by_a_register_is_listed(tmp_path):
    files = {"a.ls": selecting(*ZERO, "PR[5,3]=250", L2 + " Offset,PR[5]", L2)}
    found = corrected_cell("fanuc", tmp_path, files)
    assert [one.kind for one in found.shared] == ["offset"] and found.shared[0].after_mm < found.shared[0].before_mm


@pytest.mark.parametrize("turned_deg", [10, 25, 45, 60, 85])
def test_point_stays_if_its_approach_would_leave_the_configuration(turned_deg, tmp_path):
    """The approach has axis 6 at the end of its quadrant, where the correction would need another configuration."""
    rig = rig_of("abb-irb-120")
    X = flange_at(rig, np.radians((20, 10, 20, 30, 60, turned_deg)))
    wxyz = Rotation.from_matrix(X[:3, :3]).as_quat(scalar_first=True)
    numbers = ",".join(f"{value:.5f}" for value in X[:3, 3]), ",".join(f"{value:.9f}" for value in wxyz)
    pose = f"[[{numbers[0]}],[{numbers[1]}],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    moves = f"MoveJ p,v9,fine,tool0;\nMoveJ RelTool(p,0,0,0\\Rz:=-{turned_deg}),v9,fine,tool0;\n"
    found = corrected_cell("abb", tmp_path, module_of(moves, data=f"CONST robtarget p:={pose};"))
    assert [one.reason for one in found.left] == ["changes_flags"] and not found.names


def test_approach_without_a_solution_is_listed_as_unknown(tmp_path):
    files = module_of("MoveJ p,v9,fine,t;\nMoveL Offs(p,0,0,2000),v9,fine,t;\n", data="CONST robtarget p:={p1};")
    (listed,) = corrected_cell("abb", tmp_path, files).shared
    assert listed.unknown == "unreachable" and np.isnan(listed.after_mm)


@pytest.mark.parametrize("turned_deg", [0, 35, 45, 60, 75, 90])
def test_via_point_of_another_orientation_is_listed_with_the_error_on_the_arc(turned_deg, tmp_path):
    """The via point is turned relative to the orientation midway between start and end."""
    rig = rig_of("ur10e")
    begin = flange_at(rig, np.radians(UR[1])) @ UR_TOOL
    middle, end = (Rotation.from_matrix(begin[:3, :3]) * Rotation.from_rotvec([0, part, 0]) for part in (0.1, 0.2))
    on_arc = frame(begin[:3, 3] + [30, 30, 0], middle)
    via = frame(on_arc[:3, 3], middle * Rotation.from_rotvec(np.radians([turned_deg, 0, 0])))
    poses = [f"p[{ur_pose(T)}]" for T in (via, frame(begin[:3, 3] + [0, 60, 0], end))]
    found = corrected_cell("ur", tmp_path, {"a.script": f"{TCP}movej({{q1}})\nmovec({poses[0]}, {poses[1]})\n"})
    assert len(found.names) == 3 and len(found.shared) == bool(turned_deg)
    if turned_deg:
        (listed,) = found.shared
        assert (listed.kind, listed.line) == ("via", 3)
        written = [float(value) for value in re.findall(NUMBER, found.files["a.script"].decode().split("\n")[2])[:3]]
        before, after = (
            _off_mm(rig, frame(place, middle), on_arc, UR_TOOL, UR[1])
            for place in (via[:3, 3], 1e3 * np.array(written))
        )
        assert (listed.before_mm, listed.after_mm) == pytest.approx((before, after), abs=0.01)
        assert listed.after_mm > 0.1 * listed.before_mm


APPROACH = "MoveJ Offs(p,0,0,50),v9,fine,t;\nMoveL p,v9,fine,t;\n"


def test_error_kept_by_an_approach_is_reported(tmp_path):
    found = corrected_cell("abb", tmp_path, module_of(APPROACH, data="CONST robtarget p:={p1};"))
    (given_mm,) = found.given_away_mm
    assert 0 < given_mm <= max(0.1 * found.moved_mm[0], found.u_frame_mm[0], found.u_mm[0])
    assert any(f"{given_mm:.3f} mm" in line for line in words_of(program_report.blocks(found)))
    reported = program_report.as_object(found)
    assert reported["used_with_offset"]["largest_given_away_mm"] == given_mm
    assert reported["targets"][0]["given_away_mm"] == round(given_mm, 6)


def test_error_kept_by_an_approach_is_at_the_tip_of_the_programs_tool(tmp_path):
    """The arm of the library has no tool. A rotation moves the tip of a long tool more than the flange."""
    rig, filled = abb_files(module_of(APPROACH, data="CONST robtarget p:={p1};"))
    tool = frame((-60.0, 90.0, 220.0), Rotation.from_matrix(ABB_TOOL[:3, :3]))
    place = _pose_of_p(filled["a.mod"]) @ np.linalg.inv(ABB_TOOL) @ tool
    text = filled["a.mod"].replace("[5,0,90]", "[-60,90,220]")
    text = re.sub(r"p:=\[\[[^]]*\]", "p:=[[" + ",".join(f"{mm:.6f}" for mm in place[:3, 3]) + "]", text)
    found = corrected_files(rig, tmp_path, {"a.mod": text})
    tips, up = [], frame((0.0, 0.0, 50.0), Rotation.identity())
    for written, wrong in ((text, None), (found.files["a.mod"].decode(), hidden())):
        q = joints_of(rig, up @ _pose_of_p(written) @ np.linalg.inv(tool), np.radians(ABB[1]))
        tips.append((flange_at(rig, q, wrong) @ tool)[:3, 3])
    assert found.given_away_mm == pytest.approx([np.linalg.norm(tips[1] - tips[0])], abs=2e-4)
