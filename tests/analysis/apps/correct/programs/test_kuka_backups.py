"""KUKA programs as they are in a backup of the controller: routines, home and tools in other folders, inline forms,
copies of points for approaches, arrays, and all programs of a directory at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.apps.correct.corrected_program import CorrectedProgram, correct_program, frames_of
from analysis.apps.makers.reading import programs_at, refuse_marked
from analysis.correction.support import supports
from rigs.errors import FileError
from tests.analysis.apps.correct.programs.test_safe_programs import HEAD, KUKA_STATED, kuka_files, uncorrected
from tests.analysis.apps.correct.programs.test_user_programs import KUKA
from tests.worlds.arms.faulty_arm import known

CONFIG = (
    "DEFDAT $CONFIG PUBLIC\nDECL FDAT FHOME={TOOL_NO 0,BASE_NO 0,IPO_FRAME #BASE}\nE6AXIS XHOME={q0}\n"
    "FRAME TOOL_DATA[16]\nTOOL_DATA[1]={X 0.0,Y 50.0,Z 200.0,A 10.0,B 20.0,C 0.0}\n"
    "BASE_DATA[2]={X 500.0,Y -100.0,Z 30.0,A 45.0,B 0.0,C 0.0}\nENDDAT\n"
)
HOME = "PDAT_ACT=PDEFAULT\nFDAT_ACT=FHOME\nBAS (#PTP_PARAMS,100 )\n$H_POS=XHOME\nPTP  XHOME\n"
INLINE = (
    "DEF pick( )\nGLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )\nINTERRUPT ON 3\nBAS (#INITMOV,0 )\n"
    + HOME
    + "FDAT_ACT=FP1\nBAS(#PTP_PARAMS,100)\nPTP XP1 C_DIS\nGRIP(1)\nLDAT_ACT=LC1\nFDAT_ACT=FP2\nBAS(#CP_PARAMS,2)\n"
    "LIN XP2\nGRIP(2)\nLIN XP1\n" + HOME + "END\n"
)
DATA = (
    "DEFDAT pick\nDECL E6POS XP1={p1}\nDECL FDAT FP1={TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE}\nDECL E6POS XP2={p1}\n"
    "DECL FDAT FP2={TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE}\nENDDAT\n"
)
GRIP = "DEF GRIP(n:IN)\nINT n\nSWITCH n\nCASE 1\n$OUT[1]=TRUE\nENDSWITCH\nH50(GRP,1,2,GC)\nEND\n"
BAS = "DEF BAS (COMMAND :IN,REAL_PAR :IN )\nSWITCH COMMAND\nCASE #FRAMES\n$BASE=$NULLFRAME\nENDSWITCH\nEND\n"
BACKUP = {
    "Program/cell/pick.src": INLINE,
    "Program/cell/pick.dat": DATA,
    "Program/tools/grip.src": GRIP,
    "System/$config.dat": CONFIG,
    "System/bas.src": BAS,
}


def _corrected(
    root: Path, files: dict[str, str], at: str = "", stated: tuple[list[str], list[str]] = ([], [])
) -> CorrectedProgram:
    rig, filled = kuka_files(files)
    for name, text in filled.items():
        (root / "R1" / name).parent.mkdir(parents=True, exist_ok=True)
        (root / "R1" / name).write_text(text)
    wrong = known(rig)
    return correct_program(wrong, supports(wrong), root / "R1" / at, frames_of(rig.robot, *stated), None)


def test_routines_home_and_tools_are_found_in_the_whole_backup(tmp_path: Path) -> None:
    found = _corrected(tmp_path, BACKUP, "Program/cell/pick.src")
    assert uncorrected(found) == []
    assert found.names == ("XP1", "XP2")
    assert set(found.files) == {"pick.src", "pick.dat"}
    assert [notice.line for notice in found.notices] == [9]  # XHOME is shared, and keeps its numbers.


def test_missing_routine_is_the_reason_instead_of_the_tool(tmp_path: Path) -> None:
    without = {name: text for name, text in BACKUP.items() if "grip" not in name}
    found = _corrected(tmp_path, without, "Program/cell/pick.src")
    assert {one.reason for one in found.left} == {"not_understood"}
    assert any("GRIP" in cause.why for one in found.left for cause in one.because)


def test_directory_is_corrected_as_one_program(tmp_path: Path) -> None:
    shared = "DEFDAT points PUBLIC\nDECL GLOBAL E6POS XS={p2}\nENDDAT\n"
    second = "DEF other()\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[2]\nPTP XS\nPTP XP1\nEND\n"
    local = "DEFDAT other\nDECL E6POS XP1={p3}\nENDDAT\n"
    files = {**BACKUP, "Program/points.dat": shared, "Program/other.src": second, "Program/other.dat": local}
    found = _corrected(tmp_path, files)
    assert uncorrected(found) == []
    assert sorted(found.names) == ["XP1", "XP1", "XP2", "XS"]
    assert found.changed == {"Program/cell/pick.dat", "Program/points.dat", "Program/other.dat"}
    assert set(found.files) == found.changed


def test_directory_with_an_earlier_correction_or_two_makers_is_refused(tmp_path: Path) -> None:
    _corrected(tmp_path, BACKUP)
    (tmp_path / "R1/Program/done.dat").write_text(
        "DEFDAT done\n; corrected by rig on 2026-11-29: do not correct twice\nENDDAT\n"
    )
    with pytest.raises(FileError, match=r"done\.dat:2"):
        refuse_marked(tmp_path / "R1")
    (tmp_path / "R1/a.script").write_text("def a():\nend\n")
    with pytest.raises(FileError, match="kuka, ur"):
        programs_at(tmp_path / "R1")


AUX = "DECL E6POS XP={p1}\nDECL E6POS AUX\n"
COPIES = {
    "a shift by a number": ("AUX=XP\nAUX.Z=AUX.Z+5\nPTP AUX\nLIN XP\n", AUX, [], 1),
    "from the point itself": ("AUX=XP\nAUX.Z=XP.Z+5\nAUX.X=AUX.X-3\nLIN AUX\nLIN XP\n", AUX, [], 1),
    "by a constant variable": ("H=5\nAUX=XP\nAUX.Z=AUX.Z+H\nPTP AUX\nLIN XP\n", AUX, [], 1),
    "by a variable of two values": ("H=5\nH=9\nAUX=XP\nAUX.Z=AUX.Z+H\nPTP AUX\nPTP XP\n", AUX, ["offset"], 1),
    "in a loop": ("AUX=XP\nLIN XP\nFOR i=1 TO 3\nAUX.Z=AUX.Z+5\nLIN AUX\nENDFOR\nPTP XP\n", AUX, ["offset"], 1),
    "a copy that a call may change": ("AUX=XP\nROUND(AUX)\nPTP AUX\nPTP XP\n", AUX, ["changed", "not_literal"], 0),
    "a copy of two points": ("AUX=XP\nAUX=XQ\nPTP AUX\nPTP XP\n", AUX + "DECL E6POS XQ={p2}\n", ["changed"] * 2, 0),
    "a frame, without flags": ("F=XP\nF.Z=F.Z+5\nPTP F\nPTP XP\n", AUX + "DECL FRAME F\n", ["changed"], 0),
    "a turned copy": ("AUX=XP\nAUX.A=AUX.A+5\nPTP AUX\nPTP XP\n", AUX, ["changed", "not_literal"], 0),
    "elements of an array": ("PTP P[1]\nPTP P[2]\n", "DECL E6POS P[2]\nP[1]={p1}\nP[2]={p2}\n", [], 2),
    "elements by a variable": ("PTP P[1]\nPTP P[i]\n", "DECL E6POS P[2]\nP[1]={p1}\nP[2]={p2}\n", ["changed"] * 2, 0),
    "an array that a line assigns": ("P[i].Z=3\nPTP P[1]\n", "DECL E6POS P[2]\nP[1]={p1}\n", ["changed"], 0),
    "a nested index elsewhere": ("L[n,M[k]]=$TIMER[1]\nPTP XP\n", AUX, [], 1),
}  # fmt: skip


@pytest.mark.parametrize("row", COPIES)
def test_points_that_a_program_copies_shifts_or_keeps_in_arrays(row: str, tmp_path: Path) -> None:
    moves, data, left, corrected = COPIES[row]
    text = HEAD + "PTP {q0}\n" + moves + "END\n"
    files = {"Program/a.src": text, "Program/a.dat": f"DEFDAT a\n{data}ENDDAT\n"}
    found = _corrected(tmp_path, files, "Program/a.src", KUKA_STATED)
    reasons = {reason for _, reason in uncorrected(found)}
    assert set(left) <= reasons <= {*left, "not_literal", "computed"}
    assert sum(name != "PTP" for name in found.names) == corrected


def test_shifted_copy_is_off_by_the_stated_amount_only(tmp_path: Path) -> None:
    text = HEAD + "PTP {q0}\nAUX=XP\nAUX.Z=AUX.Z+5\nPTP AUX\nLIN XP\nEND\n"
    files = {"Program/a.src": text, "Program/a.dat": f"DEFDAT a\n{AUX}ENDDAT\n"}
    found = _corrected(tmp_path, files, "Program/a.src", KUKA_STATED)
    assert np.isfinite(found.given_away_mm).sum() == 1
    assert np.nanmax(found.given_away_mm) < 0.1 * found.moved_mm.max()
    assert len(KUKA) == 5


@pytest.mark.parametrize("name", ["a", "x", "B", "S", "t", "e1"])
def test_point_named_like_a_component_is_not_changed_by_components(name: str, tmp_path: Path) -> None:
    files = BACKUP | {
        "Program/cell/pick.src": INLINE.replace("XP1", name),
        "Program/cell/pick.dat": DATA.replace("XP1", name),
    }
    assert uncorrected(_corrected(tmp_path, files, "Program/cell/pick.src")) == []
