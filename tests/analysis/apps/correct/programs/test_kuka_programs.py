"""Programs of KUKA in a backup of the controller: routines, home and tools in other folders, and a whole directory."""

import re
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.correct.corrected_program import CorrectedProgram
from analysis.apps.makers.reading import programs_at, refuse_marked
from rigs.errors import FileError
from tests.analysis.apps.correct.programs.cells import (
    HEAD,
    KUKA_STATED,
    Files,
    corrected,
    corrected_cell,
    corrected_files,
    kuka_files,
    uncorrected,
    write_files,
)


@pytest.mark.parametrize(("start", "k"), [(0, 1), (1, 2), (2, 3), (3, 4), (4, 0), (0, 2)])
@pytest.mark.parametrize("kept", ["S", "T"])
def test_one_posture_flag_of_krl_is_enough_only_if_it_identifies_the_posture(start, k, kept, tmp_path):
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


def in_backup(
    root: Path, files: Files, at: str = "", stated: tuple[list[str], list[str]] = ([], [])
) -> CorrectedProgram:
    rig, filled = kuka_files(files)
    write_files(root / "R1", filled)
    return corrected(rig, root / "R1" / at, *stated)


def test_routines_home_and_tools_are_found_in_the_whole_backup(tmp_path):
    found = in_backup(tmp_path, BACKUP, "Program/cell/pick.src")
    assert uncorrected(found) == []
    assert found.names == ("XP1", "XP2")
    assert set(found.files) == {"pick.src", "pick.dat"}
    assert [notice.line for notice in found.notices] == [9]  # XHOME is shared, and keeps its numbers.


def test_missing_routine_is_the_reason_instead_of_the_tool(tmp_path):
    without = {name: text for name, text in BACKUP.items() if "grip" not in name}
    found = in_backup(tmp_path, without, "Program/cell/pick.src")
    assert {one.reason for one in found.left} == {"not_understood"}
    assert any("GRIP" in cause.why for one in found.left for cause in one.because)


def test_directory_is_corrected_as_one_program(tmp_path):
    shared = "DEFDAT points PUBLIC\nDECL GLOBAL E6POS XS={p2}\nENDDAT\n"
    second = "DEF other()\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[2]\nPTP XS\nPTP XP1\nEND\n"
    local = "DEFDAT other\nDECL E6POS XP1={p3}\nENDDAT\n"
    files = {**BACKUP, "Program/points.dat": shared, "Program/other.src": second, "Program/other.dat": local}
    found = in_backup(tmp_path, files)
    assert uncorrected(found) == []
    assert sorted(found.names) == ["XP1", "XP1", "XP2", "XS"]
    assert found.changed == {"Program/cell/pick.dat", "Program/points.dat", "Program/other.dat"}
    assert set(found.files) == found.changed


def test_directory_with_an_earlier_correction_or_two_makers_is_refused(tmp_path):
    in_backup(tmp_path, BACKUP)
    (tmp_path / "R1/Program/done.dat").write_text(
        "DEFDAT done\n; corrected by rig on 2026-11-29: do not correct twice\nENDDAT\n"
    )
    with pytest.raises(FileError, match=r"done\.dat:2"):
        refuse_marked(tmp_path / "R1")
    (tmp_path / "R1/a.script").write_text("def a():\nend\n")
    with pytest.raises(FileError, match="kuka, ur"):
        programs_at(tmp_path / "R1")


def test_shifted_copy_is_off_by_the_stated_amount_only(tmp_path):
    text = HEAD + "PTP {q0}\nAUX=XP\nAUX.Z=AUX.Z+5\nPTP AUX\nLIN XP\nEND\n"
    files = {"a.src": text, "a.dat": "DEFDAT a\nDECL E6POS XP={p1}\nDECL E6POS AUX\nENDDAT\n"}
    found = corrected_cell("kuka", tmp_path, files)
    assert np.isfinite(found.given_away_mm).sum() == 1
    assert np.nanmax(found.given_away_mm) < 0.1 * found.moved_mm.max()


@pytest.mark.parametrize("name", ["a", "x", "B", "S", "t", "e1"])
def test_point_named_like_a_component_is_not_changed_by_components(name, tmp_path):
    files = BACKUP | {
        "Program/cell/pick.src": INLINE.replace("XP1", name),
        "Program/cell/pick.dat": DATA.replace("XP1", name),
    }
    assert uncorrected(in_backup(tmp_path, files, "Program/cell/pick.src")) == []
