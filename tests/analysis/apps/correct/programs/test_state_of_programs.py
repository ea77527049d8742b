"""What else a program does on its way to a target: the posture in which a line ends, arcs that turn the tool, calls
that write what they are given, external axes, and points that are used with an offset.

Rows are as in `test_safe_programs`: a program, and what is left of it. Everything else is corrected.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.apps.correct import program_report
from analysis.apps.correct.corrected_program import doubts_of, frames_of
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.robot.kinematics.inverse import inverse
from rigs.errors import UseError
from tests.analysis.apps.correct.programs.test_safe_modules_and_jobs import (
    J1,
    L2_,
    M1,
    M2,
    M3,
    ZERO,
    abb_files,
    fanuc_files,
    job_of,
    module_of,
    selecting,
    yaskawa_files,
)
from tests.analysis.apps.correct.programs.test_safe_programs import (
    HEAD,
    KUKA_STATED,
    TCP,
    Left,
    corrected_files,
    kuka_files,
    uncorrected,
    ur_files,
)
from tests.analysis.apps.correct.programs.test_user_programs import ABB, ABB_TOOL, NUMBER, UR, UR_TOOL, ur_pose
from tests.support.answers import words_of
from tests.worlds.arms.faulty_arm import flange_at, frame, hidden, joints_of
from tests.worlds.interpreters.arms import rig_of

Row = tuple[str, Left]
UR_ROWS: dict[str, Row] = {
    "a taught waypoint after a joint move to a different posture": (
        TCP + "W_p={p1}\nW_q={q1}\nmovej({q7})\nmovel(W_p)\n",
        [],
    ),
    "one at the beginning, where nobody knows the posture": (
        TCP + "W_p={p1}\nW_q={q1}\nmovel(W_p)\n",
        [(2, "no_posture")],
    ),
    "one to which a joint move with its angles leads as well": (
        TCP + "W_p={p1}\nW_q={q1}\nmovej(get_inverse_kin(W_p, qnear=W_q))\nmovel({p2})\nmovel(W_p)\n",
        [],
    ),
    "one to which a line leads in a different posture, too": (
        TCP + "W_p={p1}\nW_q={q1}\nmovej(get_inverse_kin(W_p, qnear=W_q))\nmovej({q7})\nmovel(W_p)\n",
        [(2, "two_postures")],
    ),
    "a joint move to it, which has no angles of its own": (
        TCP + "W_p={p1}\nW_q={q1}\nwhile a:\nmovej(get_inverse_kin(W_p, qnear=W_q))\nspeedj(a)\nmovej(W_p)\nend\n",
        [(2, "no_posture")],
    ),
    "a line to joint angles of a different posture": (TCP + "movej({q7})\nmovel({q1})\n", [(3, "two_postures")]),
    "a line to joint angles of the same posture": (TCP + "movej({q0})\nmovel({q1})\nmovel({p2})\n", []),
    "a line to joint angles from nowhere certain": (TCP + "movel({q1})\n", [(2, "no_posture")]),
    "an arc that keeps its orientation": (TCP + "movej({q0})\nmovec({p1},{p2},mode=0)\nmovel({p2})\n", []),
    "an arc that turns the tool": (
        TCP + "movej({q0})\nmovec({p1},{p2},a=1.2,v=0.25,r=0,mode=1)\nmovel({p2})\n",
        [(3, "arc_turns"), (3, "arc_turns"), (4, "no_posture")],
    ),
    "one by its place among the arguments": (
        TCP + "movej({q0})\nmovec({p1},{p2},1.2,0.25,0,1)\n",
        [(3, "arc_turns"), (3, "arc_turns")],
    ),
    "a mode that is computed": (
        TCP + "movej({q0})\nmovec({p1},{p2},mode=m)\n",
        [(3, "arc_turns"), (3, "arc_turns")],
    ),
    "an arc that turns the tool through a place that is computed": (
        TCP + "movej({q0})\nmovec(pose_trans(a,b),{p2},mode=1)\n",
        [(3, "computed"), (3, "arc_turns")],
    ),
}
POINT = {"a.dat": "DEFDAT a\nDECL E6POS XP={p1}\nENDDAT\n"}
KUKA_ROWS: dict[str, tuple[dict[str, str], Left]] = {
    "a function that returns a base through what it is given": (
        {"a.src": HEAD[:-19] + 'RET=EKI_GETFRAME("V","S/F",BASE_DATA[2])\n$BASE=BASE_DATA[2]\nPTP {p1}\nEND\n'},
        [(5, "unknown_frame")],
    ),
    "one that returns it to the active base": (
        {"a.src": HEAD + "StrToFrame(s[],$BASE)\nPTP {p1}\nEND\n"}, [(5, "unknown_frame")]
    ),
    "one that returns a tool": (
        {"a.src": 'DEF a()\nEKI_GETREAL("V","S/Z",TOOL_DATA[1].Z)\n' + HEAD[8:] + "PTP {p1}\nEND\n"},
        [(5, "unknown_tool")],
    ),
    "one that returns something else": ({"a.src": HEAD + 'RET=EKI_GETREAL("V","S/F",height)\nPTP {p1}\nEND\n'}, []),
    "one that sends a base": ({"a.src": HEAD + 'RET=EKI_SETFRAME("V","S/F",BASE_DATA[2])\nPTP {p1}\nEND\n'}, []),
    "one that returns a point": (
        {"a.src": HEAD + 'RET=EKI_GETREAL("V","S/F",XP.Z)\nPTP XP\nEND\n', **POINT},
        [(2, "changed")],
    ),
    "one that an interrupt calls": (
        {"a.src": HEAD + 'INTERRUPT DECL 4 WHEN $IN[1] DO EKI_GETFRAME("V","F",$BASE)\nPTP {p1}\nEND\n'},
        [(5, "unknown_frame")],
    ),
    "one that the submit interpreter calls": (
        {"a.src": HEAD + "PTP {p1}\nEND\n", "sps.sub": 'DEF SPS()\nEKI_GETFRAME("V","F",BASE_DATA[2])\nEND\n'},
        [(4, "unknown_frame")],
    ),
    "one that reads from a channel": (
        {"a.src": HEAD[:-19] + 'CREAD(h,s,m,t,o,"%r",BASE_DATA[2].X)\n$BASE=BASE_DATA[2]\nPTP {p1}\nEND\n'},
        [(5, "unknown_frame")],
    ),
    "a track that moved earlier": (
        {"a.src": HEAD + "PTP {q0+E1}\nPTP {p1-E}\nPTP {p1}\nLIN {p1-E}\nEND\n"},
        [(4, "external_axes"), (5, "external_axes")],
    ),
    "a track that stands where the next cycle begins": (
        {"a.src": HEAD + "PTP {p1-E}\nPTP {q0+E1}\nEND\n"},
        [(4, "external_axes"), (5, "external_axes")],
    ),
    "a track that moves on one way": (
        {"a.src": HEAD + "PTP {p1}\nIF x THEN\nPTP {q0+E1}\nENDIF\nPTP {p2-E}\nPTP {q0}\nEND\n"},
        [(6, "external_axes"), (8, "external_axes")],
    ),
    "a track that a routine moves": (
        {"a.src": HEAD + "PTP {p1}\ngo()\nPTP {p2-E}\nEND\nDEF go()\nPTP {q0+E1}\nEND\n"},
        [(6, "external_axes"), (9, "external_axes")],
    ),
    "a track that moves by itself": (
        {"a.src": HEAD + "PTP {p1}\nASYPTP {E1 150}\n" + HEAD[8:] + "PTP {p2-E}\nEND\n"},
        [(4, "external_axes"), (8, "not_understood")],
    ),
    "a track of a point that is assigned": (
        {"a.src": HEAD + "PTP {p1}\nXP.E1=150\nPTP XP\nPTP {p2-E}\nEND\n", **POINT},
        [(7, "external_axes"), (2, "changed")],
    ),
    "a track that an arc of a given angle moves": (
        {"a.src": HEAD + "PTP {p1}\nCIRC {p1+E1},{p2+E1}, CA 90\nPTP {p2-E}\nPTP {p1}\nEND\n"},
        [(5, "arc"), (5, "arc"), (6, "external_axes")],
    ),
    "a track that never moves": ({"a.src": HEAD + "PTP {q0}\nPTP {p1}\nLIN {p1-E}\nEND\n"}, []),
}  # fmt: skip
OBJECT = 'PERS wobjdata w:=[FALSE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];'
NEAR = "CONST robtarget p:={p1};"
ABB_ROWS: dict[str, tuple[dict[str, str], Left]] = {
    "a function that is given a part of a work object": (
        module_of(
            "MoveAbsJ {q0},v9,fine,t;\nok:=StrToVal(s,w.oframe.trans.z);\nMoveL {p1},v9,fine,t\\WObj:=w;\n", data=OBJECT
        ),
        [(7, "unknown_frame")],
    ),
    "a track that an instruction moves": (
        module_of("MoveAbsJ {q0},v9,fine,t;\nMoveExtJ jx,v9,fine;\nMoveJ {p1},v9,fine,t;\n"),
        [(7, "external_axes")],
    ),
    "a track that another target moves": (
        module_of("MoveAbsJ {q0+E},v9,fine,t;\nMoveJ {p1},v9,fine,t;\n"), [(6, "external_axes")]
    ),
    "an approach": (module_of("MoveJ Offs(p,0,0,50),v9,fine,t;\nMoveL p,v9,fine,t;\n", data=NEAR), []),
    "one along the tool": (
        module_of("MoveJ RelTool(p,0,0,-50),v9,fine,t;\nMoveL RelTool(p,0,0,-20\\Rz:=5),v9,fine,t;\n", data=NEAR), []
    ),
    "one with a turn that is computed": (
        module_of("MoveJ RelTool(p,0,0,-20\\Rz:=a),v9,fine,t;\nMoveL p,v9,fine,t;\n", data=NEAR),
        [(5, "offset")],
    ),
    "one that is far away": (
        module_of("MoveJ Offs(p,0,-420,200),v9,fine,t;\nMoveL p,v9,fine,t;\n", data=NEAR), []
    ),
    "an approach to a point that no move reaches itself": (
        module_of("MoveAbsJ {q0},v9,fine,t;\nConfL\\Off;\nMoveL Offs(p,0,0,50),v9,fine,t;\n", data=NEAR), []
    ),
    "a far one": (
        module_of("MoveAbsJ {q0},v9,fine,t;\nConfL\\Off;\nMoveL Offs(p,0,-420,200),v9,fine,t;\n", data=NEAR),
        [(3, "offset")],
    ),
    "an arc whose wrist is not controlled": (
        module_of("MoveAbsJ {q0},v9,fine,t;\nCirPathMode\\Wrist45;\nMoveC {p1},{p2},v9,fine,t;\n"
            "CirPathMode\\PathFrame;\n"
                  "MoveC {p1},{p2},v9,fine,t;\n"),
        [(7, "switched"), (7, "switched")],
    ),
}  # fmt: skip
RAIL = "P[9]{\n   GP1:\n\tUF : 3, UT : 1,\tE1=   150.000  mm\n};"
FANUC_ROWS: dict[str, tuple[dict[str, str], list[tuple[str, str]]]] = {
    "a track that moved earlier": (
        {"a.ls": selecting(J1, "J P[9] 10% FINE", L2_)},
        [("P[2]", "external_axes"), ("P[9]", "incomplete")],
    ),
    "another group that a program beside moves": (
        {"a.ls": selecting(J1, "CALL TURN", L2_),
         "turn.ls": "/PROG  TURN\n/MN\n/POS\nP[1]{\n   GP2:\n\tJ1= 9 deg\n};\n/END\n"},
        [],
    ),
    "an approach": ({"a.ls": selecting(*ZERO, "PR[5,3]=50", L2_ + " Offset,PR[5]", L2_)}, []),
}  # fmt: skip
BASE_AXIS = "BC00001=12000\n"
YASKAWA_ROWS: dict[str, tuple[str, Left]] = {
    "a base axis that moved earlier": (
        job_of(M1, "MOVL C00002 BC00001 V=100.0", M3).replace("//INST", BASE_AXIS + "//INST"),
        [(10, "external_axes"), (11, "external_axes"), (15, "external_axes")],
    ),
    "two robots in one file": (
        job_of("///GROUP1 RB1", M1, M2, M3) + job_of("///GROUP1 RB2", M1, M2, M3, name="B"),
        [(47, "other_robot"), (48, "other_robot"), (49, "other_robot")],
    ),
}


@pytest.mark.parametrize("row", UR_ROWS)
def test_urscript(row: str, tmp_path: Path) -> None:
    text, left = UR_ROWS[row]
    rig, files = ur_files({"a.script": text})
    assert uncorrected(corrected_files(rig, tmp_path, files)) == left


@pytest.mark.parametrize("row", KUKA_ROWS)
def test_kuka(row: str, tmp_path: Path) -> None:
    files, left = KUKA_ROWS[row]
    given = {name: re.sub(r"(\{[pq]\d)[-+]E1?\}", r"\1}", text) for name, text in files.items()}
    rig, filled = kuka_files(given)
    for name, text in files.items():
        lines = filled[name].split("\n")
        for k, line in enumerate(text.split("\n")):
            lines[k] = re.sub(r",E1 0\.0,E2 0\.0", "", lines[k]) if "-E}" in line else lines[k]
            lines[k] = lines[k].replace("}", ", E1 150}") if "+E1}" in line else lines[k]
        filled[name] = "\n".join(lines)
    assert sorted(uncorrected(corrected_files(rig, tmp_path, filled, *KUKA_STATED))) == sorted(left)


@pytest.mark.parametrize("row", ABB_ROWS)
def test_abb(row: str, tmp_path: Path) -> None:
    files, left = ABB_ROWS[row]
    rig, filled = abb_files({name: text.replace("{q0+E}", "{q0}") for name, text in files.items()})
    if "{q0+E}" in files["a.mod"]:
        filled["a.mod"] = filled["a.mod"].replace("[9E9", "[150", 1)
    assert uncorrected(corrected_files(rig, tmp_path, filled)) == left


@pytest.mark.parametrize("row", FANUC_ROWS)
def test_fanuc(row: str, tmp_path: Path) -> None:
    files, left = FANUC_ROWS[row]
    rig, filled = fanuc_files(files)
    if "P[9]" in files["a.ls"]:
        filled["a.ls"] = filled["a.ls"].replace("/END", RAIL + "\n/END")
    if "turn.ls" in files:
        filled["turn.ls"] = files["turn.ls"]
    found = corrected_files(rig, tmp_path, filled, ["1=10,-20,180,0,30,10"], ["3=0"])
    assert [(one.name, one.reason) for one in found.left if one.reason != "unused"] == left


@pytest.mark.parametrize("row", YASKAWA_ROWS)
def test_yaskawa(row: str, tmp_path: Path) -> None:
    text, left = YASKAWA_ROWS[row]
    rig, filled = yaskawa_files({"a.jbi": text})
    assert uncorrected(corrected_files(rig, tmp_path, filled, ["3=0,0,150,0,0,0"], ["4=0"])) == left


def _numbers(line: str) -> list[float]:
    return [float(value) for value in re.findall(NUMBER, line[line.index("p[") :])][:6]


def test_a_line_is_corrected_for_the_posture_in_which_the_arm_stands(tmp_path: Path) -> None:
    """The wrong arm is driven from the other posture to the waypoint, whose taught angles it does not use."""
    rig, files = ur_files({"a.script": TCP + "W_p={p1}\nW_q={q1}\nmovej({q7})\nmovel(W_p)\n"})
    (start,) = re.findall(r"movej\(\[(.*)\]\)", files["a.script"])
    wanted = flange_at(rig, np.radians(UR[1])) @ UR_TOOL
    near = np.array([float(one) for one in start.split(",")])
    arm = arm_of(rig.robot)
    solutions = inverse(arm, forward(arm, np.radians(UR[1])[None]))
    others = solutions.q[0][solutions.found[0]]
    stands = others[np.abs(np.sin((others - near) / 2)).sum(axis=1).argmin()]
    assert np.abs(stands - np.radians(UR[1])).max() > 1.0  # another posture
    found = corrected_files(rig, tmp_path, files)
    off_mm = []
    for text in (files["a.script"], found.files["a.script"].decode()):
        values = _numbers(text.split("\n")[1])
        told = frame(1e3 * np.array(values[:3]), Rotation.from_rotvec(values[3:])) @ np.linalg.inv(UR_TOOL)
        real = flange_at(rig, joints_of(rig, told, stands), hidden()) @ UR_TOOL
        off_mm.append(float(np.linalg.norm(real[:3, 3] - wanted[:3, 3])))
    assert off_mm[0] > 0.1 and off_mm[1] < 1e-3


def test_an_arc_that_turns_the_tool_as_it_is_written_is_corrected(tmp_path: Path) -> None:
    rig = rig_of("ur10e")
    begin = flange_at(rig, np.radians(UR[0])) @ UR_TOOL
    centre = begin[:3, 3] + begin[:3, 0] * 60
    poses = []
    for degrees in (40, 80):
        turn = Rotation.from_rotvec(np.radians(degrees) * begin[:3, 2])
        place = centre + turn.apply(begin[:3, 3] - centre)
        poses.append(f"p[{ur_pose(frame(place, turn * Rotation.from_matrix(begin[:3, :3])))}]")
    joints = ", ".join(repr(float(np.radians(angle))) for angle in UR[0])
    moves = f"movej([{joints}])\nmovec({poses[0]}, {poses[1]}, mode=1)\nmovel({poses[0]})\n"
    assert not corrected_files(rig, tmp_path, {"a.script": TCP + moves}).left
    other = poses[1].replace(poses[1].split(", ")[3], repr(float(poses[1].split(", ")[3]) + 0.01))
    left = uncorrected(corrected_files(rig, tmp_path, {"b.script": TCP + moves.replace(poses[1], other)}))
    assert (3, "arc_turns") in left and len(left) == 3


def test_what_an_offset_gives_away_is_reported(tmp_path: Path) -> None:
    files, _ = ABB_ROWS["an approach"]
    rig, filled = abb_files(files)
    found = corrected_files(rig, tmp_path, filled)
    (given_mm,) = found.given_away_mm
    assert 0 < given_mm <= max(0.1 * found.moved_mm[0], found.u_frame_mm[0], found.u_mm[0])
    assert any(f"{given_mm:.3f} mm" in line for line in words_of(program_report.blocks(found)))
    reported = program_report.as_object(found)
    assert reported["used_with_offset"]["largest_given_away_mm"] == given_mm
    assert reported["targets"][0]["given_away_mm"] == round(given_mm, 6)


def _pose_of_p(text: str) -> np.ndarray[Any, Any]:
    ((at, turned),) = re.findall(r"robtarget p:=\[\[([^]]*)\],\[([^]]*)\]", text)
    at_mm, wxyz = ([float(value) for value in re.findall(NUMBER, part)] for part in (at, turned))
    return frame(np.array(at_mm), Rotation.from_quat(np.roll(wxyz, -1)))


def test_what_an_offset_gives_away_is_at_the_tip_of_the_programs_tool(tmp_path: Path) -> None:
    """The arm of the library has no tool. A rotation moves the tip of a long tool more than the flange."""
    rig, filled = abb_files(ABB_ROWS["an approach"][0])
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


def test_a_tool_that_is_stated_twice_with_other_numbers_is_refused() -> None:
    robot = rig_of("ur10e").robot
    for tools, frames in ((["1=0", "1=0,50,200,0,20,10"], []), ([], ["2=0", "2=1,0,0,0,0,0"])):
        with pytest.raises(UseError) as refused:
            frames_of(robot, tools, frames)
        assert refused.value.code == "program.frame"
    assert set(frames_of(robot, ["1=0", "1=0,0,0,0,0,0"], []).tools) == {"1"}


def test_a_tool_that_nothing_uses_or_that_is_in_metres_is_doubted(tmp_path: Path) -> None:
    rig, files = kuka_files({"a.src": HEAD + "PTP {q0}\nPTP {p1}\nEND\n"})
    tools, frames = ["1=0,0.05,0.2,0,20,10", "4=0,0,200,0,0,0"], ["2=500,-100,30,0,0,45", "3=0"]
    found = corrected_files(rig, tmp_path, files, tools, frames)
    doubts = doubts_of(frames_of(rig.robot, tools, frames), [found])
    assert [doubt.partition(":")[0] for doubt in doubts] == ["--tool 1", "--tool 4", "--frame 3"]
    assert "206.2 mm" in doubts[0] and "uses" not in doubts[0]


def test_functions_of_other_programs_are_noticed(tmp_path: Path) -> None:
    rig, files = ur_files(
        {"a.script": TCP + 'cam=rpc_factory("xmlrpc","a")\nmovej({q0})\nx=cam.get()\nmovel({p1})\ncam.get()\n'}
    )
    found = corrected_files(rig, tmp_path, files)
    assert not found.left and [(one.line, one.text.split()[0]) for one in found.notices] == [(4, "cam.get")]
    assert program_report.as_object(found)["notices"][0]["line"] == 4


def test_jobs_of_the_second_robot_are_noticed(tmp_path: Path) -> None:
    rig, files = yaskawa_files({"a.jbi": job_of(M1, M2)})
    files = {"a.jbi": files["a.jbi"].replace("///GROUP1 RB1", "///GROUP1 RB2")}
    found = corrected_files(rig, tmp_path, files, ["3=0,0,150,0,0,0"], ["4=0"])
    assert len(found.names) == 2 and "RB2" in found.notices[0].text


Called = tuple[str, dict[str, str], dict[str, str], int]
"""Name of the file with the relative move, the files whose program calls it through a third routine, those whose
program does not, and the line of the move."""


def _called(maker: str) -> Called:
    if maker.startswith("kuka"):
        step = f"DEF step()\n{'LIN' if maker == 'kuka part' else 'LIN_REL'} {{Z 20.0}}\nEND\n"
        through = {"via.src": "DEF via()\nstep()\nEND\n", "step.src": step}
        plain = {"a.src": HEAD + "PTP {p1}\nEND\n"}
        return "step.src", {"a.src": HEAD + "PTP {p1}\nvia()\nEND\n", **through}, {**plain, **through}, 2
    if maker == "abb":
        step = "MODULE b\nPROC via()\nstep;\nENDPROC\nPROC step()\nMoveL Offs(CRobT(),0,0,20),v9,fine,tool0;\n"
        beside = {"b.mod": f"{step}ENDPROC\nENDMODULE\n"}
        move = "MoveAbsJ {q0},v9,fine,t;\nMoveJ {p1},v9,fine,t;\n"
        return "b.mod", {**module_of(f"{move}via;\n"), **beside}, {**module_of(move), **beside}, 6
    if maker == "fanuc":
        step = "/PROG  STEP\n/MN\n   1:L P[1] 9mm/sec FINE INC ;\n"
        through = {"via.ls": "/PROG  VIA\n/MN\n   1:CALL STEP ;\n", "step.ls": step}
        return "step.ls", {"a.ls": selecting(L2_, "CALL VIA"), **through}, {"a.ls": selecting(L2_), **through}, 3
    through = {
        "via.jbi": job_of("CALL JOB:STEP", name="VIA", pos=NO_POSITIONS),
        "step.jbi": job_of("IMOV P001 V=100.0 BF", name="STEP", pos=NO_POSITIONS),
    }
    return "step.jbi", {"a.jbi": job_of(M1, "CALL JOB:VIA"), **through}, {"a.jbi": job_of(M1), **through}, 7


NO_POSITIONS = "//POS\n///NPOS 0,0,0,0,0,0\n//INST\nNOP\n"
CELLS = {
    "kuka": (kuka_files, *KUKA_STATED),
    "kuka part": (kuka_files, *KUKA_STATED),
    "abb": (abb_files, [], []),
    "fanuc": (fanuc_files, ["1=10,-20,180,0,30,10"], ["3=0"]),
    "yaskawa": (yaskawa_files, ["3=0,0,150,0,0,0"], ["4=0"]),
}


@pytest.mark.parametrize("maker", CELLS)
def test_a_relative_move_of_a_file_that_is_called_is_listed_with_that_file(maker: str, tmp_path: Path) -> None:
    """It starts at a corrected target and keeps its own length: where it ends is not corrected, and nobody said so."""
    make, tools, frames = CELLS[maker]
    name, called, not_called, line = _called(maker)
    listed = []
    for number, files in enumerate((called, not_called)):
        directory = tmp_path / str(number)
        directory.mkdir()
        rig, filled = make(files)
        found = corrected_files(rig, directory, filled, tools, frames)
        assert found.names
        listed.append([(found.sources[one.file], one.line) for one in found.left if one.reason == "relative"])
        if listed[-1]:
            assert f"{name} line {line}" in " ".join(words_of(program_report.blocks(found)))
            assert name in [one["file"] for one in program_report.as_object(found)["left"]]
    assert listed == [[(name, line)], []]
