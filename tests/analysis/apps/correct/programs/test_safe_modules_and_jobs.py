"""What a program does to tool, frame and arm on its way to a target, in RAPID, TP and INFORM: rows as of
`test_safe_programs`.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.makers.configuration import configuration_of
from analysis.robot.kinematics.arm import arm_of
from rigs.rig import Rig
from tests.analysis.apps.correct.programs.test_safe_programs import Left, corrected_files, uncorrected, with_targets
from tests.analysis.apps.correct.programs.test_user_programs import (
    ABB,
    ABB_TOOL,
    FANUC,
    YASKAWA,
    fanuc_joints,
    fanuc_point,
    fanuc_pose,
    quaternion,
    robtarget_of,
    yaskawa_pose,
)
from tests.worlds.interpreters.arms import rig_of


def abb_files(files: dict[str, str]) -> tuple[Rig, dict[str, str]]:
    rig = rig_of("abb-irb-120")
    tool = f"PERS tooldata t:=[TRUE,[[5,0,90],[{quaternion(ABB_TOOL)}]],[1,[0,0,50],[1,0,0,0],0,0,0]];"

    def joints(k: int) -> str:
        return f"[[{','.join(map(str, ABB[k]))}],[9E9,9E9,9E9,9E9,9E9,9E9]]"

    filled = with_targets(files, lambda k: robtarget_of(rig, ABB[k], np.eye(4)), joints, len(ABB))
    return rig, {name: text.replace("{t}", tool) for name, text in filled.items()}


def module_of(body: str, rest: str = "", data: str = "") -> dict[str, str]:
    return {"a.mod": f"MODULE a\n{{t}}\n{data}\nPROC main()\n{body}ENDPROC\n{rest}ENDMODULE\n"}


L0, L1, L2 = (f"MoveL {{p{k}}},v9,fine,t;\n" for k in range(3))
HAND = "PERS tooldata t:=[TRUE,[[0,0,350],[1,0,0,0]],[1,[0,0,50],[1,0,0,0],0,0,0]];\n"
J0 = "MoveAbsJ {q0},v9,fine,t;\n"
ABB_ROWS: dict[str, tuple[dict[str, str], Left]] = {
    "plain": (module_of(J0 + L1 + L2), []),
    "a usual program": (
        module_of(
            "AccSet 50,50;\nConfL\\On;\nSingArea\\Off;\nReset do1;\nTPErase;\nTPWrite \"x\";\n" + J0
            + "Grip;\nSetDO do2,1;\nWaitTime 0.5;\nIF di1=1 THEN\nn:=n+Abs(m);\nELSE\nStop;\nENDIF\n" + L1
            + "IF di2=1 SetDO do1,0;\nFOR i FROM 1 TO 3 DO\n" + L2 + "ENDFOR\nWHILE n<3 DO\nIncr n;\nENDWHILE\n"
            "TEST n\nCASE 1:\n" + L1 + "DEFAULT:\nExitCycle;\nENDTEST\nGripLoad load0;\nClkReset c;\n",
            "PROC Grip()\nSet do3;\nWaitDI di3,1;\nENDPROC\n",
        ),
        [],
    ),
    "a tool that a routine is given": (
        module_of(J0 + "go t;\n", "PROC go(PERS tooldata t)\nMoveJ {p1},v9,fine,t;\nENDPROC\n"), [(9, "unknown_tool")]
    ),
    "a tool of a routine's own": (
        module_of(J0 + "go;\n", "PROC go()\nVAR tooldata t;\nt:=x;\nMoveJ {p1},v9,fine,t;\nENDPROC\n"),
        [(11, "unknown_tool")],
    ),
    "an IF without THEN": (module_of(J0 + "IF a=1 PDispSet p;\n" + L1), [(7, "displaced")]),
    "a work object that a routine may be given": (
        module_of(J0 + "go;\n", "PROC go(\\PERS wobjdata w)\nMoveJ {p1},v9,fine,t\\WObj?w;\nENDPROC\n"),
        [(9, "unknown_frame")],
    ),
    "a work object of a list": (module_of(J0 + "MoveJ {p1},v9,fine,t\\WObj:=ws{2};\n"), [(6, "unknown_frame")]),
    "a tool of a record": (module_of(J0 + "MoveJ {p1},v9,fine,hand.t;\n"), [(6, "unknown_tool")]),
    "a work object after a comma": (module_of(J0 + "MoveL {p1},v9,fine,t,\\WObj:=wobj0;\n"), []),
    "a displacement": (module_of(J0 + "PDispSet p;\n" + L1 + "PDispOff;\n" + L2), [(7, "displaced")]),
    "one from two points": (module_of(J0 + "PDispOn\\Rot,pA,t;\n" + L1), [(7, "displaced")]),
    "one in a branch": (module_of(J0 + "IF a THEN\nPDispSet p;\nENDIF\n" + L1), [(9, "displaced")]),
    "one that a routine sets": (
        module_of(J0 + "SetDown;\n" + L1, "PROC SetDown()\nPDispSet p;\nENDPROC\n"), [(7, "displaced")]
    ),
    "joint angles are not displaced": (module_of("PDispSet p;\n" + J0), []),
    "a part of a tool": (module_of(J0 + "t.tframe.trans.z:=100;\n" + L1), [(7, "unknown_tool")]),
    "a computed tool": (module_of(J0 + "t:=other(1);\n" + L1), [(7, "not_understood")]),
    "a part of a work object": (
        module_of(
            J0 + "w.oframe.trans:=x;\nMoveL {p1},v9,fine,t\\WObj:=w;\n",
            data='PERS wobjdata w:=[FALSE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];',
        ),
        [(7, "unknown_frame")],
    ),
    "a work object that moves": (
        module_of(
            J0 + "MoveL {p1},v9,fine,t\\WObj:=w;\n",
            data='PERS wobjdata w:=[FALSE,FALSE,"CNV1",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];',
        ),
        [(6, "unknown_frame")],
    ),
    "a tool on the ground": (
        module_of(
            J0 + "MoveL {p1},v9,fine,g;\n",
            data="PERS tooldata g:=[FALSE,[[5,0,90],[1,0,0,0]],[1,[0,0,50],[1,0,0,0],0,0,0]];",
        ),
        [(6, "unknown_tool")],
    ),
    "an own routine that begins as an instruction": (
        module_of("ConfL\\Off;\n" + J0 + "WaitHome;\n" + L1, "PROC WaitHome()\nMoveJ {p2},v9,fine,t;\nENDPROC\n"),
        [],
    ),
    "one that is not here": (module_of("ConfL\\Off;\n" + J0 + "WriteBack;\n" + L1), [(8, "not_understood")]),
    "a line without configuration": (module_of("ConfL\\Off;\n" + J0 + L0), []),
    "a trap": (
        module_of("CONNECT i WITH tr;\n" + J0 + L1, "TRAP tr\nPDispSet p;\nENDTRAP\n"), [(7, "displaced")]
    ),
    "a handler": (module_of(J0 + L1 + "ERROR\nPDispSet p;\nTRYNEXT;\n"), [(6, "displaced")]),
    "a handler that does nothing": (module_of(J0 + L1 + "ERROR\nTPWrite \"x\";\nRETRY;\n"), []),
    "points of an array that a module beside drives": (
        {
            **module_of(J0 + "go;\n", data="CONST robtarget ps{2}:=[{p1},\n{p2}];"),
            "b.mod": "MODULE b\nPROC go()\nMoveJ ps{1},v9,fine,t;\nENDPROC\nENDMODULE\n",
        },
        [],
    ),
    "a routine of a module beside": (
        {**module_of(J0 + "go;\n" + L1), "b.mod": "MODULE b\nPROC go()\nPDispOn\\Rot,p,t;\nENDPROC\nENDMODULE\n"},
        [(7, "displaced")],
    ),
    "a tool of a module beside": (
        {
            "a.mod": "MODULE a\nPROC main()\nMoveJ {p1},v9,fine,t;\nENDPROC\nENDMODULE\n",
            "b.sys": "MODULE b\n{t}\nENDMODULE\n",
        },
        [],
    ),
    "a point that a module beside writes": (
        {
            **module_of("MoveJ p,v9,fine,t;\n", data="PERS robtarget p:={p1};"),
            "b.mod": "MODULE b\nPROC go()\np.trans.z:=5;\nENDPROC\nENDMODULE\n",
        },
        [(3, "changed")],
    ),
    "a point handed to a routine": (
        module_of(
            "MoveJ p,v9,fine,t;\nchange p;\n", "PROC change(INOUT robtarget q)\nENDPROC\n", "PERS robtarget p:={p1};"
        ),
        [(3, "changed")],
    ),
    "numbers handed to a routine of a module beside": (
        {
            **module_of(J0 + "PathDown {p1};\nok:=at({p2}\\x);\n"),
            "b.mod": "MODULE b\nPROC PathDown(robtarget goal)\nMoveL goal,v9,fine,t;\nENDPROC\n"
            "FUNC bool at(robtarget goal\\num x)\nMoveL goal,v9,fine,t;\nENDFUNC\nENDMODULE\n",
        },
        [(6, "handed"), (7, "handed")],
    ),
    "numbers handed to functions that compute": (module_of(J0 + "n:=Distance([1,2,3],[4,5,6]);\n" + L1), []),
    "a tool that the next cycle keeps": (
        module_of(J0 + L1 + "t.tframe.trans.z:=t.tframe.trans.z+10;\n"), [(6, "unknown_tool")]
    ),
    "a work object that each cycle sets": (
        module_of(
            "w:=wobj0;\n" + J0 + "MoveJ {p1},v9,fine,t\\WObj:=w;\nw.oframe:=x;\n",
            data='PERS wobjdata w:=[FALSE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];',
        ),
        [],
    ),
    "a tool that another task sets": (
        {**module_of(J0 + L1), "b.mod": "MODULE b\nPERS tooldata t;\nPROC main()\nt.tframe:=x;\nENDPROC\nENDMODULE\n"},
        [(6, "unknown_tool")],
    ),
    "a task that sets others": (
        {**module_of(J0 + L1), "b.mod": "MODULE b\nPROC main()\nPDispSet p;\nother;\nENDPROC\nENDMODULE\n"}, []
    ),
    "a displacement that the next cycle has": (module_of(J0 + L1 + "PDispSet p;\n"), [(6, "displaced")]),
    "one that the program ends in": (
        module_of(J0 + L1 + "IF a THEN\nPDispSet p;\nExitCycle;\nENDIF\n"), [(6, "displaced")]
    ),
    "one that is off at the end": (module_of(J0 + L1 + "PDispSet p;\nMoveAbsJ {q1},v9,fine,t;\nPDispOff;\n"), []),
    "a tool that a routine which nobody calls sets": (
        module_of(J0 + L1, "PROC ev_start()\nt.tframe.trans.z:=100;\nENDPROC\n"), [(6, "unknown_tool")]
    ),
    "a tool that a routine of a module beside sets, which nobody calls": (
        {**module_of(J0 + L1), "b.mod": "MODULE b\nPROC calib()\nt.tframe:=x;\nENDPROC\nENDMODULE\n"},
        [(6, "unknown_tool")],
    ),
    "a part of a tool that is counted up": (module_of(J0 + "Incr t.tframe.trans.z;\n" + L1), [(7, "unknown_tool")]),
    "one that a function of the language writes": (
        module_of(J0 + 'ok:=StrToVal("1",t.tframe.trans.z);\n' + L1), [(7, "unknown_tool")]
    ),
    "a procedure named in a string": (
        module_of(J0 + 'MoveLSync {p1},v9,fine,t,"chg";\n' + L2, "PROC chg()\nPDispSet p;\nENDPROC\n"),
        [(6, "not_understood"), (7, "not_understood")],
    ),
    "a point with an offset that is computed": (
        module_of("MoveJ p,v9,fine,t;\nMoveL Offs(p,0,0,h),v9,fine,t;\n", data="CONST robtarget p:={p1};"),
        [(6, "offset")],
    ),
    "a point with an offset of 1 mm": (
        module_of(
            "MoveJ p,v9,fine,t;\nMoveL Offs(p,0,0,1),v9,fine,t;\nMoveL RelTool(p,1,0,0),v9,fine,t;\n",
            data="CONST robtarget p:={p1};",
        ),
        [],
    ),
    "a call that a condition may skip": (
        module_of(J0 + "IF a=1 OR chg() Stop;\n" + L1, "FUNC bool chg()\nPDispSet p;\nENDFUNC\n"), [(7, "displaced")]
    ),
    "one that switches off on one way": (
        module_of(J0 + "PDispSet p;\nb:=a=1 AND chg();\n" + L1, "FUNC bool chg()\nPDispOff;\nENDFUNC\n"),
        [(8, "displaced")],
    ),
    "a function in a move": (
        module_of(J0 + "MoveL {p1},fast(),fine,t;\n" + L2, "FUNC speeddata fast()\nRETURN v9;\nENDFUNC\n"), []
    ),
    "routines of two modules that hide an instruction": (
        {
            **module_of(J0 + "SetDO d,1;\n" + L1),
            "b.mod": "MODULE b\nPROC SetDO(signaldo d,num n)\nENDPROC\nENDMODULE\n",
            "c.mod": "MODULE c\nPROC SetDO(signaldo d,num n)\nPDispSet p;\nENDPROC\nENDMODULE\n",
        },
        [(7, "not_understood")],
    ),
    "a tool that a module beside has for itself": (
        {**module_of("MoveJ p,v9,fine,t;\ngo;\n", data="CONST robtarget p:={p1};"), "b.mod": "MODULE b\nLOCAL " + HAND
         + "PROC go()\nMoveJ p,v9,fine,t;\nENDPROC\nENDMODULE\n"},
        [(3, "unknown_tool")],
    ),
    "a tool with other numbers in a module beside": (
        {**module_of(J0 + L1), "b.sys": "MODULE b\n" + HAND + "ENDMODULE\n"}, [(6, "unknown_tool")]
    ),
    "one with the same numbers": ({**module_of(J0 + L1), "b.sys": "MODULE b\n{t}\nENDMODULE\n"}, []),
    "the module of the system": (
        {
            **module_of(J0 + "MoveL {p1},v9,fine,t\\WObj:=wobj0;\n"),
            "base.sys": "MODULE BASE(SYSMODULE)\nPERS tooldata tool0:=[TRUE,[[0,0,0],[1,0,0,0]],"
            "[0.001,[0,0,0.001],[1,0,0,0],0,0,0]];\n"
            'PERS wobjdata wobj0:=[FALSE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\nENDMODULE\n',
        },
        [],
    ),
    "a correction by a sensor": (module_of(J0 + "MoveL {p1},v9,fine,t\\Corr;\n"), [(6, "tracked")]),
    "a variable assigned with numbers once": (
        module_of(J0 + "q:={p1};\nMoveL q,v9,fine,t;\n" + L2, data="VAR robtarget q;"), []
    ),
    "a variable assigned with numbers twice": (
        module_of(J0 + "q:={p1};\nMoveL q,v9,fine,t;\nq:={p2};\nMoveL q,v9,fine,t;\n", data="VAR robtarget q;"),
        [(6, "changed"), (8, "changed")],
    ),
    "a variable assigned with numbers, then shifted": (
        module_of(J0 + "q:={p1};\nMoveL q,v9,fine,t;\nq.trans.z:=q.trans.z+1;\n", data="VAR robtarget q;"),
        [(6, "changed")],
    ),
    "axis 4 locked": (module_of(J0 + "SingArea\\LockAxis4;\n" + L1), [(7, "switched")]),
}  # fmt: skip


@pytest.mark.parametrize("row", ABB_ROWS)
def test_abb(row: str, tmp_path: Path) -> None:
    files, left = ABB_ROWS[row]
    rig, files = abb_files(files)
    assert uncorrected(corrected_files(rig, tmp_path, files)) == left


def fanuc_files(files: dict[str, str]) -> tuple[Rig, dict[str, str]]:
    """Listings with the points P[1] in joint angles, and P[2] and P[3] in frame 3, P[4] in frame 0, all in tool 1."""
    rig = rig_of("fanuc-m-10ia")
    frame = fanuc_pose(rig, FANUC[1], np.eye(4))
    points = [
        fanuc_point(1, fanuc_joints(FANUC[0]), "UF : 0, UT : 1,\t"),
        fanuc_point(2, frame, "UF : 3, UT : 1,"),
        fanuc_point(3, fanuc_pose(rig, (18, 14, -26, 5, -60, 35), np.eye(4)), "UF : 3, UT : 1,"),
        fanuc_point(4, frame, "UF : 0, UT : 1,"),
    ]
    first = next(iter(files))
    end = "/POS\n" + "\n".join(points).replace("\r", "") + "\n/END\n"
    return rig, {name: text + (end if name == first else "/POS\n/END\n") for name, text in files.items()}


def listing(*lines: str, head: str = "", name: str = "A") -> str:
    return f"/PROG  {name}\n{head}/MN\n" + "".join(f"{k:4d}:{line} ;\n" for k, line in enumerate(lines, start=1))


def selecting(*lines: str, head: str = "") -> str:
    """A listing that selects the frame and the tool of each position before the move to it."""
    frames = {"P[2]": "3", "P[3]": "3", "P[4]": "0"}
    with_them: list[str] = []
    for line in lines:
        if (point := re.match(r"L (P\[\d\])", line)) and point[1] in frames:
            with_them += [f"UFRAME_NUM={frames[point[1]]}", "UTOOL_NUM=1"]
        with_them.append(line)
    return listing(*with_them, head=head)


J1, L2_, L3_, L4_ = (
    "J P[1] 100% FINE",
    "L P[2] 200mm/sec FINE",
    "L P[3] R[2]mm/sec CNT50 ACC80",
    "L P[4] 200mm/sec FINE",
)
ZERO = [f"PR[5,{axis}]=0" for axis in range(1, 7)]
FANUC_ROWS: dict[str, tuple[dict[str, str], list[tuple[str, str]]]] = {
    "plain": ({"a.ls": listing("UFRAME_NUM=3", "UTOOL_NUM=1", J1, L2_, L3_)}, []),
    "a usual program": (
        {
            "a.ls": listing(
                "  !header", "UFRAME_NUM=3", "UTOOL_NUM=1", "PAYLOAD[1]", "OVERRIDE=50%", "R[1]=0", "LBL[1:top]", J1,
                "DO[1]=ON", "WAIT DI[1]=ON", "WAIT   .50(sec)", "IF DI[2]=ON,JMP LBL[2]", "CALL GRIP(1)", L2_,
                "FOR R[3]=1 TO 3", "R[1]=R[1]+1", L3_, "ENDFOR", "LBL[2]", "IF (R[1]=1) THEN", "UALM[1]", "ELSE",
                "F[1]=(ON)", "ENDIF", "SELECT R[1]=1,JMP LBL[1]", "       =2,CALL GRIP(2)", "       ELSE,JMP LBL[3]",
                "LBL[3]", "WAIT DI[1]=OFF TIMEOUT,LBL[1]", "MESSAGE[x]", "TIMER[1]=STOP", "JMP LBL[1]", "END",
            ),
            "grip.ls": listing("RO[1]=ON", "$WAITTMOUT=100", "WAIT RI[1]=ON", name="GRIP"),
        },
        [],
    ),
    "a frame from a register": ({"a.ls": selecting(J1, "UFRAME[3]=PR[5]", L2_, L4_)}, [("P[2]", "unknown_frame")]),
    "a frame that the next cycle keeps": (
        {"a.ls": selecting(J1, L2_, L4_, "UFRAME[3]=PR[5]")}, [("P[2]", "unknown_frame")]
    ),
    "one whose numbers are known": ({"a.ls": selecting(*ZERO, "UFRAME[3]=PR[5]", J1, L2_)}, []),
    "one of which some are": ({"a.ls": selecting(*ZERO[:5], "UFRAME[3]=PR[5]", J1, L2_)}, [("P[2]", "unknown_frame")]),
    "one of which one is written by a number in a register": (
        {"a.ls": selecting(*ZERO, "PR[R[1],3]=20", "UFRAME[3]=PR[5]", J1, L2_)}, [("P[2]", "unknown_frame")]
    ),
    "one of which any may be written": (
        {"a.ls": selecting(*ZERO, "PR[5,R[1]]=20", "UFRAME[3]=PR[5]", J1, L2_)}, [("P[2]", "unknown_frame")]
    ),
    "one that a program writes by its argument": (
        {
            "a.ls": selecting(*ZERO, "CALL B(5)", "UFRAME[3]=PR[5]", J1, L2_),
            "b.ls": listing("PR[AR[1]]=LPOS", name="B"),
        },
        [("P[2]", "unknown_frame")],
    ),
    "one that a way which is left writes": (
        {
            "a.ls": selecting(
                *ZERO, L4_ + " Skip,LBL[1],PR[R[2]]=LPOS", "LBL[1]", "UFRAME[3]=PR[5]", L2_
            )
        },
        [("P[2]", "unknown_frame")],
    ),
    "one with remarks": (
        {"a.ls": selecting(*ZERO[2:], "PR[5:base,1]=(0)", "PR[5,2:base]=0", "UFRAME[3:f]=PR[5:base]", J1, L2_)}, []
    ),
    "one by a number in a register": (
        {"a.ls": selecting(J1, "UFRAME[R[1]]=PR[5]", L2_, L4_)}, [("P[2]", "unknown_frame")]
    ),
    "a tool from a register": (
        {"a.ls": selecting(J1, "UTOOL[1]=PR[6]", L2_, L4_)}, [("P[2]", "unknown_tool"), ("P[4]", "unknown_tool")]
    ),
    "a frame in a branch": (
        {"a.ls": selecting("IF R[1]=1,UFRAME[3]=PR[5]", J1, L2_)}, [("P[2]", "unknown_frame")]
    ),
    "a frame after a jump of a camera": (
        {"a.ls": selecting("VISION GET_OFFSET 'V' VR[1] JMP LBL[1]", "UFRAME[3]=PR[5]", "LBL[1]", L2_)},
        [("P[2]", "unknown_frame")],
    ),
    "a frame after a jump": (
        {"a.ls": selecting("LBL[1]", L2_, "UFRAME[3]=PR[5]", "JMP LBL[1]")}, [("P[2]", "unknown_frame")]
    ),
    "a system variable": ({"a.ls": selecting("$MNUFRAME[1,3]=PR[5]", J1, L2_)}, [("P[2]", "unknown_tool")]),
    "a program that sets a frame": (
        {"a.ls": selecting("CALL B", J1, L2_), "b.ls": listing("UFRAME[3]=PR[5]", name="B")},
        [("P[2]", "unknown_frame")],
    ),
    "a program that is not here": (
        {"a.ls": selecting("CALL B", J1, L2_)}, [("P[2]", "not_understood")]
    ),
    "a macro": ({"a.ls": selecting("Hand open", L2_)}, [("P[2]", "not_understood")]),
    "one that runs beside": (
        {"a.ls": selecting("RUN B", L2_), "b.ls": listing("UFRAME[3]=PR[5]", name="B")}, [("P[2]", "unknown_frame")]
    ),
    "joint angles with an unknown program beside": (
        {"a.ls": selecting("RUN BGTASK", J1, L4_)}, [("P[4]", "not_understood")]
    ),
    "a conveyor": (
        {"a.ls": selecting(J1, L2_, head="/APPL\n  LINE_TRACK;\n  LINE_TRACK_SCHEDULE_NUM : 1;\n")},
        [("P[1]", "tracked"), ("P[2]", "tracked")],
    ),
    "an offset": (
        {"a.ls": selecting(L2_, L3_ + " Offset,PR[3]", L4_ + " Tool_Offset,PR[4]")},
        [("P[3]", "offset"), ("P[4]", "offset")],
    ),
    "an offset of nothing": ({"a.ls": selecting(*ZERO, L2_ + " Offset,PR[5]", L2_)}, []),
    "an offset that is far": (
        {"a.ls": selecting(*ZERO, "PR[5,3]=300", L2_ + " Offset,PR[5]", L2_)}, []
    ),
    "an offset beside one that is known": (
        {"a.ls": selecting(*ZERO, L2_ + " Offset,PR[5] Tool_Offset,PR[6]", L2_)}, [("P[2]", "offset")]
    ),
    "an external tool": ({"a.ls": selecting(L2_ + " RTCP", L4_)}, [("P[2]", "external_tcp")]),
    "a different robot": ({"a.ls": selecting(L2_ + " COORD", L4_)}, [("P[2]", "coordinated")]),
    "an option that is unknown": ({"a.ls": selecting(L2_ + " Magic", L4_)}, [("P[2]", "not_understood")]),
    "a point that is written": ({"a.ls": selecting("P[2,3]=100", L2_, L4_)}, [("P[2]", "changed")]),
    "a point that a register names": (
        {"a.ls": selecting("P[R[1]]=LPOS", L2_, L4_)}, [(f"P[{k}]", "changed") for k in (1, 2, 3, 4)]
    ),
    "a point that a register names for a move": (
        {"a.ls": selecting(L2_, "UFRAME_NUM=0", "L P[R[1]] 200mm/sec FINE")},
        [("P[R[1]]", "computed"), *((f"P[{k}]", "selected") for k in (2, 3))],
    ),
    "one in the frame of all that it can name": (
        {"a.ls": selecting(L2_, L3_, "L P[R[1]] 200mm/sec FINE")},
        [("P[R[1]]", "computed"), ("P[4]", "selected")],
    ),
    "a call along the way": (
        {"a.ls": selecting(L2_ + " TB .10sec,CALL B", L3_), "b.ls": listing("UFRAME[3]=PR[5]", name="B")},
        [("P[2]", "unknown_frame"), ("P[3]", "unknown_frame")],
    ),
    "an output along the way": ({"a.ls": selecting(L2_ + " TA .10sec,DO[1]=ON", L3_)}, []),
    "no frame selected": ({"a.ls": listing("UTOOL_NUM=1", J1, L2_)}, [("P[2]", "selected")]),
    "no tool selected": ({"a.ls": listing("UFRAME_NUM=3", J1, L2_)}, [("P[2]", "selected")]),
    "a different frame selected": (
        {"a.ls": listing("UFRAME_NUM=3", "UTOOL_NUM=1", J1, L2_, L4_)}, [("P[4]", "selected")]
    ),
    "a frame selected by a register": (
        {"a.ls": listing("UFRAME_NUM=R[1]", "UTOOL_NUM=1", J1, L2_)}, [("P[2]", "selected")]
    ),
    "a frame selected on one way": (
        {"a.ls": listing("UFRAME_NUM=3", "UTOOL_NUM=1", "IF R[1]=1,UFRAME_NUM=4", J1, L2_)}, [("P[2]", "selected")]
    ),
    "a frame selected by a program": (
        {"a.ls": listing("CALL B", J1, L2_), "b.ls": listing("UFRAME_NUM=3", "UTOOL_NUM[GP1]=1", name="B")}, []
    ),
    "another group's frame selected": (
        {"a.ls": listing("UFRAME_NUM=3", "UTOOL_NUM=1", "UFRAME_NUM[GP2]=4", J1, L2_)}, []
    ),
    "a frame selected by a system variable": (
        {"a.ls": listing("UFRAME_NUM=3", "UTOOL_NUM=1", "$MNUFRAMENUM[1]=4", J1, L2_)}, [("P[2]", "selected")]
    ),
    "a frame that a program that nobody calls sets": (
        {"a.ls": selecting(J1, L2_), "b.ls": listing("UFRAME[3]=PR[5]", name="B")}, [("P[2]", "unknown_frame")]
    ),
    "a frame by a register that the next cycle keeps": (
        {"a.ls": selecting(J1, L2_, "UFRAME[R[1]]=PR[5]")}, [("P[2]", "unknown_frame")]
    ),
    "a way that is left": ({"a.ls": selecting(L2_ + " Skip,LBL[1]", "LBL[1]", L3_)}, []),
}  # fmt: skip


@pytest.mark.parametrize("row", FANUC_ROWS)
def test_fanuc(row: str, tmp_path: Path) -> None:
    files, left = FANUC_ROWS[row]
    rig, files = fanuc_files(files)
    found = corrected_files(rig, tmp_path, files, ["1=10,-20,180,0,30,10"], ["3=0"])
    assert [(one.name, one.reason) for one in found.left if one.reason != "unused"] == left
    assert len({*found.names, *(one.name for one in found.left if one.reason != "computed")}) == 4


@pytest.mark.parametrize(("called", "file", "line"), [("A", 0, 3), ("B", 1, 4)], ids=("itself", "another"))
def test_the_reason_of_a_recursive_program_is_the_line_of_the_call(
    called: str, file: int, line: int, tmp_path: Path
) -> None:
    call = f"CALL {called}"
    rig, files = fanuc_files({"a.ls": selecting(call, L2_), "b.ls": listing("R[1]=R[1]+1", call, name="B")})
    found = corrected_files(rig, tmp_path, files, ["1=10,-20,180,0,30,10"], ["3=0"])
    (left,) = (one for one in found.left if one.name == "P[2]")
    assert left.reason == "not_understood" and (left.because[0].file, left.because[0].line) == (file, line)


def yaskawa_files(files: dict[str, str]) -> tuple[Rig, dict[str, str]]:
    """Jobs; {pos} are the positions C1 and C2 in user frame 4, and C3 in the base, all in tool 3."""
    rig = rig_of("yaskawa-gp7")
    flags = configuration_of(arm_of(rig.robot), np.radians(YASKAWA[0]))
    form = f"{','.join(str(int(not flag)) for flag in flags)},0,0,0"
    poses = [yaskawa_pose(rig, YASKAWA[k]) for k in (1, 2)]
    pos = (
        f"//POS\n///NPOS 3,0,0,0,0,0\n///TOOL 3\n///POSTYPE USER\n///USER 4\n///RECTAN\n///RCONF {form}\n"
        f"C00001={poses[0]}\nC00002={poses[1]}\n///POSTYPE BASE\n///RECTAN\n///RCONF {form}\nC00003={poses[0]}\n"
        "//INST\n///DATE 2026/01/21 16:46\n///ATTR SC,RW\n///GROUP1 RB1\nNOP\n"
    )
    return rig, {name: text.replace("{pos}", pos) for name, text in files.items()}


def job_of(*lines: str, name: str = "A", pos: str = "{pos}") -> str:
    return f"/JOB\n//NAME {name}\n{pos}" + "\n".join(lines) + "\nEND\n"


BARE = "//POS\n///NPOS 0,0,0,0,0,0\n//INST\nNOP\n"
M1, M2, M3 = "MOVJ C00001 VJ=10.00 PL=0", "MOVL C00002 V=100.0 CR=5.0", "MOVL C00003 V=100.0"
YASKAWA_ROWS: dict[str, tuple[dict[str, str], list[tuple[int, str]]]] = {
    "plain": ({"a.jbi": job_of(M1, M2, M3)}, []),
    "a usual program": (
        {
            "a.jbi": job_of(
                "'comment", "SPEED VJ=50.00 V=200.0", "SET B000 0", "*TOP", M1, "DOUT OT#(1) ON", "TIMER T=0.50",
                "WAIT IN#(1)=ON T=3.00", "CALL JOB:GRIP", "IFTHENEXP B000=1", M2, "ELSE", "INC B000", "ENDIF",
                "CALL JOB:GRIP IF B000=2", "JUMP *TOP IF IN#(2)=ON", "PULSE OT#(2) T=0.30", "RET IF B000=3", M3,
                "WHILE B000<4", "ADD B000 1", "ENDWHILE", "MSG \"x\"",
            ),
            "grip.jbi": job_of("DOUT OT#(3) ON", "WAIT IN#(3)=ON", "RET", name="GRIP", pos=BARE),
        },
        [],
    ),
    "a shift": ({"a.jbi": job_of(M1, "SFTON P001", M2, "SFTOF", M3)}, [(11, "displaced")]),
    "a shift in a job that is called": (
        {"a.jbi": job_of(M1, "CALL JOB:B", M2, "SFTOF"), "b.jbi": job_of("SFTON P001", name="B", pos=BARE)},
        [(11, "displaced")],
    ),
    "a shift on one way": (
        {"a.jbi": job_of(M1, "JUMP *ON IF IN#(1)=ON", "SFTON P001", "*ON", M2, "SFTOF")}, [(11, "displaced")]
    ),
    "a shift that the next cycle has": ({"a.jbi": job_of(M1, "SFTON P001")}, [(10, "displaced")]),
    "a job that is not here": (
        {"a.jbi": job_of(M1, "CALL JOB:B", M2)}, [(10, "not_understood"), (11, "not_understood")]
    ),
    "a relative job": (
        {"a.jbi": job_of(M1, "CALL JOB:B UF#(5)") + job_of(M1, M3, name="B")},
        [(33, "unknown_frame"), (38, "unknown_frame")],
    ),
    "a relative job that a job of a different frame calls": (
        {
            "a.jbi": job_of(M1, M3), "b.jbi": job_of("CALL JOB:C UF#(5) IF IN#(1)=ON", name="B", pos=BARE),
            "c.jbi": job_of("CALL JOB:A", name="C", pos=BARE),
        },
        [(10, "unknown_frame"), (15, "unknown_frame")],
    ),
    "one with positions of a different frame": (
        {"a.jbi": job_of("///ATTR SC,RW,RJ", "////FRAME USER 4", M1, M3)}, [(15, "unknown_frame")]
    ),
    "a shift in one of the cases": (
        {"a.jbi": job_of(M1, "SWITCH B000 CASE 1", "SFTON P001", "CASE 2", "SFTOF", "ENDSWITCH", M2, "SFTOF")},
        [(11, "displaced")],
    ),
    "the file of a frame": ({"a.jbi": job_of("SETFILE UF#(4)(2) D000", M1, M3)}, [(10, "unknown_frame")]),
    "that of weaving": ({"a.jbi": job_of("SETFILE WEV#(4)(2) D000", "CWAIT", M1, M3)}, []),
    "a frame that is made": ({"a.jbi": job_of("MFRAME UF#(4) P001 P002 P003", M1, M3)}, [(10, "unknown_frame")]),
    "a tool that is set": (
        {"a.jbi": job_of("SETTOOL TL#(3) P001", M1, M3)}, [(10, "unknown_tool"), (15, "unknown_tool")]
    ),
    "a conveyor": ({"a.jbi": job_of(M1, "SYSTART CV#(1)", M2, "SYEND CV#(1)", M3)}, [(11, "tracked")]),
    "a different robot": ({"a.jbi": job_of(M1, "SMOVL C00002 V=100.0")}, [(11, "coordinated")]),
    "an option that is unknown": ({"a.jbi": job_of(M1, M2 + " MAGIC")}, [(11, "not_understood")]),
    "an instruction that is unknown": (
        {"a.jbi": job_of(M1, "MAGIC", M2)}, [(10, "not_understood"), (11, "not_understood")]
    ),
    "a frame that the next cycle keeps": (
        {"a.jbi": job_of(M1, M3, "MFRAME UF#(4) P001 P002 P003")}, [(10, "unknown_frame")]
    ),
    "a position that is used otherwise": ({"a.jbi": job_of(M1, "GETE D000 C00001 (1)", M2)}, [(10, "changed")]),
    "a job beside": (
        {"a.jbi": job_of("PSTART JOB:B", M1), "b.jbi": job_of("MFRAME UF#(4) P001 P002 P003", name="B", pos=BARE)},
        [(10, "unknown_frame")],
    ),
    "two jobs in a file": (
        {"a.jbi": job_of(M1, "CALL JOB:B", M2, "SFTOF") + job_of(M1, "SFTON P001", M2, name="B")},
        [(11, "displaced"), (36, "displaced")],
    ),
}  # fmt: skip


@pytest.mark.parametrize("ends", ["\n", "\r"])
@pytest.mark.parametrize("row", YASKAWA_ROWS)
def test_yaskawa(row: str, ends: str, tmp_path: Path) -> None:
    files, left = YASKAWA_ROWS[row]
    rig, files = yaskawa_files(files)
    found = corrected_files(rig, tmp_path, files, ["3=0,0,150,0,0,0"], ["4=0"], ends=ends)
    assert uncorrected(found) == left
    assert len(found.names) == 3 * files["a.jbi"].count("///NPOS") - len(found.left)


def test_a_point_that_is_used_with_an_offset_alone_is_corrected_with_it(tmp_path: Path) -> None:
    module = "MODULE M\nCONST robtarget p10:={p1};\n{t}\nPROC main()\nMoveJ Offs(p10,0,0,50),v9,fine,t;\nENDPROC\n"
    rig, files = abb_files({"b.mod": f"{module}ENDMODULE\n"})
    found = corrected_files(rig, tmp_path, files)
    assert found.names == ("p10",) and not found.left and found.moved_mm[0] > 0.1
