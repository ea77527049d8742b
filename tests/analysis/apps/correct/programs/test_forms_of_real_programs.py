"""Forms of programs from real FANUC and Yaskawa cells: other motion groups, process instructions, logic along a move,
offsets in registers, station axes and position variables. Rows are as in `test_safe_modules_and_jobs`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.correct import program_report
from analysis.apps.correct.corrected_program import CorrectedProgram, frames_of
from analysis.apps.makers.configuration import configuration_of
from analysis.robot.kinematics.arm import arm_of
from rigs.errors import UseError
from tests.analysis.apps.correct.programs.test_safe_modules_and_jobs import (
    BARE,
    J1,
    L2_,
    L3_,
    L4_,
    M1,
    M2,
    M3,
    ZERO,
    abb_files,
    fanuc_files,
    job_of,
    listing,
    module_of,
    selecting,
    yaskawa_files,
)
from tests.analysis.apps.correct.programs.test_safe_programs import (
    HEAD,
    KUKA_STATED,
    corrected_files,
    kuka_files,
    uncorrected,
    ur_files,
)
from tests.analysis.apps.correct.programs.test_user_programs import fanuc_point, fanuc_pose
from tests.support.answers import words_of
from tests.worlds.interpreters.arms import rig_of

Named = list[tuple[str, str]]


def fanuc(directory: Path, text: str, *others: str, change: Sequence[tuple[str, str]] = ()) -> CorrectedProgram:
    """Correct a listing next to others, after changes of its text."""
    files = {"a.ls": text, **{f"b{k}.ls": other for k, other in enumerate(others)}}
    rig, filled = fanuc_files(files)
    for old, new in change:
        assert old in filled["a.ls"]
        filled["a.ls"] = filled["a.ls"].replace(old, new)
    return corrected_files(rig, directory, filled, ["1=10,-20,180,0,30,10"], ["3=0"])


def left(found: CorrectedProgram) -> Named:
    return [(one.name, one.reason) for one in found.left if one.reason != "unused"]


SELECT = ("UFRAME_NUM=3", "UTOOL_NUM=1")
GUN = "\n   GP2:\n\tUF : 0, UT : 1,\t\n\tJ1=    30.000  mm"
GROUPS = {
    "a gun": GUN,
    "three guns": GUN + GUN.replace("GP2", "GP3") + GUN.replace("GP2", "GP4"),
    "a turntable": "\n   GP3:\n\tUF : 0, UT : 1,\t\n\tJ1=   -90.000 deg,\tJ2=    45.000 deg",
    "a second robot": "\n   GP2:\n\tUF : 2, UT : 4,\t\tCONFIG : 'F D B, 0, 0, 0',\n\tX =   100.000  mm,\tY =   200.000"
    "  mm,\tZ =   300.000  mm,\n\tW =    10.000 deg,\tP =    20.000 deg,\tR =    30.000 deg",
    "a second robot on a track": GUN + ",\n\tE1=   500.000  mm",
    "a group with no numbers": "\n   GP5:\n\tUF : 0, UT : 1,",
}


@pytest.mark.parametrize("group", GROUPS)
def test_other_motion_groups_do_not_matter_and_keep_their_bytes(group: str, tmp_path: Path) -> None:
    text = selecting(J1, L2_, L3_, L4_)
    plain = fanuc(tmp_path, text)
    found = fanuc(tmp_path, text, change=[("\n};", f"{GROUPS[group]}\n}};")])
    new = found.files["a.ls"].decode()
    assert not left(found) and new.count(GROUPS[group]) == 4
    assert new.replace(GROUPS[group], "") == plain.files["a.ls"].decode()


def test_a_group_before_the_arm_does_not_matter_and_a_position_without_the_arm_is_listed(tmp_path: Path) -> None:
    first = [("   GP1:", GUN[1:] + "\n   GP1:")]
    assert not left(fanuc(tmp_path, selecting(J1, L2_), change=first))
    none = fanuc(tmp_path, selecting(L2_, L4_), change=[("P[4]{\n   GP1:", "P[4]{\n   GP2:")])
    assert left(none) == [("P[4]", "other_robot")]


@pytest.mark.parametrize("word", ["COORD", "COORD[R]", "ACC80 COORD", "COORD PTH", "Weld Start[1,1] COORD"])
def test_a_move_coordinated_with_another_group_is_listed(word: str, tmp_path: Path) -> None:
    found = fanuc(tmp_path, selecting(J1, f"{L2_} {word}", L4_), change=[("\n};", f"{GUN}\n}};")])
    assert left(found) == [("P[2]", "coordinated")]


NEUTRAL = [
    "Weld Start[2,16]",
    "Arc End[R[3],R[4]]",
    "Weave Circle[1.0Hz,3.0mm,0.050s,0.050s]",
    "SPOT[SD=1,P=2,t=1.5,S=7,ED=2]",
    "TC_ONLINE (DI[76] AND !M[3] AND (M[14] OR F[2]))",
    "TIPDRESS[SD=1,P=2,t=1.0,TD=3,ED=1]",
    "PALLETIZING-END_3",
    "PL[1]=[1,1,1]",
    "$SPOTCONFIG.$WELD_ENBL=1",
    "$AWECFG.$WELD_SPEED=12",
    "SEMAPHORE[1]=ON",
    "TORQ_LIMIT 20.0%",
    "STOP_TRACKING",
    "VISION RUN_FIND 'LID'",
]


@pytest.mark.parametrize("instruction", NEUTRAL)
def test_an_instruction_that_changes_no_frame_is_passed(instruction: str, tmp_path: Path) -> None:
    assert not left(fanuc(tmp_path, listing(*SELECT, J1, instruction, L2_)))


OPTIONS = [
    "Arc Start[1]",
    "Weld End[2,16]",
    "SPOT[SD=1,P=1,S=1,ED=1]",
    "AP_LD50",
    "RT_LDR[1]",
    "CTV50",
    "RampTo R[100]",
    "CNT AR[2]",
    "TB   0.00sec,P-SPS",
    "DB  5.0mm,RO[1]=ON",
    "TA .20sec,DO[7:clamp]=PULSE,0.5sec",
    "\n    :  Weld Start[2,16]",
]


@pytest.mark.parametrize("option", OPTIONS)
def test_an_option_that_does_not_change_the_target_is_passed(option: str, tmp_path: Path) -> None:
    assert not left(fanuc(tmp_path, listing(*SELECT, J1, f"{L2_} {option}", L3_)))


CHANGING = {
    "Track TAST[1]": "tracked",
    "SOFTFLOAT[2]": "tracked",
    "Touch Offset PR[4]": "displaced",
    "MP OFFSET PR[4] RPM[1]": "displaced",
    "FORCE CTRL[1]": "not_understood",
    "GUN_ATTACH[1]": "not_understood",
    "$SHELL_CFG.$PROG_SELECT=3": "not_understood",
    "$PARAM_GROUP[1].$SV_OFF_ALL=1": "not_understood",
    "HAND1 OPEN": "not_understood",
    "CALL CHANGE_TOOL": "not_understood",
}


@pytest.mark.parametrize("instruction", CHANGING)
def test_an_instruction_that_may_change_something_is_the_reason(instruction: str, tmp_path: Path) -> None:
    found = fanuc(tmp_path, listing(*SELECT, J1, instruction, *SELECT, L2_))
    assert left(found)[-1] == ("P[2]", CHANGING[instruction])


@pytest.mark.parametrize("end", ["Track End", "SOFTFLOAT END", "Touch Offset End", "MP OFFSET END", "MP END"])
def test_a_path_change_ends_where_it_is_switched_off(end: str, tmp_path: Path) -> None:
    begin = {"T": "Track TAST[1]", "S": "SOFTFLOAT[1]", "M": "MP OFFSET PR[4] RPM[1]"}[end[0]]
    begin = "Touch Offset PR[4]" if end.startswith("Touch") else begin
    assert not left(fanuc(tmp_path, listing(*SELECT, J1, begin, end, L2_)))


def test_an_unknown_instruction_may_jump_to_its_label(tmp_path: Path) -> None:
    lines = ("UFRAME_NUM=0", J1, "BRANCH LBL[2]", *SELECT, "LBL[2]", L2_)
    assert left(fanuc(tmp_path, listing(*lines))) == [("P[2]", "not_understood")]


UNKNOWN = ["CALL B", "CALL B(1,R[2])", "HAND1 OPEN", "FORCE CTRL[1]", "$X.$Y=1", "IF R[1]=1,CALL B"]


@pytest.mark.parametrize("instruction", UNKNOWN)
def test_a_joint_move_to_joint_angles_depends_on_nothing_before(instruction: str, tmp_path: Path) -> None:
    moves = (instruction, J1, *SELECT, L2_, instruction, "L P[1] 200mm/sec FINE")
    assert left(fanuc(tmp_path, listing(instruction, J1, *SELECT))) == []
    line = fanuc(tmp_path, listing(*moves))
    assert ("P[1]", "not_understood") in left(line) and ("P[2]", "not_understood") in left(line)


LOGIC = "J P[1] 100% CNT0 ACC100 TB   0.00sec,P-SPS"
LOGIC_ROWS: dict[str, tuple[list[str], Named]] = {
    "signals": (["TC_ONLINE (ON)", "DO[23]=OFF", "WAIT (DI[23])", "F[1]=(ON)", "GO[19]=(1)"], []),
    "a program that is here": (["CALL B"], []),
    "a program that is not here": (["IF (DO[12]=ON),CALL C"], [("P[2]", "not_understood")]),
    "labels of its own": (
        ["LBL[1]", "IF (DI[1]),JMP LBL[2]", "DO[1]=ON", "JMP LBL[1]", "LBL[2]", "DO[1]=OFF"], []
    ),
    "a tool": (["UTOOL_NUM=2"], [("P[2]", "selected")]),
    "a frame": (["UFRAME[3]=PR[5]"], [("P[2]", "unknown_frame")]),
    "a label that the listing has, too": (["JMP LBL[7]", "LBL[7]"], []),
}  # fmt: skip


@pytest.mark.parametrize("row", LOGIC_ROWS)
def test_logic_along_a_move_is_followed(row: str, tmp_path: Path) -> None:
    inner, expected = LOGIC_ROWS[row]
    text = listing("UFRAME_NUM=3", "UTOOL_NUM=1", LOGIC, L2_, "LBL[7]", L3_.replace("P[3]", "P[2]"))
    block = "".join(f"      {k}:  {line} ;\n" for k, line in enumerate(inner, start=1)) + "       ------ ;\n"
    text = text.replace(f"{LOGIC} ;\n", f"{LOGIC}    ;\n{block}")
    found = fanuc(tmp_path, text, listing("RO[1]=ON", "WAIT RI[1]=ON", name="B"))
    assert left(found) == expected


AFTER_ACTION = {
    "TB .10sec,DO[1]=ON Offset,PR[3]": "offset",
    "TA .10sec,CALL B Tool_Offset,PR[4]": "offset",
    "TB   0.00sec,P-SPS Offset,PR[11]": "offset",
    "DB 5.0mm,RO[1]=ON INC": "relative",
    "TB .10sec,DO[1]=PULSE,0.2sec COORD": "coordinated",
    "TIME BEFORE .10sec,GO[1]=3 RTCP": "external_tcp",
    "TB .10sec,DO[1]=ON Magic": "not_understood",
}


@pytest.mark.parametrize("options", AFTER_ACTION)
def test_options_after_an_action_along_the_way_count(options: str, tmp_path: Path) -> None:
    found = fanuc(tmp_path, selecting(J1, f"{L2_} {options}"), listing("DO[1]=ON", name="B"))
    assert left(found)[0] == ("P[2]", AFTER_ACTION[options])


UP = "PR[5,3]=10"
KNOWN_OFFSETS = {
    "a condition": (*ZERO, UP, "OFFSET CONDITION PR[5]", L2_, f"{L2_} Offset"),
    "a condition of the tool": (*ZERO, UP, "TOOL_OFFSET CONDITION PR[5:up]", L2_, f"{L2_} Tool_Offset"),
    "a register cleared by the position": ("PR[5]=LPOS-LPOS", UP, L2_, f"{L2_} Offset,PR[5]"),
    "a copied register": (*ZERO, UP, "PR[6]=PR[5]", L2_, f"{L2_} Offset,PR[6:copy]"),
    "a negative number in brackets": (*ZERO, "PR[5,3]=(-10)", L2_, f"{L2_} Tool_Offset,PR[5]"),
    "a register set by a called program": ("CALL CLEAR5", UP, L2_, f"{L2_} Offset,PR[5]"),
}


@pytest.mark.parametrize("row", KNOWN_OFFSETS)
def test_an_offset_with_known_numbers_is_corrected_with_its_point(row: str, tmp_path: Path) -> None:
    found = fanuc(tmp_path, selecting(J1, *KNOWN_OFFSETS[row]), listing(*ZERO, name="CLEAR5"))
    assert not left(found) and "P[2]" in found.names and found.given_away_mm[found.names.index("P[2]")] > 0


UNKNOWN_OFFSETS = {
    "no condition": (f"{L2_} Offset",),
    "a condition of a stored register": ("OFFSET CONDITION PR[7]", f"{L2_} Offset"),
    "a register changed after the condition": (*ZERO, "OFFSET CONDITION PR[5]", UP, f"{L2_} Offset"),
    "a condition in another frame": (*ZERO, "OFFSET CONDITION PR[5],UFRAME[2]", f"{L2_} Offset"),
    "a called program with a condition": (*ZERO, "OFFSET CONDITION PR[5]", "CALL B", f"{L2_} Offset"),
    "a register written by a search": (*ZERO, "Search Start[1] PR[5]", f"{L2_} Offset,PR[5]"),
    "the result of a camera": (f"{L2_} VOFFSET,VR[1]",),
    "the difference of two registers": (*ZERO, "PR[5]=PR[5]-PR[5]", f"{L2_} Offset,PR[5]"),
}


@pytest.mark.parametrize("row", UNKNOWN_OFFSETS)
def test_an_offset_with_unknown_numbers_is_listed(row: str, tmp_path: Path) -> None:
    found = fanuc(tmp_path, selecting(J1, *UNKNOWN_OFFSETS[row]), listing("OFFSET CONDITION PR[9]", name="B"))
    assert left(found) == [("P[2]", "offset")]


CONVEYOR = "/APPL\n\nLINE_TRACK;\n  LINE_TRACK_SCHEDULE_NUMBER      : {};\n  CONTINUE_TRACK_AT_PROG_END      : TRUE;\n"


@pytest.mark.parametrize(("number", "reason"), [("0", None), ("1", "tracked"), ("7", "tracked"), ("*", "tracked")])
def test_the_header_of_a_conveyor_counts_unless_its_number_is_zero(
    number: str, reason: str | None, tmp_path: Path
) -> None:
    found = fanuc(tmp_path, selecting(L2_, head=CONVEYOR.format(number)))
    assert left(found) == ([("P[2]", reason)] if reason else [])


@pytest.mark.parametrize("mm", ["0.000", "-.000", ".001", "-.010", ".011", "232.799", ".949", "-1234.032"])
def test_an_extended_axis_of_the_arm_has_to_be_at_zero(mm: str, tmp_path: Path) -> None:
    found = fanuc(tmp_path, selecting(J1, L2_, L3_), change=[("\n};", f",\n\tE1= {mm:>9}  mm\n}};")])
    moved = [] if abs(float(mm)) <= 0.01 else [("P[2]", "external_axes"), ("P[3]", "external_axes")]
    assert left(found) == moved


@pytest.mark.parametrize("point", ["PAL_1[A_1]", "PAL_3[BTM]", "PAL_2[R_2:retract]", "PR[7]", "PR[R[98]]"])
def test_a_move_to_a_computed_position_leaves_the_others(point: str, tmp_path: Path) -> None:
    found = fanuc(tmp_path, listing(*SELECT, J1, L2_, f"L {point} 100mm/sec FINE", J1, L3_))
    assert left(found) == [(point, "computed")]


STATION = "EC00001=359\nEC00002=0,45\n"


def yaskawa(directory: Path, *files: str, positions: str = "") -> CorrectedProgram:
    """Correct a job next to others, with additional positions."""
    rig, filled = yaskawa_files({f"{'abc'[k]}.jbi": text for k, text in enumerate(files)})
    filled["a.jbi"] = filled["a.jbi"].replace("//INST", f"{positions}//INST", 1)
    return corrected_files(rig, directory, filled, ["3=0,0,150,0,0,0"], ["4=0"])


INDEPENDENT = {
    "a station in the move": ("MOVL C00002 EC00001 V=100.0",),
    "a station beside the move": ("MOVL C00002 V=100.0  +MOVJ EC00002 VJ=0.78",),
    "a station before the move": ("MOVJ EC00001 VJ=10.00", M2),
    "a variable of a station": ("MOVJ EX001 VJ=10.00", M2),
    "a second robot beside the move": ("MOVL C00002 V=100.0 +MOVL P007 V=20.0",),
    "a comment after the move": ("MOVL C00002 V=100.0 PL=0  //APPROACH CUT",),
    "a short name": ("MOVL C002 V=100.0",),
    "welding": ("ARCON ASF#(1)", "WVON WEV#(2)", M2, "WVOF", "ARCOF AEF#(1)"),
    "handling": ("HAND 1 ON", "TOOLON", M2, "SVSPOT GUN#(1) PRESSCL#(1) WTM=1 WST=1"),
}


@pytest.mark.parametrize("row", INDEPENDENT)
def test_other_axes_and_process_instructions_of_a_job_do_not_matter(row: str, tmp_path: Path) -> None:
    found = yaskawa(tmp_path, job_of(M1, *INDEPENDENT[row], M3), positions=STATION)
    assert uncorrected(found) == [] and found.names == ("C00001", "C00002", "C00003")
    assert STATION in found.files["a.jbi"].decode()


COORDINATED = [
    "SMOVL C00002 V=100.0  +MOVL EC00001",
    "SMOVL C00002 EC00001 V=100.0",
    "SMOVC C00002 V=100.0  +MOVJ EC00001 VJ=5.00",
    "MOVL C00002 V=100.0  +SMOVL EC00001 V=5.0",
    "SMOVJ C00002 VJ=10.00 +MOVJ EC00001",
]


@pytest.mark.parametrize("move", COORDINATED)
def test_a_move_coordinated_with_a_station_is_listed(move: str, tmp_path: Path) -> None:
    found = yaskawa(tmp_path, job_of(M1, move, M3), positions=STATION)
    assert uncorrected(found) == [(11, "coordinated")]


BASE_ROWS = {
    "0": [],
    "0,0": [],
    "878036": [(10, "external_axes"), (11, "external_axes"), (15, "external_axes")],
    "0,45": [(10, "external_axes"), (11, "external_axes"), (15, "external_axes")],
    "": [(10, "external_axes"), (11, "external_axes"), (15, "external_axes")],
}


@pytest.mark.parametrize("pulses", BASE_ROWS)
def test_a_base_axis_has_to_be_at_zero_for_a_pose(pulses: str, tmp_path: Path) -> None:
    moves = [move.replace(" V", " BC00001 V", 1) for move in (M1, M2, M3)]
    found = yaskawa(tmp_path, job_of(*moves), positions=f"BC00001={pulses}\n" if pulses else "")
    assert uncorrected(found) == BASE_ROWS[pulses]


VARIABLE_ROWS: dict[str, tuple[tuple[str, ...], tuple[str, ...], list[tuple[int, str]]]] = {
    "a target": (("MOVJ P020 VJ=10.00",), (), []),
    "two moves": (("MOVJ P020 VJ=10.00", "MOVL P00020 V=50.0"), (), []),
    "one that is set": (("MOVL P020 V=50.0", "SET P020 P021"), (), [(16, "changed")]),
    "one of which an element is set": (("SETE P020 (3) 20000", "MOVL P020 V=50.0"), (), [(16, "changed")]),
    "one that is read": (("MOVL P020 V=50.0", "SET LP000 P020"), (), [(16, "changed")]),
    "one that a shift uses": (("MOVL P020 V=50.0", "SFTON P020", "SFTOF"), (), [(16, "changed")]),
    "one of all axes": (("MOVL P020 V=50.0", "GETS PX020 $PX000"), (), [(16, "changed")]),
    "any of all": (("MOVL P020 V=50.0", "SET P[I001] P021"), (), [(16, "changed")]),
    "one that a job beside sets": (
        ("MOVL P020 V=50.0", "CALL JOB:B"), (job_of("ADD P020 P021", name="B", pos=BARE),), [(16, "changed")]
    ),
    "an argument of a job": (
        ("MOVL P020 V=50.0", "CALL JOB:B ARGFP020"), (job_of("NOP", name="B", pos=BARE),), [(16, "changed")]
    ),
    "one under a shift": (("SFTON P001", "MOVL P020 V=50.0", "SFTOF"), (), [(16, "displaced")]),
}  # fmt: skip


@pytest.mark.parametrize("row", VARIABLE_ROWS)
def test_a_position_variable_of_the_job_is_a_target_unless_it_is_used_otherwise(row: str, tmp_path: Path) -> None:
    lines, others, expected = VARIABLE_ROWS[row]
    pose = re.search(r"C00003=(.*)", yaskawa_files({"a.jbi": job_of(M1)})[1]["a.jbi"])
    assert pose
    found = yaskawa(tmp_path, job_of(M1, *lines, M3), *others, positions=f"P00020={pose[1]}\n")
    assert uncorrected(found) == expected
    assert ("P00020" in found.names) is not bool(expected)


def test_a_position_variable_of_another_job_is_listed(tmp_path: Path) -> None:
    other = job_of(name="B", pos="//POS\n///TOOL 3\n///POSTYPE BASE\n///RECTAN\nP00020=1,2,3,4,5,6\n//INST\nNOP\n")
    found = yaskawa(tmp_path, job_of(M1, "MOVL P020 V=50.0", M3), other, positions="P00020=1,2,3,4,5,6\n")
    assert uncorrected(found) == [(16, "changed")]


STATED = ["1=10,-20,180,0,30,10"], ["3=0"]
CALLS = ["CALL GRIP", "CALL GRIP(1,2)", "IF DI[1]=ON,CALL GRIP", "GRIP", "Hand open", "RUN GRIP"]


@pytest.mark.parametrize("call", CALLS)
def test_a_routine_stated_to_change_nothing_is_passed(call: str, tmp_path: Path) -> None:
    rig, files = fanuc_files({"a.ls": listing(*SELECT, J1, call, L2_)})
    assert left(corrected_files(rig, tmp_path, files, *STATED))[-1] == ("P[2]", "not_understood")
    found = corrected_files(rig, tmp_path, files, *STATED, neutral=["GRIP,Hand open"])
    assert not left(found) and found.neutral == ("GRIP", "Hand open")
    assert "GRIP" in " ".join(words_of(program_report.blocks(found)))
    assert program_report.as_object(found)["neutral_routines"] == ["GRIP", "Hand open"]


def test_the_file_of_a_routine_takes_precedence_over_the_statement(tmp_path: Path) -> None:
    rig, files = fanuc_files({"a.ls": listing(*SELECT, J1, "CALL GRIP", L2_), "grip.ls": listing("UFRAME[3]=PR[5]")})
    found = corrected_files(rig, tmp_path, files, *STATED, neutral=["GRIP"])
    assert left(found) == [("P[2]", "unknown_frame")] and not found.neutral


def test_routines_of_other_makers_can_be_stated(tmp_path: Path) -> None:
    kuka, program = kuka_files({"a.src": HEAD + "PTP {q0}\nGRIP(1)\nPTP {p1}\nEND\n"})
    assert uncorrected(corrected_files(kuka, tmp_path, program, *KUKA_STATED))
    assert not uncorrected(corrected_files(kuka, tmp_path, program, *KUKA_STATED, neutral=["GRIP"]))
    abb, module = abb_files(module_of("MoveAbsJ {q0},v9,fine,t;\nGRIP;\nMoveL {p1},v9,fine,t;\n"))
    assert uncorrected(corrected_files(abb, tmp_path, module))
    assert not uncorrected(corrected_files(abb, tmp_path, module, neutral=["GRIP"]))
    yaskawa, job = yaskawa_files({"a.jbi": job_of(M1, "CALL JOB:GRIP IF IN#(1)=ON", M2)})
    frames = ["3=0,0,150,0,0,0"], ["4=0"]
    assert uncorrected(corrected_files(yaskawa, tmp_path, job, *frames))
    assert not uncorrected(corrected_files(yaskawa, tmp_path, job, *frames, neutral=["GRIP"]))
    yaskawa, job = yaskawa_files({"a.jbi": job_of(M1, "MACRO1 MJ#(0) ARGF8", M2)})
    assert uncorrected(corrected_files(yaskawa, tmp_path, job, *frames, neutral=["MACRO2"]))
    assert not uncorrected(corrected_files(yaskawa, tmp_path, job, *frames, neutral=["macro1"]))
    ur, script = ur_files({"a.script": "movej({q0})\n"})
    with pytest.raises(UseError):
        corrected_files(ur, tmp_path, script, neutral=["GRIP"])


@pytest.mark.parametrize("names", ["", "GRIP,", "../GRIP", "GRIP{}", "GRIP\nCALL"])
def test_a_name_that_is_not_one_of_a_routine_is_refused(names: str) -> None:
    with pytest.raises(UseError):
        frames_of(rig_of("ur10e").robot, [], [], [names])


def test_joint_angles_reached_with_and_without_an_offset_are_corrected_and_the_offset_is_listed(tmp_path: Path) -> None:
    found = fanuc(tmp_path, listing(*SELECT, "J P[1] 20% FINE Offset,PR[25]", "L P[1] 100mm/sec FINE", J1))
    assert "P[1]" in found.names and [(one.line, one.reason) for one in found.left if one.name == "P[1]"] == [
        (5, "offset")
    ]


@pytest.mark.parametrize("elbow_deg", [-100, -120, -150, 20, 170])
def test_config_leaves_one_turn_of_the_elbow(elbow_deg: float, tmp_path: Path) -> None:
    """J2 + J3 turns less than a full turn, although the range of J3 alone exceeds it."""
    rig = rig_of("fanuc-m-20ia")
    arm, q = arm_of(rig.robot), np.radians([10, 60, elbow_deg, 20, -60, 30])
    flip, up, front = configuration_of(arm, q)
    letters = f"{'F' if flip else 'N'} {'U' if up else 'D'} {'T' if front else 'B'}"
    pose = fanuc_pose(rig, np.degrees(q).tolist(), np.eye(4))
    point = fanuc_point(2, re.sub("'. . .,", f"'{letters},", pose), "UF : 3, UT : 1,").replace("\r", "")
    text = f"{listing('UFRAME_NUM=3', 'UTOOL_NUM=1', 'J P[2] 20% FINE')}/POS\n{point}\n/END\n"
    found = corrected_files(rig, tmp_path, {"a.ls": text}, *STATED)
    assert found.names == ("P[2]",) and not found.left
