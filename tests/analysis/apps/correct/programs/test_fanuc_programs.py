"""Programs of FANUC: other motion groups, extended axes, CONFIG, and the reason of a recursive program."""

import re
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.correct.corrected_program import CorrectedProgram
from analysis.apps.makers.configuration import configuration_of
from analysis.robot.kinematics.arm import arm_of
from tests.analysis.apps.correct.programs.cells import (
    FANUC_STATED,
    J1,
    L2,
    L3,
    L4,
    corrected_cell,
    corrected_files,
    fanuc_files,
    fanuc_point,
    fanuc_pose,
    left_names,
    listing,
    selecting,
)
from tests.worlds.interpreters.arms import rig_of


@pytest.mark.parametrize(("called", "file", "line"), [("A", 0, 3), ("B", 1, 4)], ids=("itself", "another"))
def test_reason_of_a_recursive_program_is_the_line_of_the_call(called, file, line, tmp_path):
    call = f"CALL {called}"
    files = {"a.ls": selecting(call, L2), "b.ls": listing("R[1]=R[1]+1", call, name="B")}
    found = corrected_cell("fanuc", tmp_path, files)
    (left,) = (one for one in found.left if one.name == "P[2]")
    assert left.reason == "not_understood" and (left.because[0].file, left.because[0].line) == (file, line)


def changed(directory: Path, text: str, old: str = "", new: str = "") -> CorrectedProgram:
    """Correct a listing after a change of its text."""
    rig, files = fanuc_files({"a.ls": text})
    assert old in files["a.ls"]
    return corrected_files(rig, directory, {"a.ls": files["a.ls"].replace(old, new)}, *FANUC_STATED)


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
def test_other_motion_groups_do_not_matter_and_keep_their_bytes(group, tmp_path):
    text = selecting(J1, L2, L3, L4)
    plain = changed(tmp_path, text)
    found = changed(tmp_path, text, "\n};", f"{GROUPS[group]}\n}};")
    new = found.files["a.ls"].decode()
    assert not left_names(found) and new.count(GROUPS[group]) == 4
    assert new.replace(GROUPS[group], "") == plain.files["a.ls"].decode()


def test_workpiece_in_the_hand_is_listed_with_its_reason(tmp_path):
    found = changed(tmp_path, selecting(L4), "\tX =", "\tRX =")
    assert ("P[4]", "external_tcp") in left_names(found)


def test_position_without_the_arm_is_listed_and_a_group_before_the_arm_is_not(tmp_path):
    assert not left_names(changed(tmp_path, selecting(J1, L2), "   GP1:", GUN[1:] + "\n   GP1:"))
    assert left_names(changed(tmp_path, selecting(L2, L4), "P[4]{\n   GP1:", "P[4]{\n   GP2:")) == [
        ("P[4]", "other_robot")
    ]


@pytest.mark.parametrize("mm", ["0.000", "-.000", ".001", "-.010", ".011", "232.799", ".949", "-1234.032"])
def test_extended_axis_of_the_arm_has_to_be_at_zero(mm, tmp_path):
    found = changed(tmp_path, selecting(J1, L2, L3), "\n};", f",\n\tE1= {mm:>9}  mm\n}};")
    moved = [] if abs(float(mm)) <= 0.01 else [("P[2]", "external_axes"), ("P[3]", "external_axes")]
    assert left_names(found) == moved


@pytest.mark.parametrize("elbow_deg", [-100, -120, -150, 20, 170])
def test_config_leaves_one_turn_of_the_elbow(elbow_deg, tmp_path):
    """J2 + J3 turns less than a full turn, although the range of J3 alone exceeds it."""
    rig = rig_of("fanuc-m-20ia")
    arm, q = arm_of(rig.robot), np.radians([10, 60, elbow_deg, 20, -60, 30])
    flip, up, front = configuration_of(arm, q)
    letters = f"{'F' if flip else 'N'} {'U' if up else 'D'} {'T' if front else 'B'}"
    pose = fanuc_pose(rig, np.degrees(q).tolist(), np.eye(4))
    point = fanuc_point(2, re.sub("'. . .,", f"'{letters},", pose), "UF : 3, UT : 1,").replace("\r", "")
    text = f"{listing('UFRAME_NUM=3', 'UTOOL_NUM=1', 'J P[2] 20% FINE')}/POS\n{point}\n/END\n"
    found = corrected_files(rig, tmp_path, {"a.ls": text}, *FANUC_STATED)
    assert found.names == ("P[2]",) and not found.left


BACKGROUND = "/PROG  BGL\n/ATTR\nDEFAULT_GROUP\t= {groups};\n/MN\n   1:  {line} ;\n/POS\n/END\n"
SETS_FRAME = [*(f"PR[5,{k}]={value}" for k, value in enumerate((0, 0, 0, 0, 0, 0), 1)), "UFRAME[3]=PR[5]"]


@pytest.mark.parametrize(
    ("groups", "line", "call", "known"),
    [
        ("*,*,*,*,*", "PR[5,6]=(R[6])", "", False),
        ("*,*,*,*,*", "UFRAME[3]=PR[9]", "", False),
        ("*,1,*,*,*", "PR[5,1]=7", "", False),
        ("1,*,*,*,*", "PR[5,6]=(R[6])", "", True),
        ("*,*,*,*,*", "R[5]=(R[6])", "", True),
        ("*,*,*,*,*", "PR[6,6]=(R[6])", "", True),
        ("*,*,*,*,*", "PR[5,6]=(R[6])", "CALL BGL", True),
    ],
)
def test_listing_that_nothing_calls_may_set_a_frame_at_any_moment(tmp_path, groups, line, call, known):
    text = selecting(*([call] if call else []), *SETS_FRAME, L2)
    background = BACKGROUND.format(groups=groups, line=line)
    found = corrected_cell("fanuc", tmp_path, {"a.ls": text, "bgl.ls": background})
    if known:
        assert "P[2]" in found.names
    else:
        (left,) = (one for one in found.left if one.name == "P[2]")
        assert left.reason == "unknown_frame" and left.because[0].file == 1
