"""Approaches and via points of arcs share the correction of a point: the point is right, and their error is listed."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.apps.correct import program_report
from analysis.apps.correct.corrected_program import CorrectedProgram
from rigs.rig import Rig
from tests.analysis.apps.correct.programs.cells import (
    ABB,
    ABB_TOOL,
    FANUC,
    HEAD,
    KUKA,
    L2,
    NUMBER,
    STATED,
    TCP,
    UR,
    UR_TOOL,
    ZERO,
    Files,
    abb_files,
    corrected_cell,
    corrected_files,
    fanuc_joints,
    fanuc_point,
    fanuc_pose,
    kuka_joints,
    kuka_pose,
    listing,
    module_of,
    robtarget_of,
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


def _arc(maker: str, turned_deg: float) -> tuple[Rig, list[Array], list[Array]]:
    """A rig, the joint angles at start, via point and end, and the poses of the tool there.

    The via point is turned relative to the orientation midway between start and end.
    """
    rig_name, postures, tool = {
        "ur": ("ur10e", UR, UR_TOOL),
        "abb": ("abb-irb-120", ABB, ABB_TOOL),
        "kuka": ("kuka-kr-10-r1100-2", KUKA, np.eye(4)),
        "fanuc": ("fanuc-m-10ia", FANUC, np.eye(4)),
    }[maker]
    rig, begin_deg = rig_of(rig_name), postures[1]
    begin = flange_at(rig, np.radians(begin_deg)) @ tool
    turns = Rotation.from_matrix(begin[:3, :3])
    middle, end = (turns * Rotation.from_rotvec([0, part, 0]) for part in (0.1, 0.2))
    via = middle * Rotation.from_rotvec(np.radians([turned_deg, 0, 0]))
    poses = [begin, frame(begin[:3, 3] + [30, 30, 0], via), frame(begin[:3, 3] + [0, 60, 0], end)]
    q = [joints_of(rig, T @ np.linalg.inv(tool), np.radians(begin_deg)) for T in poses]
    return rig, q, poses


def _program(maker: str, rig: Rig, q: list[Array]) -> Files:
    deg = [tuple(np.degrees(angles)) for angles in q]
    if maker == "ur":
        poses = [f"p[{ur_pose(flange_at(rig, angles) @ UR_TOOL)}]" for angles in q]
        joints = ", ".join(repr(float(angle)) for angle in q[0])
        return {"a.script": f"{TCP}movej([{joints}])\nmovec({poses[1]}, {poses[2]})\n"}
    if maker == "abb":
        joints = f"[[{','.join(map(repr, map(float, deg[0])))}],[9E9,9E9,9E9,9E9,9E9,9E9]]"
        via, end = (robtarget_of(rig, angles, np.eye(4)) for angles in deg[1:])
        return abb_files(module_of(f"ConfL\\Off;\nMoveAbsJ {joints},v9,fine,t;\nMoveC {via},{end},v9,fine,t;\n"))[1]
    if maker == "kuka":
        via, end = ("{" + kuka_pose(rig, angles) + "}" for angles in deg[1:])
        return {"a.src": f"{HEAD}PTP {{{kuka_joints(deg[0])}}}\nCIRC {via}, {end}\nEND\n"}
    points = [fanuc_point(1, fanuc_joints(deg[0]), "UF : 0, UT : 1,\t")]
    points += [
        fanuc_point(k, fanuc_pose(rig, angles, np.eye(4)), "UF : 0, UT : 1,")
        for k, angles in ((2, deg[1]), (3, deg[2]))
    ]
    moves = listing("UFRAME_NUM=0", "UTOOL_NUM=1", "J P[1] 100% FINE", "C P[2]\n    :  P[3] 100mm/sec FINE")
    return {"a.ls": moves + "/POS\n" + "\n".join(points).replace("\r", "") + "\n/END\n"}


def _corrected(maker: str, rig: Rig, q: list[Array], directory: Path) -> CorrectedProgram:
    return corrected_files(rig, directory, _program(maker, rig, q), *STATED.get(maker, ()))


@pytest.mark.parametrize("turned_deg", [35, 45, 60, 75, 90])
def test_via_point_of_another_orientation_is_listed_with_the_error_on_the_arc(turned_deg, tmp_path):
    rig, q, poses = _arc("ur", turned_deg)
    found = _corrected("ur", rig, q, tmp_path)
    (listed,) = found.shared
    assert (listed.kind, listed.line) == ("via", 3)
    middle = Rotation.from_matrix(poses[0][:3, :3]) * Rotation.from_rotvec([0, 0.1, 0])
    written = [float(value) for value in re.findall(NUMBER, found.files["a.script"].decode().split("\n")[2])[:3]]
    near = tuple(np.degrees(q[0]))
    on_arc = frame(poses[1][:3, 3], middle)
    before, after = (
        _off_mm(rig, frame(place, middle), on_arc, UR_TOOL, near)
        for place in (poses[1][:3, 3], 1e3 * np.array(written))
    )
    assert (listed.before_mm, listed.after_mm) == pytest.approx((before, after), abs=0.01)
    assert listed.after_mm > 0.1 * listed.before_mm


@pytest.mark.parametrize("maker", ["ur", "abb", "kuka", "fanuc"])
def test_arcs_of_every_maker_are_listed_only_if_the_orientation_differs(maker, tmp_path):
    rig, q, _ = _arc(maker, 70)
    assert [one.kind for one in _corrected(maker, rig, q, tmp_path).shared] == ["via"]
    rig, q, _ = _arc(maker, 0)
    found = _corrected(maker, rig, q, tmp_path)
    assert not found.shared and len(found.names) == 3


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
