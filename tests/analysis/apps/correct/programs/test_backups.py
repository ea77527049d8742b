"""Backups of controllers: files that run beside a program, and files with tools, frames and the arm."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.apps.makers.fanuc.backup import frames_in as fanuc_frames
from analysis.apps.makers.target import Number, Target
from analysis.apps.makers.yaskawa.backup import frames_in as yaskawa_frames
from tests.analysis.apps.correct.programs.cells import (
    BARE,
    FANUC_TOOL,
    HEAD,
    KUKA_BASE,
    KUKA_TOOL,
    L2,
    L3,
    M1,
    M2,
    YASKAWA_TOOL,
    ZERO,
    Files,
    corrected_cell,
    corrected_files,
    fanuc_files,
    fanuc_joints,
    fanuc_point,
    job_of,
    kuka_files,
    left_names,
    listing,
    numbers_of,
    selecting,
    uncorrected,
    yaskawa_files,
)
from tests.support.refusals import refused
from tests.worlds.arms.faulty_arm import frame

BOTH = selecting(L2, L3)
TO_A = listing("CALL A", "RUN ROS_STATE", name="MAIN")
TASK = listing("UFRAME[3]=PR[5]", name="TASK")
NOT_UNDERSTOOD = [("P[2]", "not_understood"), ("P[3]", "not_understood")]
BESIDE: dict[str, tuple[Files, list[tuple[str, str]]]] = {
    "another program starts a task": ({"b.ls": listing("RUN ROS_STATE", name="B")}, []),
    "another program starts two tasks": ({"b.ls": listing("RUN ROS_STATE", "RUN ROS_RELAY", name="B")}, []),
    "a routine of another program starts a task": (
        {"b.ls": listing("CALL C", name="B"), "c.ls": listing("RUN ROS_STATE", name="C")}, []
    ),
    "another program names a program for errors": ({"b.ls": listing("ERROR_PROG=FAULT", name="B")}, []),
    "another program starts a monitor": ({"b.ls": listing("MONITOR WATCH", name="B")}, []),
    "the caller starts a task": ({"main.ls": TO_A}, NOT_UNDERSTOOD),
    "another routine of the caller starts a task": (
        {"main.ls": listing("CALL C", "CALL A", name="MAIN"), "c.ls": listing("RUN ROS_STATE", name="C")},
        NOT_UNDERSTOOD,
    ),
    "the task of another program sets the frame": (
        {"b.ls": listing("RUN TASK", name="B"), "task.ls": TASK},
        [("P[2]", "unknown_frame"), ("P[3]", "unknown_frame")],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BESIDE)
def test_unknown_task_counts_only_in_the_programs_that_start_it(case, tmp_path):
    beside, left = BESIDE[case]
    found = corrected_cell("fanuc", tmp_path, {"a.ls": BOTH} | beside)
    assert left_names(found) == left and found.names == (() if left else ("P[2]", "P[3]"))


def test_task_started_by_the_program_or_its_routine_makes_everything_unknown(tmp_path):
    for number, files in enumerate((
        {"a.ls": selecting("RUN ROS_STATE", L2, L3)},
        {"a.ls": selecting("CALL B", L2, L3), "b.ls": listing("RUN ROS_STATE", name="B")},
    )):  # fmt: skip
        assert left_names(corrected_cell("fanuc", tmp_path / str(number), files)) == NOT_UNDERSTOOD


def test_unknown_job_or_interrupt_of_another_program_changes_nothing(tmp_path):
    jobs = {"a.jbi": job_of(M1, M2), "b.jbi": job_of("PSTART JOB:ABSENT SUB1", name="B", pos=BARE)}
    alone = corrected_cell("yaskawa", tmp_path / "alone", {"a.jbi": jobs["a.jbi"]})
    assert left_names(corrected_cell("yaskawa", tmp_path / "both", jobs)) == left_names(alone)
    other = "DEF b()\nINTERRUPT DECL 3 WHEN $IN[1]==TRUE DO absent()\nINTERRUPT ON 3\nEND\n"
    found = corrected_cell("kuka", tmp_path / "kuka", {"a.src": f"{HEAD}PTP {{p0}}\nEND\n", "b.src": other})
    assert len(found.names) == 1 and uncorrected(found) == []


def test_reason_that_would_remain_without_the_task_is_shown(tmp_path):
    rail = corrected_cell("fanuc", tmp_path / "rail", {"a.ls": selecting("RUN ROS_STATE", "J P[9] 100% FINE", L2)})
    assert ("P[2]", "external_axes") in left_names(rail)
    text = selecting("RUN ROS_STATE", "L P[2] 200mm/sec FINE COORD")
    assert ("P[2]", "coordinated") in left_names(corrected_cell("fanuc", tmp_path / "coord", {"a.ls": text}))


REFERENCES = "XHOME jHomePos sync_pos_2 home Origin pHome ZERO calibPos MASTERPOS HOME1 XSYNC q_origin"
WORKS = "XP1 jpos10 original zeroing movej Waypoint_1_q C00001 homogen asynchronous"


@pytest.mark.parametrize(("names", "is_reference"), [(REFERENCES, True), (WORKS, False)])
def test_names_of_reference_positions(names, is_reference):
    numbers = tuple(Number(0, 1, float(angle)) for angle in range(1, 7))
    targets = [Target(name, 0, 1, "joints_deg", numbers) for name in names.split()]
    assert {target.name for target in targets if target.is_reference is not is_reference} == set()
    assert not any(Target(name, 0, 1, "yaw_pitch_roll", numbers).is_reference for name in names.split())


@pytest.mark.parametrize("form", ["joints_deg", "joints_rad", "pulses"])
def test_joint_angles_of_zero_are_a_reference_position(form):
    assert Target("P[1]", 0, 1, form, (Number(0, 1, 0.0),) * 6).is_reference


def test_joint_targets_that_are_references_are_left_and_listed(tmp_path):
    rig, files = fanuc_files({"a.ls": listing("J P[1] 100% FINE", "J P[5] 100% FINE")})
    home = fanuc_point(5, fanuc_joints((5, 10, -30, 5, -70, 30)), "UF : 0, UT : 1,\t").replace("P[5]", 'P[5:"HOME 1"]')
    files["a.ls"] = files["a.ls"].replace("\n/END", f"\n{home.replace(chr(13), '')}\n/END")
    found = corrected_files(rig, tmp_path, files)
    assert found.names == ("P[1]",) and ("P[5]", "reference") in left_names(found)


JOINT_FORMS = {
    "JPOS": (["PR[5]=JPOS", *ZERO], True),
    "a joint position": (["PR[5]=P[1]", *ZERO], True),
    "a copy of JPOS": (["PR[6]=JPOS", "PR[5]=PR[6]", *ZERO], True),
    "JPOS in a branch": (["IF R[1]=1,PR[5]=JPOS", *ZERO], True),
    "a computed register": (["PR[5]=PR[6]+JPOS", *ZERO], True),
    "LPOS": (["PR[5]=LPOS", *ZERO], False),
    "LPOS after JPOS": (["PR[5]=JPOS", "PR[5]=LPOS", *ZERO], False),
    "numbers alone": (ZERO, False),
}


@pytest.mark.parametrize("case", JOINT_FORMS)
def test_register_in_joint_form_is_no_frame(case, tmp_path):
    lines, is_joint = JOINT_FORMS[case]
    found = corrected_cell("fanuc", tmp_path, {"a.ls": selecting(*lines, "UFRAME[3]=PR[5]", L2)})
    reasons = dict(left_names(found))
    assert (reasons.get("P[2]") == "unknown_frame", "P[2]" in found.names) == (is_joint, not is_joint)


FEET = {
    "at the world": "X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0",
    "raised": "X 0.0,Y 0.0,Z 650.0,A 0.0,B 0.0,C 0.0",
    "shifted": "X 1200.5,Y -300.0,Z 500.0,A 0.0,B 0.0,C 0.0",
    "turned": "x 100.0,y 200.0,z 300.0,a 30.0,b 0.0,c 0.0",
    "hanging": "X 0.0,Y 0.0,Z 2500.0,A 0.0,B 0.0,C 180.0",
    "on a wall": "X 0.0,Y 0.0,Z 1500.0,A 90.0,B 90.0,C 0.0",
}
PROGRAM = f"{HEAD}PTP {{p0}}\nLIN {{p1}}\nEND\n"


USER_FRAME = frame((40, -50, 12), Rotation.from_euler("xyz", (0, 0, 3), degrees=True))


def krl(T) -> str:
    values = numbers_of(np.asarray(T), "ZYX")
    return "{" + ",".join(f"{name} {value:.9f}" for name, value in zip("XYZABC", values, strict=True)) + "}"


def kuka_backup(foot: str, base: str, program: str = PROGRAM) -> Files:
    machine = f"DEFDAT $MACHINE\nFRAME $ROBROOT={{{foot}}} ;ROBOT IN THE WORLD\nENDDAT\n"
    config = f"DEFDAT $CONFIG\nTOOL_DATA[1]={krl(KUKA_TOOL)}\nBASE_DATA[2]={base}\nENDDAT\n"
    return {
        "R1/Program/a.src": program, "R1/Mada/$machine.dat": machine, "R1/System/$config.dat": config,
    }  # fmt: skip


def foot_frame(foot: str):
    x, y, z, a, b, c = (float(number) for number in re.findall(r" (-?[\d.]+)", foot))
    return frame((x, y, z), Rotation.from_euler("ZYX", (a, b, c), degrees=True))


@pytest.mark.parametrize("place", FEET)
@pytest.mark.parametrize("way", ["BASE_DATA[2]", "literal"])
def test_bases_of_a_backup_are_in_the_world_of_its_machine_data(place, way, tmp_path):
    rig, stated = kuka_files({"a.src": PROGRAM})
    right = corrected_files(rig, tmp_path / "stated", stated, ["1=0,50,200,0,20,10"], ["2=500,-100,30,0,0,45"])
    base = krl(foot_frame(FEET[place]) @ KUKA_BASE)
    program = PROGRAM if way != "literal" else PROGRAM.replace("$BASE=BASE_DATA[2]", f"$BASE={base}")
    _, files = kuka_files(kuka_backup(FEET[place], base, program))
    found = corrected_files(rig, tmp_path / "backup", files)
    assert found.names == right.names and len(right.names) == 2
    (text,), (of_stated,) = found.files.values(), right.files.values()
    numbers = [
        [float(n) for n in re.findall(rb"[XYZABC] (-?[\d.]+)", t.partition(b"PTP")[2])] for t in (text, of_stated)
    ]
    np.testing.assert_allclose(*numbers, atol=2e-4)


@pytest.mark.parametrize("foot", ["X 0.0,Y 0.0", "X dx,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0"])
def test_unreadable_place_of_the_robot_stops_its_bases(foot, tmp_path):
    rig, files = kuka_files(kuka_backup(foot, krl(KUKA_BASE)))
    assert {reason for _, reason in uncorrected(corrected_files(rig, tmp_path, files))} == {"unknown_frame"}


def test_program_that_moves_the_foot_stops_its_bases(tmp_path):
    program = PROGRAM.replace("PTP", "$ROBROOT={X 0,Y 0,Z 100,A 0,B 0,C 0}\nPTP")
    rig, files = kuka_files(kuka_backup(FEET["at the world"], krl(KUKA_BASE), program))
    assert not corrected_files(rig, tmp_path, files).names


@pytest.mark.parametrize(("a", "b", "fits"), [(25, 560, True), (25, 455, False), (410, 1000, False), (26, 562, True)])
def test_backup_of_another_kuka_arm_is_refused(a, b, fits, tmp_path):
    rig, files = kuka_files(kuka_backup(FEET["at the world"], krl(KUKA_BASE)))
    files["R1/Mada/$machine.dat"] += f"REAL $LENGTH_A={a}.0 ;A\nREAL $LENGTH_B={b:.3f} ;B\n"
    if fits:
        assert len(corrected_files(rig, tmp_path, files).names) == 2
    else:
        with refused("robot.other"):
            corrected_files(rig, tmp_path, files)


def position(T) -> str:
    x, y, z, w, p, r = numbers_of(np.asarray(T))
    return (
        f"  Group: 1   Config: N D B, 0, 0, 0\r\n  X: {x:9.3f}   Y: {y:9.3f}   Z: {z:9.3f}\r\n"
        f"  W: {w:9.3f}   P: {p:9.3f}   R: {r:9.3f}\r\n"
    )


def system_frames(user, tool) -> str:
    def variable(name: str, number: int, T) -> str:
        other = f"    [2,{number}] = \r\n{position(np.eye(4)).replace('Group: 1', 'Group: 2')}"
        head = f"[*SYSTEM*]${name}  Storage: SHADOW  Access: RW  : ARRAY[2,9] OF POSITION\r\n"
        counter = f"\r\n[*SYSTEM*]${name}NUM  ARRAY[2] OF BYTE\r\n  [1] = 7\r\n"
        return f"{head}    [1,{number}] = \r\n{position(T)}{other}{counter}"

    return variable("MNUFRAME", 3, user) + variable("MNUTOOL", 1, tool)


@pytest.mark.parametrize("name", ["sysframe.va", "SYSFRAME.VA"])
def test_system_frames_of_a_fanuc_backup_replace_stated_ones(name, tmp_path):
    rig, files = fanuc_files({"a.ls": BOTH})
    tool, user = "1=10,-20,180,0,30,10", "3=" + ",".join(f"{value:.3f}" for value in numbers_of(USER_FRAME))
    stated = corrected_files(rig, tmp_path / "stated", files, [tool], [user])
    found = corrected_files(rig, tmp_path / "backup", files | {name: system_frames(USER_FRAME, FANUC_TOOL)})
    assert found.names == ("P[2]", "P[3]") and [*found.files.values()] == [*stated.files.values()]


def test_frame_that_a_listing_sets_is_not_that_of_the_backup(tmp_path):
    rig, files = fanuc_files({"a.ls": BOTH, "b.ls": listing("UFRAME[3]=PR[5]", name="B")})
    found = corrected_files(rig, tmp_path, files | {"sysframe.va": system_frames(USER_FRAME, FANUC_TOOL)})
    assert not found.names and {reason for _, reason in left_names(found)} == {"unknown_frame"}


@pytest.mark.parametrize(
    ("lengths", "fits"),
    [
        (("1.500000e+02", "6.000000e+02", "2.000000e+02"), True),
        (("4.100000e+02", "1.120000e+03", "7.500000e+02"), False),
        (("4.100000e+02", "Uninitialized", "7.500000e+02"), True),
    ],
)
def test_backup_of_another_fanuc_arm_is_refused(lengths, fits, tmp_path):
    rig, files = fanuc_files({"a.ls": BOTH})
    values = "".join(f"      [{k}] = {text}\r\n" for k, text in enumerate(lengths, start=1))
    files["symotn.va"] = f"     Field: $MRR_GRP[1].$DH_A  ARRAY[9] OF REAL\r\n{values}      [4] = 0.000000e+00\r\n"
    stated = ["1=10,-20,180,0,30,10"], ["3=0"]
    if fits:
        assert len(corrected_files(rig, tmp_path, files, *stated).names) == 2
    else:
        with refused("robot.other"):
            corrected_files(rig, tmp_path, files, *stated)


@pytest.mark.parametrize("tool_file", ["TOOL.CND", "tool.cnd"])
def test_conditions_of_a_yaskawa_backup_replace_stated_tools_and_frames(tool_file, tmp_path):
    rig, files = yaskawa_files({"a.jbi": job_of(M1, M2)})
    numbers = ",".join(f"{value:.4f}" for value in numbers_of(USER_FRAME))
    stated = corrected_files(rig, tmp_path / "stated", files, ["3=0,0,150,0,0,0"], [f"4={numbers}"])
    tool = ",".join(f"{value:.4f}" for value in numbers_of(YASKAWA_TOOL))
    frames = f"///TOOL 0\n///GROUP 1,0,0\n////RORG 1,2,3,4,5,6\n////BUSER {numbers}\n"
    tables = {
        tool_file: f"//TOOL 0\n///NAME A\n0,0,0,0,0,0\n1,2,3\n//TOOL 3\n///NAME\n{tool}\n1.0,2.0,3.0\n4.0\n",
        "UFRAME.CND": f"//UFRAME 4\n///NAME\n{frames}",
    }
    found = corrected_files(rig, tmp_path / "backup", files | tables)
    assert found.names == stated.names and len(found.names) == 2
    assert [*found.files.values()] == [*stated.files.values()]
    other = corrected_files(rig, tmp_path / "backup", files | tables, ["3=0,0,160,0,0,0"], [f"4={numbers}"])
    assert [(one.kind, one.name) for one in other.overruled] == [("tool", "3")]


@pytest.mark.parametrize(("number", "is_read"), [("2e5", True), ("1e999", False)])
def test_frame_of_a_backup_may_be_far_but_not_infinite(number, is_read):
    yaskawa = (("tool.cnd", f"//TOOL 3\n///NAME\n{number},0,0,0,0,0\n"),)
    fanuc = (("sysframe.va", system_frames(np.eye(4), np.eye(4)).replace("0.000 ", f"{number} ", 1)),)
    assert (yaskawa_frames(yaskawa).keys() == {"TOOL[3]"}) is is_read
    assert ("UFRAME[3]" in fanuc_frames(fanuc)) is is_read and "UTOOL[1]" in fanuc_frames(fanuc)
