"""RAPID programs as they are in cells: external axes that do not move, postures without configuration, variants of a
program in one directory, instructions of options, and patterns.

Rows are a program, and the lines that stay uncorrected with the reason. Everything else is corrected.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.correct.corrected_program import correct_program, frames_of
from analysis.apps.makers.abb.instructions import EFFECTS, FUNCTIONS, MOVE, SWITCHES
from analysis.correction.support import supports
from rigs.schema.robot import Rail
from tests.analysis.apps.correct.programs.test_safe_modules_and_jobs import HAND, J0, L1, L2, abb_files, module_of
from tests.analysis.apps.correct.programs.test_safe_programs import Left, corrected_files, uncorrected
from tests.analysis.apps.correct.programs.test_user_programs import ABB, ABB_TOOL, quaternion, robtarget_of
from tests.worlds.arms.faulty_arm import flange_at, hidden, joints_of, known
from tests.worlds.interpreters.arms import rig_of

JOINTS = J0.replace("{q0}", "{q0-a}")
P1, P2 = (f"MoveL {{p{k}-a}},v9,fine,t;\n" for k in (1, 2))


def _with_axis(files: dict[str, str], *values: str) -> dict[str, str]:
    """Fill the external axis of the targets {pN-a} and {qN-a}, in order."""
    _, filled = abb_files({name: re.sub(r"-a\}", "}@", text) for name, text in files.items()})
    texts, value = {}, iter(values)
    for name, text in filled.items():
        parts = text.split("@")
        for k, part in enumerate(parts[:-1]):
            head, _, tail = part.rpartition("[9E")
            parts[k] = f"{head}[{next(value)},9E{tail.partition(',9E')[2]}"
        texts[name] = "".join(parts)
    return texts


EXTERNAL: dict[str, tuple[dict[str, str], tuple[str, ...], Left]] = {
    "zero everywhere": (module_of(JOINTS + P1 + P2), ("0", "0", "0"), []),
    "zero, and not named elsewhere": (module_of(JOINTS + P1 + L2), ("0", "0.0"), []),
    "constant everywhere": (module_of(JOINTS + P1 + P2), ("250", "250", "250.0"), []),
    "constant, but not named elsewhere": (
        module_of(JOINTS + P1 + L2), ("250", "250"), [(6, "external_axes"), (7, "external_axes")]
    ),
    "two places": (module_of(JOINTS + P1 + P2), ("0", "0", "300"), [(7, "external_axes")]),
    "a joint target elsewhere": (module_of(JOINTS + P1 + P2), ("300", "0", "0"), []),
    "an offset without external axes": (module_of(J0 + "EOffsSet [100,0,0,0,0,0];\n" + L1), (), []),
    "an offset of an axis that targets name": (
        module_of(JOINTS + "EOffsSet [100,0,0,0,0,0];\n" + P1), ("0", "0"), [(7, "external_axes")]
    ),
    "offsets on and off without external axes": (module_of(J0 + "EOffsOn p;\n" + L1 + "EOffsOff;\n" + L2), (), []),
    "a unit that is activated": (module_of(J0 + "ActUnit STN1;\n" + L1 + "DeactUnit STN1;\n" + L2), (), []),
    "an axis that an instruction moves": (module_of(J0 + "MoveExtJ j,v9,fine;\n" + L1), (), [(7, "external_axes")]),
    "an independent axis": (module_of(J0 + "IndRMove STN1,1\\ToAbsNum:=90,20;\n" + L1), (), [(7, "external_axes")]),
    "a coordinate that is assigned": (module_of(J0 + "p.extax.eax_a:=5;\n" + L1), (), [(7, "external_axes")]),
    "a variant of the program elsewhere": (
        {**module_of(JOINTS + P1), "b.mod": "MODULE b\nPROC main()\nMoveL {p2-a},v9,fine,t;\nENDPROC\nENDMODULE\n"},
        ("0", "0", "400"),
        [],
    ),
    "a routine of the program elsewhere": (
        {
            **module_of(JOINTS + P1 + "go;\n"),
            "b.mod": "MODULE b\nPROC go()\nMoveL {p2-a},v9,fine,t;\nENDPROC\nENDMODULE\n",
        },
        ("0", "0", "400"),
        [],
    ),
}  # fmt: skip


@pytest.mark.parametrize("row", EXTERNAL)
def test_external_axis_counts_only_if_it_moves(row: str, tmp_path: Path) -> None:
    files, values, left = EXTERNAL[row]
    found = corrected_files(rig_of("abb-irb-120"), tmp_path, _with_axis(files, *values))
    assert uncorrected(found) == left
    assert bool(found.notices) == (row == "constant everywhere")


@pytest.mark.parametrize(("value", "left"), [("9E9", []), ("0", []), ("120", ["external_axes"])])
def test_rail_of_the_rig_file_must_be_at_zero(value: str, left: list[str], tmp_path: Path) -> None:
    rig = rig_of("abb-irb-120")
    rail = Rail(direction=(0, 1, 0), limits_mm=(-500, 500))
    railed = rig.model_copy(update={"robot": rig.robot.model_copy(update={"rail": rail})})
    files = _with_axis(module_of("MoveJ {p1-a},v9,fine,t;\n"), value)
    assert [one.reason for one in corrected_files(railed, tmp_path, files).left] == left


OFF = "ConfJ\\Off;\nConfL\\Off;\n"
J1, J2 = (f"MoveJ {{p{k}}},v9,fine,t;\n" for k in (1, 2))
STARTS: dict[str, tuple[dict[str, str], tuple[float, ...] | None, Left]] = {
    "a line": (module_of(OFF + L1), ABB[1], []),
    "a joint move": (module_of(OFF + J1), (40, 5, 30, -20, 60, 70), []),
    "lines and joint moves": (module_of(OFF + L1 + J2 + L1), (20, 10, 20, -20, 60, 60), []),
    "in a routine": (module_of(OFF + "go;\n" + L2, "PROC go()\n" + J1 + "ENDPROC\n"), (10, 25, 5, -50, 40, 130), []),
    "without main": ({"a.mod": "MODULE a\n{t}\n\nPROC path()\n" + OFF + L1 + "ENDPROC\nENDMODULE\n"}, ABB[1], []),
    "two routines that may be first": (
        {
            "a.mod": f"MODULE a\n{{t}}\nPROC one()\n{OFF}{L1}ENDPROC\nPROC two()\nConfL\\Off;\n{L2}ENDPROC\nENDMODULE\n"
        },
        ABB[1],
        [(6, "no_posture"), (10, "no_posture")],
    ),
    "no start": (module_of(OFF + L1), None, [(7, "no_posture")]),
    "a start between two postures": (module_of(OFF + J1), (25, 15, 15, 60, 0, 10), [(7, "ambiguous")]),
    "a cycle that ends elsewhere": (
        module_of(OFF + L1 + "MoveAbsJ [[25,15,15,150,-50,-80],[9E9,9E9,9E9,9E9,9E9,9E9]],v9,fine,t;\n"),
        ABB[1],
        [(7, "two_postures")],
    ),
    "a configuration that counts": (module_of(J1), None, []),
}  # fmt: skip


@pytest.mark.parametrize("row", STARTS)
def test_posture_without_configuration_follows_from_the_start(row: str, tmp_path: Path) -> None:
    files, start, left = STARTS[row]
    rig, filled = abb_files(files)
    radians = tuple(np.radians(start).tolist()) if start else None
    found = corrected_files(rig, tmp_path, filled, start=radians)
    assert uncorrected(found) == left
    needed = row not in ("two routines that may be first", "no start", "a configuration that counts")
    assert (found.start is not None) == needed


def test_line_that_turns_the_tool_half_around_is_left(tmp_path: Path) -> None:
    """The direction of the rotation, and thus a turn of axis 6, may depend on the smallest change."""
    rig = rig_of("abb-irb-120")
    begin, end = (20, 10, 20, 30, 60, -90.0), (20, 10, 20, 30, 60, 89.5)
    pose, joints = robtarget_of(rig, end, np.eye(4)), ",".join(map(str, begin))
    move = f"MoveAbsJ [[{joints}],[9E9,9E9,9E9,9E9,9E9,9E9]],v9,fine,tool0;\nMoveL {pose},v9,fine,t;\n"
    _, files = abb_files(module_of("ConfL\\Off;\n" + move))
    assert uncorrected(corrected_files(rig, tmp_path, files)) == [(7, "ambiguous")]


def _tool(numbers: str, kind: str = "PERS") -> str:
    return f"{kind} tooldata h:=[TRUE,[[{numbers}],[{quaternion(ABB_TOOL)}]],[1,[0,0,50],[1,0,0,0],0,0,0]];\n"


VARIANT = "MODULE b\n{tool}PROC main()\nMoveJ p,v9,fine,h;\nENDPROC\nENDMODULE\n"
MOVE_H = "MoveJ {p1},v9,fine,h;\n"
TOOLS: dict[str, tuple[dict[str, str], bool, list[str]]] = {
    "other numbers in a variant": ({"b.mod": VARIANT.format(tool=_tool("0,0,120"))}, True, ["unknown_tool"]),
    "constants in a variant": ({"b.mod": VARIANT.format(tool=_tool("0,0,120", "CONST"))}, True, ["unknown_tool"]),
    "variables in a variant": ({"b.mod": VARIANT.format(tool=_tool("1,0,90", "VAR"))}, True, ["unknown_tool"]),
    "task data in a variant": ({"b.mod": VARIANT.format(tool=_tool("0,2,90", "TASK PERS"))}, True, ["unknown_tool"]),
    "two variants": (
        {"b.mod": VARIANT.format(tool=_tool("0,0,120")), "c.mod": VARIANT.format(tool=_tool("0,0,150"))},
        True,
        ["unknown_tool"],
    ),
    "a system module": ({"b.sys": "MODULE b(SYSMODULE)\n" + _tool("9,0,90") + "ENDMODULE\n"}, True, ["unknown_tool"]),
    "equal numbers": ({"b.mod": VARIANT.format(tool=_tool("5,0,90"))}, False, []),
}


@pytest.mark.parametrize("row", TOOLS)
def test_stated_tool_counts_if_variants_declare_it_with_other_numbers(row: str, tmp_path: Path) -> None:
    others, noticed, left = TOOLS[row]
    rig, files = abb_files({**module_of(MOVE_H, data=_tool("5,0,90")), **others})
    without = corrected_files(rig, tmp_path, files)
    assert [one.reason for one in without.left] == left and bool(without.notices) == noticed
    stated = corrected_files(rig, tmp_path, files, ["h=5,0,90,0,45,0"])
    assert not stated.left and len(stated.names) == 1 and not stated.overruled


KNOWN = {
    "WaitWObj wCnv;": [], "WaitWObj wCnv\\RelDist:=100;": [], "DropWObj wCnv;": [], "CamGetResult cam,mytarget;": [],
    "CamReqImage cam;": [], "CamStartLoadJob cam,\"job\";": [], "SocketListen s;": [], "RMQSendMessage slot,data;": [],
    "SyncMoveOn s1,tasks;": [], "StorePath;": [], "CorrCon id;": [], "ArcRefresh;": [], "STClose gun,1000,5;": [],
    "SetBrush 3;": [], "TuneServo ROB_1,1,110;": [], "WaitAI ai1,\\GT,2;": [], "SetupCyclicBool b,a=1;": [],
}  # fmt: skip
UNKNOWN = (
    'Load\\Dynamic,"HOME:/p.mod";', 'StartLoad\\Dynamic,"HOME:/p.mod",l1;', "WaitLoad l1;", 'UnLoad "HOME:/p.mod";',
    'CallByVar "go",n;', '%"go"%;', '%"go"+ValToStr(n)%;', 'WriteCfgData "/MOC","x",v;', "own_routine;",
    "own_routine 3,TRUE;", 'SetDataVal "t",x;',
)  # fmt: skip


@pytest.mark.parametrize("instruction", KNOWN)
def test_instruction_of_an_option_leaves_fixed_tools_and_frames(instruction: str, tmp_path: Path) -> None:
    rig, files = abb_files(module_of(J0 + instruction + "\n" + L1))
    assert uncorrected(corrected_files(rig, tmp_path, files)) == []


@pytest.mark.parametrize("instruction", UNKNOWN)
def test_instruction_that_may_run_another_program_is_not_understood(instruction: str, tmp_path: Path) -> None:
    rig, files = abb_files(module_of(J0 + instruction + "\n" + L1))
    assert ("not_understood" in [why for _, why in uncorrected(corrected_files(rig, tmp_path, files))]) != (
        "SetDataVal" in instruction
    )
    assert not corrected_files(rig, tmp_path, files).names[1:]


@pytest.mark.parametrize(
    "move",
    [
        "ArcLStart {p1},v9,seam1,weld1,fine,t;", "ArcL {p1},v9,seam1,weld1\\Weave:=weave1,z10,t;",
        "ArcLEnd {p1},v9,seam1,weld1,fine,t;", "SpotL {p1},v9,gun1,spot1,t;", "PaintL {p1},v9,z10,t;",
        "DispL\\On,{p1},v9,bead1,z10,t;", "CapL {p1},v9,cdata1,z10,t;", "TriggL {p1},v9,trigg1,fine,t;",
        "TriggLIOs {p1},v9,\\TriggData1:=tr,fine,t;", "MoveLDO {p1},v9,fine,t,do1,1;",
        "SearchL\\Stop,di1,pf,{p1},v9,t;", "SearchL di1\\PosFlank,pf,{p1},v9,t;", "ContactL {p1},v9,t;",
        "ArcMoveJ {p1},v9,fine,t;",
    ],
)  # fmt: skip
def test_move_of_an_option_is_a_move(move: str, tmp_path: Path) -> None:
    rig, files = abb_files(module_of(J0 + move + "\n" + L2, data="VAR robtarget pf;"))
    found = corrected_files(rig, tmp_path, files)
    assert uncorrected(found) == [] and len(found.names) == 3


def test_search_ends_at_an_unknown_place(tmp_path: Path) -> None:
    rig, files = abb_files(module_of("ConfL\\Off;\n" + J0 + "SearchL\\Stop,di1,pf,{p1},v9,t;\n" + L2))
    assert uncorrected(corrected_files(rig, tmp_path, files)) == [(8, "no_posture")]


def test_path_corrected_by_a_sensor_is_left(tmp_path: Path) -> None:
    rig, files = abb_files(module_of(J0 + "EGMMoveL egm1,{p1},v9,fine,t;\nArcL {p2},v9,s,w,z10,t\\Corr;\n"))
    assert "tracked" in [why for _, why in uncorrected(corrected_files(rig, tmp_path, files))]


def test_every_name_has_a_single_effect() -> None:
    names = [name for effect in EFFECTS.values() for name in effect]
    assert len(names) == len(set(names)) and not set(names) & set(SWITCHES)
    assert not [name for name in names if MOVE.fullmatch(name)]
    assert not FUNCTIONS & {"load", "callbyvar"}


def test_literal_handed_to_an_unknown_routine_is_listed(tmp_path: Path) -> None:
    rig, files = abb_files(module_of(J0 + "own_routine {p1};\n"))
    assert uncorrected(corrected_files(rig, tmp_path, files)) == [(6, "handed")]


DATA = "CONST num dx:=20;\nCONST num up:=2*dx+10;\nVAR num h:=30;\nPERS num n:=3;\nVAR num w;\nCONST robtarget p:={p1};"
PATTERNS = {
    "a constant": ("MoveL Offs(p,0,0,dx),v9,fine,t;\n", True),
    "a calculation": ("MoveL Offs(p,dx-5,-dx/2,up DIV 3),v9,fine,t;\n", True),
    "a variable that nothing writes": ("MoveL Offs(p,0,0,h),v9,fine,t;\n", True),
    "loops": (
        "FOR i FROM 0 TO 2 DO\nFOR j FROM 1 TO n DO\nMoveL Offs(p,i*dx/4,(j-1)*5,0),v9,fine,t;\nENDFOR\nENDFOR\n", True
    ),
    "a loop downwards": ("FOR i FROM 4 TO 0 STEP -2 DO\nMoveL RelTool(p,0,0,-i\\Rz:=i),v9,fine,t;\nENDFOR\n", True),
    "a large pattern": (
        "FOR i FROM 0 TO 9 DO\nFOR j FROM 0 TO 9 DO\nMoveL Offs(p,i,j,0),v9,fine,t;\nENDFOR\nENDFOR\n", True
    ),
    "a loop with an unknown end": ("FOR i FROM 0 TO w DO\nMoveL Offs(p,i*5,0,0),v9,fine,t;\nENDFOR\n", False),
    "a variable without value": ("MoveL Offs(p,0,0,w),v9,fine,t;\n", False),
    "a variable that is counted": ("Incr h;\nMoveL Offs(p,0,0,h),v9,fine,t;\n", False),
    "a variable that is assigned": ("h:=5;\nMoveL Offs(p,0,0,h),v9,fine,t;\n", False),
    "a variable that the operator enters": ('TPReadNum h,"height";\nMoveL Offs(p,0,0,h),v9,fine,t;\n', False),
    "a loop variable of a loop that ended": ("FOR i FROM 0 TO 2 DO\nENDFOR\nMoveL Offs(p,i,0,0),v9,fine,t;\n", False),
    "a function": ("MoveL Offs(p,0,0,Abs(h)),v9,fine,t;\n", False),
    "text that is no RAPID": ("MoveL Offs(p,0,0,h if h else 1),v9,fine,t;\n", False),
}  # fmt: skip


@pytest.mark.parametrize("row", PATTERNS)
def test_pattern_is_corrected_if_its_offsets_are_known(row: str, tmp_path: Path) -> None:
    moves, is_known = PATTERNS[row]
    rig, files = abb_files(module_of(f"MoveAbsJ {{q1}},v9,fine,t;\nConfL\\Off;\n{moves}", data=DATA))
    found = corrected_files(rig, tmp_path, files)
    assert ("p" in found.names) == is_known and [one.reason for one in found.left] == ([] if is_known else ["offset"])


ARRAYS: dict[str, tuple[str, list[str], list[str]]] = {
    "numbers": ("MoveL ps{1},v9,fine,t;\nMoveL ps{2},v9,fine,t;\nMoveL ps{3},v9,fine,t;\n", ["1", "2", "3"], []),
    "a loop": ("FOR i FROM 1 TO 3 DO\nMoveL ps{i},v9,fine,t;\nENDFOR\n", ["1", "2", "3"], []),
    "a calculation": ("FOR i FROM 0 TO 1 DO\nMoveL ps{2*i+1},v9,fine,t;\nENDFOR\n", ["1", "3"], ["unused"]),
    "an unknown index": ("MoveL ps{w},v9,fine,t;\n", ["1", "2", "3"], []),
    "an approach": ("MoveL ps{2},v9,fine,t;\nMoveL Offs(ps{2},0,0,dx),v9,fine,t;\n", ["2"], ["unused", "unused"]),
    "an element that is written": ("MoveL ps{2},v9,fine,t;\nps{w}.trans.z:=3;\n", [], ["changed"] * 3),
    "one that is handed over": ("MoveL ps{1},v9,fine,t;\nown ps;\n", [], ["changed"] * 3),
    "two tools": ("MoveL ps{w},v9,fine,t;\nMoveL ps{1},v9,fine,tool0;\n", ["2", "3"], ["several_frames"]),
}


@pytest.mark.parametrize("row", ARRAYS)
def test_element_of_an_array_is_a_point(row: str, tmp_path: Path) -> None:
    moves, done, left = ARRAYS[row]
    data = f"{DATA}\nPERS robtarget ps{{3}}:=[{{p1}},{{p2}},{{p3}}];"
    rig, files = abb_files(
        module_of("MoveAbsJ {q1},v9,fine,t;\n" + moves, "PROC own(INOUT robtarget r{*})\nENDPROC\n", data)
    )
    found = corrected_files(rig, tmp_path, files)
    assert sorted(name for name in found.names if name[:2] == "ps") == [f"ps{{{k}}}" for k in done]
    assert [one.reason for one in found.left if one.name[:2] == "ps"] == left


@pytest.mark.parametrize("size", ["2,2", "n", "4"])
def test_array_that_is_not_traced_is_listed(size: str, tmp_path: Path) -> None:
    data = f"{DATA}\nCONST robtarget ps{{{size}}}:=[{{p1}},{{p2}}];"
    rig, files = abb_files(module_of("MoveL ps{1},v9,fine,t;\n", data=data))
    assert [one.reason for one in corrected_files(rig, tmp_path, files).left if one.name == "ps"] == ["array"] * 2


def test_modules_of_a_backup_are_read_from_the_folder_of_the_task(tmp_path: Path) -> None:
    rig, files = abb_files(
        {
            "a.mod": "MODULE a\nPROC main()\nMoveJ {p1},v9,fine,t;\nENDPROC\nENDMODULE\n",
            "b.sys": "MODULE b\n{t}\nENDMODULE\n",
        }
    )
    for task in ("TASK1", "TASK2"):
        for folder, name in (("PROGMOD", "a.mod"), ("SYSMOD", "b.sys")):
            text = files[name] if task == "TASK1" else files[name].replace("[5,0,90]", "[0,0,300]")
            (tmp_path / "RAPID" / task / folder).mkdir(parents=True)
            (tmp_path / "RAPID" / task / folder / name).write_text(text)
    wrong = known(rig)
    path = tmp_path / "RAPID" / "TASK1" / "PROGMOD" / "a.mod"
    found = correct_program(wrong, supports(wrong), path, frames_of(rig.robot, [], []), None)
    assert found.names == ("MoveJ",) and not found.left


COPIES = {
    "an approach": ("c:=Offs(p,0,0,30);\nMoveL c,v9,fine,t;\nMoveL p,v9,fine,t;\n", True),
    "an approach along the tool": ("c:=RelTool(p,0,0,-30\\Rz:=3);\nMoveL c,v9,fine,t;\n", True),
    "a copy": ("c:=p;\nMoveL c,v9,fine,t;\n", True),
    "an offset from a copy": ("c:=Offs(p,0,0,up);\nMoveL Offs(c,0,0,-dx),v9,fine,t;\nMoveL c,v9,fine,t;\n", True),
    "offsets in one another": ("MoveL Offs(Offs(p,0,0,dx),5,0,0),v9,fine,t;\n", True),
    "two kinds of offsets": ("MoveL p,v9,fine,t;\nMoveL RelTool(Offs(p,0,0,dx),5,0,0),v9,fine,t;\n", None),
    "two assignments": ("c:=Offs(p,0,0,5);\nMoveL c,v9,fine,t;\nc:=Offs(p,0,0,9);\nMoveL c,v9,fine,t;\n", False),
    "a part that is assigned": ("c:=p;\nc.trans.z:=400;\nMoveL c,v9,fine,t;\n", False),
    "an unknown offset": ("c:=Offs(p,0,0,w);\nMoveL c,v9,fine,t;\n", False),
    "a routine that is given the copy": ("c:=p;\nown c;\nMoveL c,v9,fine,t;\n", False),
    "a search that writes the copy": ("c:=p;\nSearchL\\Stop,di1,c,{p2},v9,t;\nMoveL c,v9,fine,t;\n", False),
    "a parameter of the same name": ("c:=p;\nMoveL c,v9,fine,t;\nother p;\n", False),
}  # fmt: skip


@pytest.mark.parametrize("row", COPIES)
def test_copy_of_a_point_is_a_move_with_an_offset(row: str, tmp_path: Path) -> None:
    moves, is_copy = COPIES[row]
    rest = "PROC own(INOUT robtarget r)\nENDPROC\n"
    rest += "PROC other(robtarget c)\nMoveL c,v9,fine,t;\nENDPROC\n" if "other" in moves else ""
    data = f"{DATA}\nVAR robtarget c;"
    rig, files = abb_files(module_of(f"MoveAbsJ {{q1}},v9,fine,t;\nConfL\\Off;\n{moves}", rest, data))
    found = corrected_files(rig, tmp_path, files)
    assert ("p" in found.names) == (is_copy is not False)
    assert bool(found.left) == (is_copy is not True)


def test_parameter_hides_a_constant(tmp_path: Path) -> None:
    files = module_of(J0 + "go 400;\n", "PROC go(num dx)\nMoveL Offs(p,0,0,dx),v9,fine,t;\nENDPROC\n", DATA)
    rig, files = abb_files(files)
    assert [one.reason for one in corrected_files(rig, tmp_path, files).left] == ["offset"]


def test_error_of_the_worst_place_of_a_pattern_is_listed(tmp_path: Path) -> None:
    moves = "MoveL p,v9,fine,t;\nFOR i FROM 0 TO 3 DO\nMoveL Offs(p,0,-i*60,0),v9,fine,t;\nENDFOR\n"
    rig, files = abb_files(module_of(f"MoveAbsJ {{q1}},v9,fine,t;\nConfL\\Off;\n{moves}", data=DATA))
    found = corrected_files(rig, tmp_path, files)
    (listed,) = found.shared
    tips = []
    for text in (files["a.mod"], found.files["a.mod"].decode()):
        numbers = re.search(r"robtarget p:=\[\[([^]]*)\],\[([^]]*)\]", text)
        assert numbers
        X = _frame(numbers[1], numbers[2])
        X[1, 3] -= 180
        q = joints_of(rig, X @ np.linalg.inv(ABB_TOOL), np.radians(ABB[1]))
        tips.append((X, flange_at(rig, q, hidden()) @ ABB_TOOL))
    before, after = (float(np.linalg.norm((real - tips[0][0])[:3, 3])) for _, real in tips)
    assert (listed.before_mm, listed.after_mm) == pytest.approx((before, after), abs=2e-3)


def _frame(at: str, turned: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - for one test

    T = np.eye(4)
    T[:3, 3] = [float(value) for value in at.split(",")]
    T[:3, :3] = Rotation.from_quat([float(value) for value in turned.split(",")], scalar_first=True).as_matrix()
    return T


@pytest.mark.parametrize(
    ("q_deg", "axis"),
    [
        ((20, 10, 20, 89.97, 60, -40), 3), ((20, 10, 20, 30, 60, 90.02), 5), ((20, 10, 20, 30, 60, -180.0), 5),
        ((20, 10, 20, 30, 60, 0.0), 5), ((20, 10, 20, 30, 60, 180.0), 5), ((20, 10, 20, 30, 60, -90.0), 5),
    ],
)  # fmt: skip
def test_configuration_follows_a_correction_across_the_end_of_a_quadrant(
    q_deg: tuple[float, ...], axis: int, tmp_path: Path
) -> None:
    rig = rig_of("abb-irb-120")
    pose = robtarget_of(rig, q_deg, np.eye(4))
    path = tmp_path / "a.mod"
    tool = f"PERS tooldata t:=[TRUE,[[5,0,90],[{quaternion(ABB_TOOL)}]],[1,[0,0,50],[1,0,0,0],0,0,0]];"
    path.write_text(f"MODULE a\n{tool}\nPROC b()\nMoveJ {pose},v9,fine,t;\nENDPROC\nENDMODULE\n")
    wrong = known(rig)
    found = correct_program(wrong, supports(wrong), path, frames_of(rig.robot, [], []), None)
    written = re.findall(r"\[([^\[\]]*)\]", found.files["a.mod"].decode().split("\n")[3])
    conf = [int(value) for value in written[2].split(",")]
    q = joints_of(rig, _frame(*written[:2]) @ np.linalg.inv(ABB_TOOL), np.radians(q_deg))
    place = (0, 3, 5).index(axis)
    assert (
        not found.left
        and conf[place] != int(q_deg[axis] // 90)
        and conf[:3] == [int(np.floor(q[k] / (np.pi / 2) + 1e-9)) for k in (0, 3, 5)]
    )


@pytest.mark.parametrize("offset", ["0,0,n", "n,0,0", "Abs(n),0,0"])
def test_configuration_stays_if_an_approach_is_at_an_unknown_place(offset: str, tmp_path: Path) -> None:
    pose = robtarget_of(rig_of("abb-irb-120"), (20, 10, 20, 30, 60, 0.0), np.eye(4))
    data = f"VAR num n;\nCONST robtarget p:={pose};"
    rig, files = abb_files(module_of(f"MoveJ p,v9,fine,t;\nMoveL Offs(p,{offset}),v9,fine,t;\n", data=data))
    found = corrected_files(rig, tmp_path, files)
    assert [one.reason for one in found.left if one.line == 4] == ["changes_flags"] and not found.names


@pytest.mark.parametrize("name", ["a.mod", "a.MOD", "a.modx", "a.prg", "A.PRG"])
def test_files_of_a_program(name: str, tmp_path: Path) -> None:
    rig, files = abb_files(module_of(J0 + L1))
    assert len(corrected_files(rig, tmp_path, {name: files["a.mod"]}).names) == 2


def test_hand_of_a_variant_is_not_the_tool(tmp_path: Path) -> None:
    """A module that has a tool of the same name for itself does not change the tool of the program."""
    rig, files = abb_files({**module_of(J0 + L1), "b.mod": "MODULE b\nLOCAL " + HAND + "ENDMODULE\n"})
    assert [why for _, why in uncorrected(corrected_files(rig, tmp_path, files))] == ["unknown_tool"]
