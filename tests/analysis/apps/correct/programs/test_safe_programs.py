"""Effect of the program before a target on tool, frame and arm: each row contains a program and its uncorrected points.

All other points of a row are corrected. In each row the robot has a different tool, frame, displacement or posture than
the nearby text suggests. {qN} are joint angles, and {pN} is the pose of the arm at these angles with the tool of the
dialect's test.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.correct import program_report
from analysis.apps.correct.corrected_program import NO_FRAMES, CorrectedProgram, correct_program, frames_of
from analysis.correction.support import supports
from rigs.errors import UseError
from rigs.rig import Rig
from tests.analysis.apps.correct.programs.test_user_programs import (
    KUKA,
    UR,
    UR_TOOL,
    kuka_pose,
    ur_pose,
)
from tests.support.answers import words_of
from tests.worlds.arms.faulty_arm import flange_at, known
from tests.worlds.interpreters.arms import rig_of

Left = list[tuple[int, str]]


def corrected_files(
    rig: Rig,
    directory: Path,
    files: dict[str, str],
    tools: Sequence[str] = (),
    frames: Sequence[str] = (),
    *,
    ends: str = "\n",
    start: tuple[float, ...] | None = None,
    neutral: Sequence[str] = (),
) -> CorrectedProgram:
    """The first of the files, corrected beside the others."""
    for name, text in files.items():
        (directory / name).write_bytes(text.replace("\n", ends).encode("latin-1"))
    wrong = known(rig)
    return correct_program(
        wrong,
        supports(wrong),
        directory / next(iter(files)),
        frames_of(rig.robot, tools, frames, neutral),
        None,
        start=start,
    )


def uncorrected(found: CorrectedProgram) -> Left:
    """Return the uncorrected points, except unused points."""
    return [(one.line, one.reason) for one in found.left if one.reason != "unused"]


def with_targets(
    files: dict[str, str], pose: Callable[[int], str], joints: Callable[[int], str], count: int
) -> dict[str, str]:
    """Files with {pN} and {qN} in place of numbers."""
    for k in range(count):
        files = {
            name: text.replace(f"{{p{k}}}", pose(k)).replace(f"{{q{k}}}", joints(k)) for name, text in files.items()
        }
    return files


TCP = "set_tcp(p[0,0,0.145,0,0,0])\n"
OTHER = "set_tcp(p[0,0,0.2,0,0,0])\n"
UR_ROWS: dict[str, tuple[str, Left]] = {
    "plain": (TCP + "movej({q0})\nmovel({p1})\nmovel({p2})\n", []),
    "an own routine called as a built-in begins": (
        "def {name}():\nmovej({q4})\nend\n" + TCP + "movej({q0})\n{name}()\nmovel({p2})\n", []
    ),
    "one whose text is not here": (TCP + "movej({q0})\nget_part()\nmovel({p1})\n", [(4, "not_understood")]),
    "numbers handed to one whose text is not here": (
        TCP + "movej({q0})\nplace_at({p1}, 3)\n", [(3, "handed")]
    ),
    "one that sets a different tool": (
        "def set_down():\n" + OTHER + "end\n" + TCP + "movej({q0})\nset_down()\nmovel({p1})\n", []
    ),
    "one that sets a different tool on one way": (
        "def set_down():\nif a:\n" + OTHER + "end\nend\n" + TCP + "movej({q0})\nset_down()\nmovel({p1})\n",
        [(9, "unknown_tool")],
    ),
    "one that is called in a condition": (
        "def is_ready():\n" + OTHER + "return True\nend\n" + TCP + "movej({q0})\nif is_ready():\nmovel({p1})\nend\n", []
    ),
    "a tool before earlier moves": (
        "movej({q0})\nmovel({p1})\n" + TCP + "movel({p2})\n", [(2, "unknown_tool"), (4, "no_posture")]
    ),
    "a tool in a branch": ("if a:\n" + TCP + "end\nmovej({q0})\nmovel({p1})\n", [(5, "unknown_tool")]),
    "two tools in two branches": (
        "if a:\n" + TCP + "else:\n" + OTHER + "end\nmovej({q0})\nmovel({p1})\n", [(7, "unknown_tool")]
    ),
    "one tool in both branches": ("if a:\n" + TCP + "else:\n" + TCP + "end\nmovej({q0})\nmovel({p1})\n", []),
    "a tool that a loop changes": (
        TCP + "movej({q0})\nwhile a:\nmovel({p1})\n" + OTHER + "end\n", [(4, "unknown_tool")]
    ),
    "a tool that the next run of the script begins with": (
        "movej({q0})\nmovel({p1})\n" + OTHER, [(2, "unknown_tool")]
    ),
    "numbers that become a part of a struct": (
        TCP + "w=struct(pose={p1})\nmovej({q0})\nw.pose = {p2}\nmovel(w.pose)\n",
        [(2, "computed"), (4, "not_literal"), (5, "computed")],
    ),
    "a computed tool": ("set_tcp(pose_add(a, b))\nmovej({q0})\nmovel({p1})\n", [(3, "unknown_tool")]),
    "a tool in a variable": ("t = p[0,0,0.145,0,0,0]\nset_tcp(t)\nmovej({q0})\nmovel({p1})\n", []),
    "a tool in a variable that is written": (
        "t = p[0,0,0.145,0,0,0]\nt[2] = 0.2\nset_tcp(t)\nmovej({q0})\nmovel({p1})\n",
        [(1, "changed"), (5, "unknown_tool")],
    ),
    "a tool set by a thread": (
        "thread t():\n" + OTHER + "end\nrun t()\n" + TCP + "movej({q0})\nmovel({p1})\n", [(7, "unknown_tool")]
    ),
    "a tool set by a secondary program": (
        "sec t():\n" + OTHER + "end\ndef prog():\n" + TCP + "movej({q0})\nmovel({p1})\nend\n", [(7, "unknown_tool")]
    ),
    "a text that does not end in its line": (
        TCP + "movej({q0})\ntextmsg(\"a\n" + OTHER + "\")\nmovel({p1})\n",
        [(2, "not_understood"), (6, "not_understood")],
    ),
    "a call that a condition may skip": (
        "def chg():\n" + OTHER + "return a\nend\n" + TCP + "movej({q0})\nb = a and chg()\nmovel({p1})\n",
        [(8, "unknown_tool")],
    ),
    "one of several lines": (
        "def chg():\n" + OTHER + "return a\nend\n" + TCP
        + "movej({q0})\nif (a or\nb == 1 or\nchg()):\nend\nmovel({p1})\n",
        [(11, "unknown_tool")],
    ),
    "one with a condition as its argument": (
        "def chg(a):\n" + OTHER + "end\n" + TCP + "movej({q0})\nchg(a and b)\nmovel({p1})\n", []
    ),
    "a point that is a tool, too": (
        TCP + "a = {p1}\nmovej({q0})\nmovel(a)\nset_tcp(a)\n", [(2, "changed")]
    ),
    "a stream of poses": (TCP + "movej({q0})\nservoc({p1}, 1.2, 0.25)\n", []),
    "two variables of one name": (
        TCP + "a = {p1}\nmovej({q0})\nmovel(a)\na = {p2}\nmovel(a)\n", [(2, "changed"), (5, "changed")]
    ),
    "a thread that counts": (
        "thread t():\nwhile True:\nn = n + 1\nsync()\nend\nend\nrun t()\n" + TCP + "movej({q0})\nmovel({p1})\n", []
    ),
    "a conveyor": (
        TCP + "movej({q0})\ntrack_conveyor_linear(p[1,0,0,0,0,0], 500.0)\nmovel({p1})\nstop_conveyor_tracking()\n"
        "movej({q2})\nmovel({p1})\n",
        [(4, "tracked")],
    ),
    "targets by name": (
        TCP + "movej(a=1, q={q0})\nmovel(v=1, pose={p1})\nmovec(pose_to={p2}, pose_via={p1}, a=1)\nmovel({p1})\n", []
    ),
    "a path offset": (
        TCP + "movej({q0})\npath_offset_enable()\nmovel({p1})\nmovej({q2})\npath_offset_disable()\nmovej({q2})\n",
        [(4, "displaced"), (5, "displaced")],
    ),
    "a force": (TCP + "movej({q0})\nforce_mode(a,b,c,2,d)\nmovel({p1})\nend_force_mode()\n", [(4, "tracked")]),
    "two postures": (TCP + "if a:\nmovej({q0})\nelse:\nmovej({q7})\nend\nmovel({p1})\n", [(7, "two_postures")]),
    "a posture on one way": (TCP + "if a:\nmovej({q0})\nend\nmovel({p1})\n", [(5, "no_posture")]),
    "a variable in two tools": (
        TCP + "a = {p1}\nmovej({q0})\nmovel(a)\n" + OTHER + "movel(a)\n", [(2, "several_frames")]
    ),
    "a variable written by index": (TCP + "a = {p1}\nmovej({q0})\na[2] = 0.3\nmovel(a)\n", [(2, "changed")]),
    "a variable of a routine's own": (
        TCP + "a = {p1}\ndef f(a):\nmovel(a)\nend\nmovej({q0})\nf({p2})\n", [(2, "changed")]
    ),
    "a word that is no word of the language here": (
        TCP + "movej({q0})\nif a:\n" + OTHER + "default = 1\nmovel({p1})\nend\n", []
    ),
    "blocks that do not end": (
        TCP + "movej({q0})\nwhile a:\nmovel({p1})\n", [(2, "not_understood"), (4, "not_understood")]
    ),
    "a pose that is compared": (
        TCP + "movej({q0})\nif pose_dist(get_actual_tcp_pose(), {p1}) < 0.01:\nmovel({p2})\nend\n", [(3, "computed")]
    ),
    "a usual program": (
        "def prog():\nset_standard_analog_input_domain(0, 1)\nset_tool_voltage(0)\nset_gravity([0.0, 0.0, 9.82])\n"
        "set_payload(1.2, [0,0,0])\nmodbus_add_signal(\"1\", 255, 1, 0, \"M\", False)\n" + TCP
        + "def open_gripper():\nset_standard_digital_out(0, True)\nsleep(0.5)\nend\nglobal n = 0\nwhile (True):\n"
        "movej({q0}, a=1.4, v=1.05)\nopen_gripper()\nif (get_standard_digital_in(1)):\ntextmsg(\"part\")\nend\n"
        "n = n + 1\nmovel({p1}, a=1.2, v=0.25, r=0.01)\nwhile not get_digital_in(2):\nsync()\nend\n"
        "socket_send_line(\"x\")\n"
        "movel({p2}, a=1.2, v=0.25)\nend\nend\nprog()\n",
        [],
    ),
}  # fmt: skip


def ur_files(files: dict[str, str]) -> tuple[Rig, dict[str, str]]:
    rig = rig_of("ur10e")
    turned = (10, -75, 95, -25, 70 - 140, 15 + 150)  # the other wrist
    angles = [*UR, turned]

    def joints(k: int) -> str:
        return "[" + ", ".join(repr(float(np.radians(angle))) for angle in angles[k]) + "]"

    def pose(k: int) -> str:
        return f"p[{ur_pose(flange_at(rig, np.radians(angles[k])) @ UR_TOOL)}]"

    return rig, with_targets(files, pose, joints, len(angles))


@pytest.mark.parametrize("row", UR_ROWS)
def test_urscript(row: str, tmp_path: Path) -> None:
    text, left = UR_ROWS[row]
    rig, files = ur_files({"a.script": text.replace("{name}", "pose_of_part")})
    assert uncorrected(corrected_files(rig, tmp_path, files)) == left


@pytest.mark.parametrize(
    "name",
    ["get_part", "set_down", "read_it", "is_there", "write_it", "request_it", "str_it", "pose_it", "socket_it", "pick"],
)
def test_urscript_calls_are_calls_whatever_they_are_called(name: str, tmp_path: Path) -> None:
    """After a routine that turns the wrist over, a line goes on in that posture, and without its text in none."""
    rig, files = ur_files(
        {"a.script": f"def {name}():\nmovej({{q7}})\nend\n{TCP}movej({{q0}})\n{name}()\nmovel({{p1}})\n"}
    )
    whole = corrected_files(rig, tmp_path, files)
    assert not whole.left and len(whole.names) == 3
    rig, files = ur_files({"b.script": f"{TCP}movej({{q7}})\nmovel({{p1}})\n"})
    jumped = corrected_files(rig, tmp_path, files)
    assert whole.files["a.script"].splitlines()[-1] == jumped.files["b.script"].splitlines()[-1]


STARTS: dict[str, tuple[str, Left]] = {
    "a line": (TCP + "movel({p1})\nmovel({p2})\n", []),
    "of the only program": ("def prog():\ndef grip():\nend\ngrip()\n" + TCP + "movel({p1})\nend\n", []),
    "of one of two programs": ("def prog():\n" + TCP + "movel({p1})\nend\ndef other():\nend\n", [(3, "no_posture")]),
    "to which a loop comes back from a different posture": (
        TCP + "while a:\nmovel({p1})\nmovej({q7})\nend\n",
        [(3, "two_postures")],
    ),
    "after a move to nowhere": (TCP + "speedl(a, 1, 1)\nmovel({p1})\n", [(3, "no_posture")]),
    "of a thread": ("thread t():\nmovel({p1})\nend\nrun t()\n" + TCP, [(2, "not_understood")]),
}


@pytest.mark.parametrize("row", STARTS)
def test_a_program_begins_in_the_posture_that_a_person_states(row: str, tmp_path: Path) -> None:
    text, left = STARTS[row]
    rig, files = ur_files({"a.script": text})
    start = tuple(np.radians(UR[0]).tolist())
    assert uncorrected(corrected_files(rig, tmp_path, files))
    found = corrected_files(rig, tmp_path, files, start=start)
    assert uncorrected(found) == left and found.start == (None if row in UNUSED else start)


UNUSED = {"of one of two programs", "after a move to nowhere", "of a thread"}
"""Programs without a notice, because no posture can be reached from the start."""


def test_a_start_at_which_the_arm_cannot_stand_is_refused(tmp_path: Path) -> None:
    rig, files = ur_files({"a.script": TCP + "movel({p1})\n"})
    with pytest.raises(UseError) as refused:
        corrected_files(rig, tmp_path, files, start=(7.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert refused.value.code == "program.start"


def test_a_stated_start_is_where_a_joint_move_would_have_led(tmp_path: Path) -> None:
    for name, joints in (("near", 0), ("turned", 7)):
        rig, files = ur_files({f"{name}.script": TCP + f"movej({{q{joints}}})\nmovel({{p1}})\n"})
        angles = re.search(r"movej\(\[(.*)\]\)", files[f"{name}.script"])
        assert angles
        start = tuple(map(float, angles[1].split(",")))
        led = corrected_files(rig, tmp_path, files, start=start)
        assert led.start is None  # a joint move leads away from it
        moved = led.files[f"{name}.script"].splitlines()[-1]
        rig, files = ur_files({"a.script": TCP + "movel({p1})\n"})
        found = corrected_files(rig, tmp_path, files, start=start)
        assert found.files["a.script"].splitlines()[-1] == moved
        assert any("--start-joints" in line for line in words_of(program_report.blocks(found)))
        stated = program_report.as_object(found)["start_joints_deg"]
        assert found.start and np.allclose(np.radians(stated), found.start)


def test_a_stated_tool_that_the_program_sets_otherwise_is_said(tmp_path: Path) -> None:
    rig, files = ur_files({"a.script": "movej({q0})\n" + OTHER + "movel({p1})\nmovel({p2})\n"})
    found = corrected_files(rig, tmp_path, files, ["tcp=0,0,145,0,0,0"])
    assert not found.left and [(one.name, one.line) for one in found.overruled] == [("tcp", 2)]
    same = corrected_files(rig, tmp_path, files, ["tcp=0,0,200,0,0,0"])
    assert not same.overruled


def kuka_files(files: dict[str, str]) -> tuple[Rig, dict[str, str]]:
    rig = rig_of("kuka-kr-10-r1100-2")

    def joints(k: int) -> str:
        return "{" + ", ".join(f"A{axis} {angle}" for axis, angle in enumerate(KUKA[k], start=1)) + "}"

    return rig, with_targets(files, lambda k: "{" + kuka_pose(rig, KUKA[k]) + "}", joints, len(KUKA))


HEAD = "DEF a()\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[2]\n"
FRAME = "{FRAME: X 500,Y -100,Z 30,A 45,B 0,C 0}"
INI = (
    "DEF a()\n;FOLD INI\nGLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )\nINTERRUPT ON 3\n"
    "BAS (#INITMOV,0 )\n;ENDFOLD\nFDAT_ACT = {TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE}\nBAS(#FRAMES)\n$VEL.CP=0.2\n"
    "BAS(#VEL_PTP,100)\n$APO.CDIS=1\n$ADVANCE=3\nPTP $AXIS_ACT\nPTP {q0}\nWAIT SEC 0.5\n$OUT[3]=TRUE\nGRIP()\n"
    'LIN {p1} C_DIS\nWAIT FOR $IN[1]==TRUE\nIF $IN[2] THEN\nMsgNotify("x")\nENDIF\nFOR i=1 TO 3\nn=n+SQRT(i)\nENDFOR\n'
    "PTP {p2}\nEND\nDEF GRIP()\n$OUT[1]=TRUE\nPULSE($OUT[2],TRUE,0.1)\nEND\n"
)
KUKA_ROWS: dict[str, tuple[dict[str, str], Left]] = {
    "plain": ({"a.src": HEAD + "PTP {q0}\nLIN {p1}\nPTP {p2}\nEND\n"}, []),
    "a usual program": ({"a.src": INI}, []),
    "a part of the base": ({"a.src": HEAD + "PTP {q0}\n$BASE.A=30\nPTP {p1}\nEND\n"}, [(6, "unknown_frame")]),
    "a base of the list set": (
        {"a.src": HEAD + "BASE_DATA[2]={X 1,Y 2,Z 3,A 0,B 0,C 0}\n$BASE=BASE_DATA[2]\nPTP {p1}\nEND\n"},
        [],
    ),
    "a base of the list set in part": (
        {"a.src": "DEF a()\nBASE_DATA[2].X=5\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[2]\nPTP {p1}\nEND\n"},
        [(5, "unknown_frame")],
    ),
    "a base of the list by a number in a variable": (
        {"a.src": HEAD + "BASE_DATA[i]={X 1,Y 2,Z 3,A 0,B 0,C 0}\n$BASE=BASE_DATA[2]\nPTP {p1}\nEND\n"},
        [(6, "unknown_frame")],
    ),
    "a base in a branch": (
        {"a.src": HEAD + "IF x THEN\n$BASE=$NULLFRAME\nENDIF\nPTP {p1}\nEND\n"}, [(7, "unknown_frame")]
    ),
    "a base that a routine sets": (
        {"a.src": HEAD + "there()\nPTP {p1}\nEND\nDEF there()\n$BASE=$NULLFRAME\nEND\n"}, []
    ),
    "a base that a routine beside sets": (
        {"a.src": HEAD + "there()\nPTP {p1}\nEND\n", "there.src": "DEF there()\n$BASE=BASE_DATA[i]\nEND\n"},
        [(5, "unknown_frame")],
    ),
    "a routine that is not here": ({"a.src": HEAD + "there()\nPTP {q0}\nPTP {p1}\nEND\n"}, [(6, "not_understood")]),
    "a function in an assignment": ({"a.src": HEAD + "ok=go_elsewhere()\nPTP {p1}\nEND\n"}, [(5, "not_understood")]),
    "one of the program": (
        {"a.src": HEAD + "ok=go()\nPTP {p1}\nEND\nDEFFCT BOOL go()\n$BASE.X=1\nRETURN TRUE\nENDFCT\n"},
        [(5, "unknown_frame")],
    ),
    "a function in a condition": ({"a.src": HEAD + "IF go() THEN\nPTP {p1}\nENDIF\nEND\n"}, [(5, "not_understood")]),
    "an external tool": ({"a.src": HEAD + "$IPO_MODE=#TCP\nPTP {p1}\nEND\n"}, [(5, "external_tcp")]),
    "an external tool of a set": (
        {"a.src": "DEF a()\nFDAT_ACT={TOOL_NO 1,BASE_NO 2,IPO_FRAME #TCP}\nBAS(#FRAMES)\nPTP {p1}\nEND\n"},
        [(4, "external_tcp")],
    ),
    "a tool with a motion": (
        {"a.src": HEAD + "PTP {q0}\nSLIN {p1} WITH $TOOL=TOOL_DATA[i]\nPTP {p2}\nEND\n"}, [(5, "unknown_tool")]
    ),
    "an interrupt that sets the base": (
        {"a.src": HEAD + "INTERRUPT DECL 4 WHEN $IN[1] DO away()\nPTP {p1}\nEND\nDEF away()\n$BASE.X=1\nEND\n"},
        [(5, "unknown_frame")],
    ),
    "an interrupt that is not here": (
        {"a.src": HEAD + "INTERRUPT DECL 4 WHEN $IN[1] DO away()\nPTP {q0}\nPTP {p1}\nEND\n"}, [(6, "not_understood")]
    ),
    "an interrupt that sets an output": (
        {"a.src": HEAD + "INTERRUPT DECL 4 WHEN $IN[1] DO $OUT[2]=TRUE\nPTP {p1}\nEND\n"}, []
    ),
    "typed aggregates": (
        {
            "a.src": f"DEF a()\n$TOOL=TOOL_DATA[1]\n$BASE={FRAME}\nPTP {{E6AXIS: {{q0}}}}\nLIN {{E6POS: {{p1}}}}\nEND\n"
            .replace("{{", "{").replace("}}", "}")
        },
        [],
    ),
    "a point that a different file writes": (
        {
            "a.src": HEAD + "PTP XP\nEND\n",
            "a.dat": "DEFDAT a PUBLIC\nDECL GLOBAL E6POS XP={p1}\nENDDAT\n",
            "b.src": "DEF b()\nXP.Z=XP.Z+1\nEND\n",
        },
        [(2, "changed")],
    ),
    "a point of the same name in a different file": (
        {
            "a.src": HEAD + "PTP XP\nEND\n",
            "a.dat": "DEFDAT a\nDECL E6POS XP={p1}\nENDDAT\n",
            "b.src": "DEF b()\nXP.Z=XP.Z+1\nEND\n",
        },
        [],
    ),
    "two routines of one name beside": (
        {
            "a.src": HEAD + "there()\nPTP {p1}\nEND\n",
            "b.src": "DEF b()\nEND\nGLOBAL DEF there()\nEND\n",
            "c.src": "DEF c()\nEND\nGLOBAL DEF there()\nEND\n",
        },
        [(5, "not_understood")],
    ),
    "a routine that is called in two bases": (
        {"a.src": HEAD + "go()\n$BASE=BASE_DATA[3]\ngo()\nEND\nDEF go()\nPTP {p1}\nEND\n"}, [(9, "several_frames")]
    ),
    "numbers handed to a routine beside": (
        {
            "a.src": HEAD + "PTP {q0}\nthere({p1},n)\nok=at(1,{q2})\nEND\n",
            "there.src": "DEF there(goal:IN,n:IN)\nLIN goal\nEND\n",
            "at.src": "DEFFCT BOOL at(n:IN,goal:IN)\nPTP goal\nRETURN TRUE\nENDFCT\n",
        },
        [(5, "handed"), (6, "handed")],
    ),
    "an arc of some degrees": (
        {"a.src": HEAD + "PTP {q0}\nCIRC {p1},{p2},CA 90\nLIN {p1}\nEND\n"}, [(5, "arc"), (5, "arc")]
    ),
    "a base that the submit interpreter sets": (
        {"a.src": HEAD + "PTP {p1}\nEND\n", "sps.sub": "DEF SPS()\nLOOP\nPLC(TRUE)\nBASE_DATA[2].Z=12\nENDLOOP\nEND\n"},
        [(4, "unknown_frame")],
    ),
    "a submit interpreter that does something else": (
        {"a.src": HEAD + "PTP {p1}\nEND\n", "sps.sub": "DEF SPS()\nLOOP\nPLC(TRUE)\n$OUT[1]=TRUE\nENDLOOP\nEND\n"}, []
    ),
    "a base that the next cycle keeps": (
        {"a.src": HEAD + "PTP {p1}\nBASE_DATA[2].X=3\nEND\n"}, [(4, "unknown_frame")]
    ),
    "a base with a spline": (
        {
            "a.src": HEAD + "PTP {q0}\nSPLINE WITH $BASE=BASE_DATA[i]\nSPL {p1}\nENDSPLINE\nPTP {p1}\nSPLINE\n"
            "SPL {p1}\nENDSPLINE\nEND\n"
        },
        [(6, "unknown_frame")],
    ),
    "a constant orientation": (
        {"a.src": HEAD + "PTP {q0}\n$ORI_TYPE=#CONSTANT\nLIN {p1}\nPTP {p1}\n$ORI_TYPE=#VAR\nLIN {p1}\nEND\n"},
        [(6, "switched")],
    ),
    "one of motion data": (
        {
            "a.src": HEAD + "PTP {q0}\nLDAT_ACT=L1\nBAS(#CP_PARAMS,2)\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[2]\n"
            "LIN {p1}\nEND\n",
            "a.dat": "DEFDAT a\nDECL LDAT L1={VEL 2.0,ACC 100.0,ORI_TYP #CONSTANT,CIRC_TYP #BASE}\nENDDAT\n",
        },
        [(9, "switched")],
    ),
    "moves that no routine has": (
        {"a.src": "PTP {q0}\nLIN {p1}\n"}, [(1, "not_understood"), (2, "not_understood")]
    ),
    "one with a motion": (
        {"a.src": HEAD + "PTP {q0}\nSLIN {p1} WITH $ORI_TYPE=#CONSTANT\nPTP {p1}\nSLIN {p1}\nEND\n"}, [(5, "switched")]
    ),
    "a point that a different file has under a different name": (
        {
            "a.src": HEAD + "PTP XP\nEND\n",
            "a.dat": "DEFDAT a PUBLIC\nDECL E6POS XP={p1}\nENDDAT\n",
            "b.dat": "DEFDAT b\nIMPORT DECL E6POS XQ IS /R1/A..XP\nENDDAT\n",
        },
        [(2, "changed")],
    ),
    "an own routine of a system's name": (
        {"a.src": HEAD + "PTP {q0}\nBAS(#VEL_PTP,50)\nLIN {p1}\nEND\nDEF BAS(c:IN,n:IN)\n$BASE.X=1\nEND\n"},
        [(6, "unknown_frame")],
    ),
    "one that may write the tool of a motion": (
        {
            "a.src": HEAD + "PTP {q0}\nSLIN XP WITH $TOOL=STOOL2(FP1), $BASE=SBASE(FP1.BASE_NO), "
            "$LOAD=SLOAD(FP1.TOOL_NO)\nEND\nDEFFCT LOAD SLOAD(n:OUT)\nn=2\nENDFCT\n",
            "a.dat": "DEFDAT a\nDECL E6POS XP={p1}\nDECL FDAT FP1={TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE}\nENDDAT\n",
        },
        [(2, "unknown_tool")],
    ),
    "two of them": (
        {
            "a.src": HEAD + 'MsgNotify("x")\nPTP {p1}\nEND\n',
            "b.src": "DEF b()\nEND\nGLOBAL DEF MsgNotify(c[]:IN)\nEND\n",
            "c.src": "DEF c()\nEND\nGLOBAL DEF MsgNotify(c[]:IN)\n$BASE.X=1\nEND\n",
        },
        [(5, "not_understood")],
    ),
    "a flag that is evaluated all the time": (
        {"a.src": "DEF a()\n$CYCFLAG[1]=at()\n" + HEAD[8:] + "PTP {p1}\nEND\nDEFFCT BOOL at()\n$BASE.X=1\nRETURN TRUE\n"
         "ENDFCT\n"},
        [(5, "unknown_frame")],
    ),
    "a function that a condition may skip": (
        {"a.src": HEAD + "IF x AND at() THEN\nENDIF\nPTP {p1}\nEND\nDEFFCT BOOL at()\n$BASE=$NULLFRAME\nRETURN TRUE\n"
         "ENDFCT\n"},
        [(6, "unknown_frame")],
    ),
    "a list of bases of its own": (
        {
            "a.src": HEAD + "PTP {p1}\nEND\n",
            "a.dat": "DEFDAT a\nDECL FRAME BASE_DATA[8]\nBASE_DATA[2]={X 9,Y 0,Z 0,A 0,B 0,C 0}\nENDDAT\n",
        },
        [(4, "not_understood")],
    ),
    "that of the system": (
        {
            "a.src": HEAD + "PTP {p1}\nEND\n",
            "$config.dat": "DEFDAT $CONFIG\nDECL FRAME BASE_DATA[8]\nBASE_DATA[2]={X 9,Y 0,Z 0,A 0,B 0,C 0}\nENDDAT\n",
        },
        [],
    ),
    "flags in bits": ({"a.src": HEAD + "PTP {p1}\nLIN {p1}\nEND\n"}, []),
    "a base in every case": (
        {
            "a.src": HEAD + "$BASE=BASE_DATA[3]\nSWITCH n\nCASE 1\n$BASE=BASE_DATA[2]\n"
            "DEFAULT\n$BASE=BASE_DATA[2]\nENDSWITCH\nPTP {p1}\nEND\n"
        },
        [],
    ),
    "a base in some cases": (
        {"a.src": HEAD + "SWITCH n\nCASE 1\n$BASE=BASE_DATA[3]\nENDSWITCH\nPTP {p1}\nEND\n"}, [(8, "unknown_frame")]
    ),
    "a jump over a base": (
        {"a.src": HEAD + "IF x THEN\nGOTO on\nENDIF\n$BASE=BASE_DATA[3]\non:\nPTP {p1}\nEND\n"}, [(9, "unknown_frame")]
    ),
}  # fmt: skip
KUKA_STATED = (["1=0,50,200,0,20,10"], ["2=500,-100,30,0,0,45", "3=0"])


@pytest.mark.parametrize("row", KUKA_ROWS)
def test_kuka(row: str, tmp_path: Path) -> None:
    files, left = KUKA_ROWS[row]
    rig, files = kuka_files(files)
    if row == "flags in bits":
        status, turn = re.findall(r"[ST] (\d+)", files["a.src"])[:2]
        bits = f"S 'B{int(status):03b}',T 'B{int(turn):06b}'"
        files = {"a.src": files["a.src"].replace(f"S {status},T {turn}", bits)}
    if row == "typed aggregates":
        files = {name: text.replace(": {", ": ").replace("}}", "}") for name, text in files.items()}
    assert uncorrected(corrected_files(rig, tmp_path, files, *KUKA_STATED)) == left


@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
def test_lines_end_as_they_end(ends: str, tmp_path: Path) -> None:
    rig, files = kuka_files({"a.src": HEAD + "PTP {q0}\nLIN {p1}\n$BASE.X=1\nPTP {p2}\nEND\n"})
    found = corrected_files(rig, tmp_path, files, *KUKA_STATED, ends=ends)
    assert uncorrected(found) == [(7, "unknown_frame")] and len(found.names) == 2
    data = found.files["a.src"].decode()
    assert data.count(ends) == files["a.src"].count("\n") and [place[1] for place in found.places] == [4, 5]
    assert data.split(ends)[6] == files["a.src"].split("\n")[6]


def test_a_half_corrected_program_is_said_and_held_where_a_person_wants_all_or_nothing(tmp_path: Path) -> None:
    rig, files = ur_files({"a.script": TCP + "movej({q0})\nmovel({p1})\nmovel({p2})\nset_tcp(x)\nmovel({p4})\n"})
    found = corrected_files(rig, tmp_path, files)
    assert uncorrected(found) == [(6, "unknown_tool")] and not found.held
    assert found.beside_left_mm.tolist() == pytest.approx([found.moved_mm[-1]])
    first, second, *_ = words_of(program_report.blocks(found))
    assert re.findall(r"\d+ (?=\w)", first) == ["3 ", "1 ", "1 "] and f"{found.moved_mm[-1]:.3f} mm" in second
    wrong = known(rig)
    held = correct_program(wrong, supports(wrong), tmp_path / "a.script", NO_FRAMES, None, whole=True)
    assert held.held and "--all-or-nothing" in words_of(program_report.blocks(held))[1]


@pytest.mark.parametrize(("start", "k"), [(0, 1), (1, 2), (2, 3), (3, 4), (4, 0), (0, 2)])
@pytest.mark.parametrize("kept", ["S", "T"])
def test_one_posture_flag_of_krl_is_enough_only_if_it_identifies_the_posture(
    start: int, k: int, kept: str, tmp_path: Path
) -> None:
    rig, files = kuka_files({"a.src": HEAD + "PTP {q" + str(start) + "}\nPTP {p" + str(k) + "}\nEND\n"})
    partial = {"a.src": re.sub(rf",\s*{'T' if kept == 'S' else 'S'} \d+", "", files["a.src"])}
    found = corrected_files(rig, tmp_path, partial, *KUKA_STATED)
    if kept == "S":  # Status does not state the side to which the wrist is turned.
        assert uncorrected(found) == [(5, "ambiguous")]
    else:
        (tmp_path / "both").mkdir()
        both = corrected_files(rig, tmp_path / "both", files, *KUKA_STATED)
        assert found.moved_mm == pytest.approx(both.moved_mm)
        assert len(found.moved_mm) == 2


@pytest.mark.parametrize(
    ("line", "corrected"),
    [
        ('CWRITE($CMD,STAT,MODE,"RUN/R1/SETB()")', 0),
        ('CWRITE ( $CMD, S, M, "SELECT/R1/OTHER" )', 0),
        ('ok=send()', 0),
        ('HANDLE=$CMD\nCWRITE(HANDLE,STAT,MODE,"RUN/R1/SETB()")', 0),
        ('COPEN(:SER_1,HANDLE)\nHANDLE=$CMD\nCWRITE(HANDLE,STAT,MODE,"RUN/R1/SETB()")', 0),
        ('$PRO_I_O[]="/R1/OTHER()"', 0),
        ("RET=RSI_MOVECORR()", 0),
        ("RESUME", 0),
        ("H70(2,CD1)", 0),
        ('COPEN(:SER_1,HANDLE)\nCWRITE(HANDLE,STAT,MODE,"%d",n)', 1),
        ("H70(1,CD0)", 1),
        ("H50(GRP,2,1,GAbrir)", 1),
        ("ArcMainNG(#ArcOnBefHPU,WDAT1,WP1)", 1),
        ("TRIGGER WHEN DISTANCE=0 DELAY=ArcGetDelay(#GasPreflow,WDAT1) DO ArcMainNG(#GasPreflow,WDAT1,WP1) PRIO=-1", 1),
        ("INTERRUPT DECL 4 WHEN $CYCFLAG[2]==FALSE DO A10 (#APPL_ERROR)", 1),
        ("USERSPOT(#INIT)", 1),
        ("P00 (#EXT_PGNO,#PGNO_GET,DMY[],0 )", 1),
        ("$TORQMON[1]=50", 1),
    ],
)  # fmt: skip
def test_statements_of_kuka_before_a_target_that_no_move_reaches_before(
    line: str, corrected: int, tmp_path: Path
) -> None:
    text = (
        HEAD + line + "\nPTP {p1}\nEND\n" + 'DEFFCT BOOL send()\nCWRITE($CMD,S,M,"RUN/R1/B()")\nRETURN TRUE\nENDFCT\n'
    )
    rig, files = kuka_files({"a.src": text})
    found = corrected_files(rig, tmp_path, files, *KUKA_STATED)
    assert len(found.names) == corrected
    assert {reason for _, reason in uncorrected(found)} <= {
        "not_understood",
        *(["unknown_frame"] if "H70" in line else []),
    }
