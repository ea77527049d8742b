"""Programs as users have them, with parts that must not change, corrected for an arm with errors.

After the correction the numbers are read back by expressions of the test, and the arm with errors has to be where the
nominal arm was sent.
"""

import difflib
import re
from collections.abc import Sequence

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.apps.makers.configuration import configuration_of
from analysis.apps.makers.numbers import replaced, written
from analysis.apps.makers.target import Number
from analysis.robot.kinematics.arm import arm_of
from rigs.rig import Rig
from tests.analysis.apps.correct.programs.cells import (
    ABB,
    ABB_TOOL,
    FANUC,
    FANUC_TOOL,
    FANUC_USER,
    KUKA,
    KUKA_BASE,
    KUKA_TOOL,
    NUMBER,
    UR,
    UR_TOOL,
    YASKAWA,
    YASKAWA_STATED,
    YASKAWA_TOOL,
    corrected,
    fanuc_joints,
    fanuc_point,
    fanuc_pose,
    kuka_pose,
    quaternion,
    robtarget_of,
    uncorrected,
    ur_pose,
    yaskawa_pose,
)
from tests.worlds.arms.faulty_arm import flange_at, frame, hidden, joints_of
from tests.worlds.arms.independent_arm import Array
from tests.worlds.interpreters.arms import rig_of


def _lines(data: bytes) -> list[str]:
    return data.decode("latin-1").split("\n")


def _changed(given: bytes, data: bytes) -> set[int]:
    """Numbers of the changed lines. Only numbers may change in them."""
    assert re.sub(rf" *{NUMBER}", "#", given.decode("latin-1")) == re.sub(rf" *{NUMBER}", "#", data.decode("latin-1"))
    before, after = _lines(given), _lines(data)
    assert len(before) == len(after), "\n".join(difflib.unified_diff(before, after, lineterm=""))
    return {k for k, (one, other) in enumerate(zip(before, after, strict=True), start=1) if one != other}


def _left_mm(rig: Rig, told: Array, q_deg: Sequence[float], tool: Array) -> float:
    """Return the distance in mm between the tool of the imperfect arm and the nominal target, for a commanded flange
    pose.
    """
    q = np.radians(q_deg)
    real = flange_at(rig, joints_of(rig, told, q), hidden()) @ tool
    return float(np.linalg.norm(real[:3, 3] - (flange_at(rig, q) @ tool)[:3, 3]))


def _values(line: str) -> list[float]:
    return [float(value) for value in re.findall(NUMBER, line)]


UR_PROGRAM = """\
# movej([0, 0, 0, 0, 0, 0]) was here: p[.1, .2, .3, 0, 0, 0]
def pick_and_place():\r
\tset_tcp(p[0.0, 0.0, 0.145, 0.0, 0.0, 0.0])  # Greifer \xe4\xf6
  textmsg("movel(p[.1, .2, .3, 0, 0, 0])")
  global Waypoint_1_p=p[{p1}]
  global Waypoint_1_q=[{q1}]
  clear = [{q0}]
  movej(clear, a=1.4, v=1.05)
  $ 3 "Waypoint_1 p[0, 0, 0, 0, 0, 0]" "breakAfter"
  movej(get_inverse_kin(Waypoint_1_p, qnear=Waypoint_1_q), a=1.3962634015954636, v=1.0471975511965976)
  movel(  p[{p2}] , a=1.2,
        v=0.25)
  movel(pose_add(get_actual_tcp_pose(), p[0, 0, 0.1, 0, 0, 0]), a=1.2, v=0.25)
  movel(p[{p3}], a=1.2, v=0.25)
  if (get_standard_digital_in(0)):
    movej([{q3}], a=1.4, v=1.05)
    movel(p[{p4}], a=1.2, v=0.25, r=0.002)
  end
  movej([0, d2r(-90), 0, 0, 0, 0])
  movej([{q5}])
  movec(p[{p6}], p[{p5}], a=1.2, v=0.1, mode=0)
  movej(elsewhere)
end
pick_and_place()
"""


def _from_ur(line: str, tool: Array) -> Array:
    values = _values(line[line.index("p[") :])[:6]
    return frame(1e3 * np.array(values[:3]), Rotation.from_rotvec(values[3:])) @ np.linalg.inv(tool)


def test_urscript(tmp_path):
    rig = rig_of("ur10e")
    T = [flange_at(rig, np.radians(q)) @ UR_TOOL for q in UR]
    poses = {f"p{k}": ur_pose(one) for k, one in enumerate(T)}
    joints = {f"q{k}": ", ".join(repr(float(np.radians(angle))) for angle in q) for k, q in enumerate(UR)}
    path = tmp_path / "pick.script"
    path.write_bytes(UR_PROGRAM.format(**poses, **joints).encode("latin-1"))
    found = corrected(rig, path)
    data = found.files["pick.script"]
    assert _changed(path.read_bytes(), data) == {5, 7, 11, 16, 17, 20, 21}
    assert uncorrected(found) == [(13, "computed"), (14, "no_posture"), (19, "computed"), (22, "not_literal")]
    lines = _lines(data)
    for number, k in ((5, 1), (11, 2), (17, 4), (21, 6)):
        assert _left_mm(rig, _from_ur(lines[number - 1], UR_TOOL), UR[k], UR_TOOL) < 1e-4
    for number, k in ((7, 0), (16, 3), (20, 5)):
        told = np.array(_values(lines[number - 1][lines[number - 1].index("[") :])[:6])
        assert _left_mm(rig, flange_at(rig, told), UR[k], UR_TOOL) < 1e-4
    assert lines[4].startswith("  global Waypoint_1_p=p[") and "0." not in lines[4]
    assert found.rounded_um.max() < 0.1 and found.moved_mm.min() > 0.1


FANUC_PROGRAM = """\
/PROG  PICK_PART\r
/ATTR\r
OWNER\t\t= MNEDITOR;\r
COMMENT\t\t= "P[2] X = 1.0 mm";\r
DEFAULT_GROUP\t= 1,*,*,*,*;\r
/MN\r
   1:  !J P[1] 100% FINE ;\r
   2:  UFRAME_NUM=0 ;\r
   2:  UTOOL_NUM=1 ;\r
   3:J P[1] 100% FINE    ;\r
   4:L P[2:"PICK"] 200mm/sec FINE    ;\r
   5:  //L P[2] 200mm/sec CNT50 ;\r
   6:L P[2:"PICK"] 50mm/sec FINE Offset,PR[5]    ;\r
   7:  UFRAME_NUM=3 ;\r
   7:C P[3]    \r
    :  P[4] 100mm/sec CNT100    ;\r
   8:  UFRAME_NUM=0 ;\r
   8:L P[5] 100mm/sec FINE INC    ;\r
   9:L PR[7] 100mm/sec FINE    ;\r
  10:L PR[R[3]] 100mm/sec FINE    ;\r
  11:  MESSAGE[P[4] X = 3.0 mm] ;\r
  12:J P[6] 20% FINE    ;\r
  13:L P[7] 20mm/sec FINE    ;\r
  14:  UTOOL_NUM=2 ;\r
  14:L P[8] 20mm/sec FINE    ;\r
/POS\r
{points}\r
/END\r
"""


def test_fanuc(tmp_path):
    rig = rig_of("fanuc-m-10ia")
    base = np.eye(4)
    poses = [fanuc_pose(rig, q, base) for q in FANUC]
    points = [
        fanuc_point(1, fanuc_joints(FANUC[0]), "UF : 0, UT : 1,\t"),
        fanuc_point(2, poses[1], "UF : 0, UT : 1,"),
        fanuc_point(3, fanuc_pose(rig, FANUC[2], FANUC_USER), "UF : 3, UT : 1,"),
        fanuc_point(4, fanuc_pose(rig, FANUC[3], FANUC_USER), "UF : 3, UT : 1,"),
        fanuc_point(5, poses[1], "UF : 0, UT : 1,"),
        fanuc_point(6, fanuc_joints(FANUC[0]) + ",\r\n\tE1=     0.000  mm", "UF : 0, UT : 1,\t"),
        fanuc_point(7, poses[1].replace("0, 0, 0'", "0, 0, 3'"), "UF : 0, UT : 1,"),
        fanuc_point(8, poses[1], "UF : 0, UT : 2,"),
    ]
    path = tmp_path / "PICK_PART.LS"
    path.write_bytes(FANUC_PROGRAM.format(points="\r\n".join(points)).encode())
    tool = "1=10,-20,180,0,30,10"
    found = corrected(rig, path, [tool], ["3=700,100,50,0,0,30"])
    data, given = found.files["PICK_PART.LS"], path.read_bytes()
    lines = _lines(data)
    at = {
        number: next(k for k, line in enumerate(lines) if line.startswith(f"P[{number}") and "{" in line)
        for number in range(1, 9)
    }
    rows = {at[k] + row for k in (1, 2, 3, 4, 6) for row in (4, 5)}
    assert _changed(given, data) == rows
    assert [len(line) for line in lines] == [len(line) for line in _lines(given)]  # the columns stand as they stood
    assert uncorrected(found) == [
        (13, "offset"),  # its register stands in the controller
        (18, "relative"),
        (19, "computed"),
        (20, "computed"),
        (at[5] + 1, "changed"),
        (at[7] + 1, "other_flags"),
        (at[8] + 1, "unknown_tool"),
    ]
    told = np.array([value for row in lines[at[1] + 3 : at[1] + 5] for value in _values(row.replace("J", "J_"))[1::2]])
    assert _left_mm(rig, flange_at(rig, np.radians(told)), FANUC[0], FANUC_TOOL) < 0.02
    for number, k in ((3, 2), (4, 3)):
        x, y, z, w, p, r = (value for row in lines[at[number] + 3 : at[number] + 5] for value in _values(row))
        X = frame((x, y, z), Rotation.from_euler("xyz", (w, p, r), degrees=True))
        flange = FANUC_USER @ X @ np.linalg.inv(FANUC_TOOL)
        # What is left is of the three decimals that a controller prints, in the given program and in the new one.
        assert _left_mm(rig, flange, FANUC[k], FANUC_TOOL) < 0.02
    assert 1 < found.rounded_um.max() < 20 and found.moved_mm.min() > 0.1


KUKA_SOURCE = """\
&ACCESS RVP\r
&REL 4\r
DEF  pick( )\r
;FOLD INI;%{PE}\r
  BAS (#INITMOV,0 )\r
;ENDFOLD (INI)\r
PTP {A1 20.0, A2 -80, A3 90.000, A4 30, A5 60.0, A6 -20.0, E1 0.0}\r
;FOLD PTP P1 Vel=100 % PDAT1 Tool[1]:Greifer Base[2]:Tisch;%{PE}%R 8.3.38\r
PDAT_ACT=PPDAT1\r
FDAT_ACT=FP1\r
BAS(#PTP_PARAMS,100)\r
SET_CD_PARAMS (0)\r
PTP XP1 \r
;ENDFOLD\r
; LIN {X 1.0, Y 2.0, Z 3.0, A 0, B 0, C 0}\r
PTP {A1 -28.0, A2 -72, A3 98.000, A4 98, A5 -57.0, A6 198.0}\r
SLIN XP2 WITH $VEL = SVEL_CP(2.0, , LCPDAT1), $TOOL = STOOL2(FP1), $BASE = SBASE(FP1.BASE_NO), \
$LOAD = SLOAD(FP1.TOOL_NO), $COLLMON_TOL_PRO[1] = USE_CM_PRO_VALUES(0), C_SPL\r
LIN_REL {Z 100.0}\r
LIN XP3\r
CIRC XP3, XP4, CA 90\r
PTP XHOME\r
FDAT_ACT=FP9\r
PTP XP5\r
PTP P_OFF:XP1\r
MsgNotify("PTP {A1 0, A2 0, A3 0, A4 0, A5 0, A6 0}")\r
END\r
"""


def _from_krl(line: str) -> Array:
    x, y, z, *turn = (float(value) for value in re.findall(rf"\b[XYZABC] ({NUMBER})", line))
    return KUKA_BASE @ frame((x, y, z), Rotation.from_euler("ZYX", turn, degrees=True)) @ np.linalg.inv(KUKA_TOOL)


def test_kuka(tmp_path):
    rig = rig_of("kuka-kr-10-r1100-2")
    path, data_path = tmp_path / "Pick.src", tmp_path / "Pick.dat"
    path.write_bytes(KUKA_SOURCE.encode())
    poses = [kuka_pose(rig, q) for q in KUKA]
    declared = [
        "&ACCESS RVP",
        "DEFDAT  PICK",
        "EXT  BAS (BAS_COMMAND  :IN,REAL  :IN )",
        'DECL FDAT FP1={TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}',
        'DECL FDAT FP9={TOOL_NO 9,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " "}',
        f"DECL E6POS XP1={{{poses[1]}}}",
        f"DECL E6POS XP2={{{poses[2]}}}",
        f"DECL E6POS XP3={{{poses[3].replace('E1 0.0', 'E1 150.0')}}}",
        f"; DECL E6POS XP3={{{poses[3]}}}",
        f"DECL E6POS XP4={{{poses[4]}}}",
        f"DECL E6POS XP5={{{poses[4]}}}",
        "ENDDAT",
        "",
    ]
    data_path.write_bytes("\r\n".join(declared).encode())
    found = corrected(rig, path, ["1=0,50,200,0,20,10"], ["2=500,-100,30,0,0,45"])
    # XP1 stands behind a geometric operator, too, so it is not changed.
    assert _changed(path.read_bytes(), found.files["Pick.src"]) == {7, 16}
    assert _changed(data_path.read_bytes(), found.files["Pick.dat"]) == {7}
    assert [(one.file, one.line, one.reason) for one in found.left] == [
        (0, 18, "relative"),
        (0, 20, "arc"),
        (0, 20, "arc"),
        (0, 21, "not_literal"),
        (0, 24, "computed"),
        (1, 6, "changed"),
        (1, 8, "external_axes"),
        (1, 10, "changed"),
        (1, 11, "unknown_tool"),
    ]
    a, *_ = ([float(v) for v in re.findall(rf"A\d ({NUMBER})", line)] for line in _lines(found.files["Pick.src"])[6:7])
    assert _left_mm(rig, flange_at(rig, np.radians(a)), KUKA[0], KUKA_TOOL) < 1e-3
    assert _left_mm(rig, _from_krl(_lines(found.files["Pick.dat"])[6]), KUKA[2], KUKA_TOOL) < 1e-3


ABB_OBJECT = frame((300, 50, 100), Rotation.from_euler("z", 20, degrees=True))


ABB_PROGRAM = """\
%%%\r
  VERSION:1\r
  LANGUAGE:ENGLISH\r
%%%\r
MODULE MainModule\r
  ! MoveL [[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tGripper;\r
  PERS tooldata tGripper:=[TRUE,[[5,0,90],[{tool}]],[1,[0,0,50],[1,0,0,0],0,0,0]];\r
  PERS wobjdata wTable:=[FALSE,TRUE,"",[[300,50,100],[{object}]],[[0,0,0],[1,0,0,0]]];\r
  CONST jointtarget jClear:=[[20,10,20,30,60,-40],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];\r
  CONST robtarget pPick:=\r
    {pick};\r
  LOCAL CONST robtarget pRail:={rail};\r
  VAR robtarget pMoving:={pick};\r
  PROC main()\r
    TPWrite "MoveAbsJ [[0,0,0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]";\r
    MoveAbsJ jClear\\NoEOffs,v1000,z50,tGripper;\r
    MoveJ Offs(pPick,0,0,90),v1000,z10,tGripper\\WObj:=wTable;\r
    MoveL pPick,v100,fine,tGripper\\WObj:=wTable;\r
    Set doGrip;\r
    MoveL {inline},\r
      v100,fine,tGripper;\r
    pMoving:=CRobT(\\Tool:=tGripper);\r
    MoveL pMoving,v100,fine,tGripper;\r
    MoveL pRail,v100,fine,tGripper\\WObj:=wTable;\r
    MoveL pElsewhere,v100,fine,tGripper;\r
    MoveJ {other},v100,fine,tOther;\r
    IF diPart=1 THEN\r
      Place;\r
    ENDIF\r
  ENDPROC\r
  PROC Place()\r
    Reset doGrip;\r
  ENDPROC\r
ENDMODULE\r
"""


def _from_rapid(line: str) -> Array:
    values = _values(line)
    return frame(values[:3], Rotation.from_quat(values[3:7], scalar_first=True)) @ np.linalg.inv(ABB_TOOL)


def test_abb(tmp_path):
    rig, path = rig_of("abb-irb-120"), tmp_path / "MainModule.mod"
    text = ABB_PROGRAM.format(
        tool=quaternion(ABB_TOOL),
        object=quaternion(ABB_OBJECT),
        pick=robtarget_of(rig, ABB[1], ABB_OBJECT),
        rail=robtarget_of(rig, ABB[1], ABB_OBJECT, "0.0"),
        inline=robtarget_of(rig, ABB[2], np.eye(4)),
        other=robtarget_of(rig, ABB[3], np.eye(4)),
    )
    path.write_bytes(text.encode())
    found = corrected(rig, path)
    data = found.files["MainModule.mod"]
    assert _changed(path.read_bytes(), data) == {9, 11, 12, 20}
    assert uncorrected(found) == [
        (13, "changed"),
        (25, "not_literal"),
        (26, "unknown_tool"),
    ]
    lines = _lines(data)
    assert _left_mm(rig, flange_at(rig, np.radians(_values(lines[8])[:6])), ABB[0], ABB_TOOL) < 1e-3
    # The given coordinates have six digits.
    assert _left_mm(rig, _from_rapid(lines[19]), ABB[2], ABB_TOOL) < 2e-3


@pytest.mark.parametrize(
    ("text", "value", "new"),
    [
        ("X =   999.990  mm", 1000.1234, "X =  1000.123  mm"),
        ("X =  1000.001  mm", 999.9876, "X =   999.988  mm"),
        ("X = 999.990 mm", -0.00001, "X = 0.000 mm"),
        ("X = +1.5 mm", 1.6, "X = +1.600 mm"),
        ("X = -.5 mm", -0.6, "X = -.600 mm"),
        ("X = 1.5E+02 mm", 150.0001, "X = 150.0001000 mm"),
        ("X = 90 mm", 90.0, "X = 90 mm"),
        ("X = 1.23456789012 mm", 2.0, "X = 2.0000000 mm"),
    ],
)
def test_a_number_keeps_its_style_and_its_column(text, value, new):
    found = re.search(NUMBER, text)
    number = Number(found.start(), found.end(), float(found[0]))
    assert replaced(text, [(number, written(number, text, value, "roll_pitch_yaw", (3, 7)))]) == new


SCALE = (1365.3, -1137.8, 1000.0, 1024.0, -1024.0, 568.9)


YASKAWA_PROGRAM = """\
/JOB\r
//NAME PICK\r
//POS\r
///NPOS 5,0,1,1,0,0\r
///TOOL 3\r
///POSTYPE PULSE\r
///PULSE\r
C00000={pulses}\r
///POSTYPE USER\r
///USER 4\r
///RECTAN\r
///RCONF {form},0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0\r
C00001={pose1}\r
C00002={pose2}\r
C00003={pose2}\r
C00004={pose2}\r
EC00000=1000\r
///POSTYPE PULSE\r
///PULSE\r
P00001=0,0,0,0,0,0\r
//INST\r
///DATE 2026/01/21 16:46\r
///ATTR SC,RW\r
///GROUP1 RB1\r
NOP\r
'MOVJ C00000 VJ=10.00\r
MOVJ C00000 VJ=10.00\r
MOVL C00001 V=100.0\r
MOVL C00002 V=100.0 +MOVJ EC00000\r
IMOV P001 V=10.0\r
SFTON P002\r
MOVL C00003 V=100.0\r
SFTOF\r
MOVJ P001 VJ=5.00\r
MOVL C00004 V=100.0 'C00004=1,2,3,4,5,6\r
END\r
"""


def test_yaskawa(tmp_path):
    rig, path = rig_of("yaskawa-gp7"), tmp_path / "PICK.JBI"
    (flags,) = {configuration_of(arm_of(rig.robot), np.radians(q)) for q in YASKAWA}
    form = f"{','.join(str(int(not flag)) for flag in flags)},0,0,0"
    pulses = ",".join(str(round(angle * scale)) for angle, scale in zip(YASKAWA[0], SCALE, strict=True))
    poses = {f"pose{k}": yaskawa_pose(rig, YASKAWA[k]) for k in (1, 2)}
    path.write_bytes(YASKAWA_PROGRAM.format(pulses=pulses, form=form, **poses).encode())
    listed = [(15, "displaced"), (20, "changed"), (30, "relative")]
    without = corrected(rig, path, *YASKAWA_STATED)
    assert uncorrected(without) == [(8, "no_scale"), *listed]
    found = corrected(rig, path, *YASKAWA_STATED, SCALE)
    data = found.files["PICK.JBI"]
    assert _changed(path.read_bytes(), data) == {8, 13, 14, 16}
    assert uncorrected(found) == listed
    lines = _lines(data)
    told = np.array(_values(lines[7][7:])) / SCALE
    # A pulse is 0.001°, 15 µm at the tool; the given program has the same rounding.
    assert _left_mm(rig, flange_at(rig, np.radians(told)), YASKAWA[0], YASKAWA_TOOL) < 0.05
    for number, k in ((13, 1), (14, 2), (16, 2)):
        x, y, z, *turn = _values(lines[number - 1][7:])
        X = frame((x, y, z), Rotation.from_euler("xyz", turn, degrees=True))
        assert _left_mm(rig, X @ np.linalg.inv(YASKAWA_TOOL), YASKAWA[k], YASKAWA_TOOL) < 5e-3
