"""Tools, frames and neutral routines stated by the user, and the report on them and on the corrected program."""

import re

import pytest

from analysis.apps.correct import program_report
from analysis.apps.correct.stated_frames import frames_of
from rigs.errors import UseError
from tests.analysis.apps.correct.programs.cases import case_of, cases_of
from tests.analysis.apps.correct.programs.cells import (
    HEAD,
    J1,
    L2,
    L3,
    L4,
    M1,
    M2,
    OTHER,
    TCP,
    YASKAWA_STATED,
    corrected_cell,
    corrected_files,
    job_of,
    listing,
    selecting,
    uncorrected,
    yaskawa_files,
)
from tests.support.answers import words_of
from tests.support.refusals import refused
from tests.worlds.interpreters.arms import rig_of


def test_stated_tool_that_the_program_sets_otherwise_is_reported(tmp_path):
    files = {"a.script": "movej({q0})\n" + OTHER + "movel({p1})\nmovel({p2})\n"}
    found = corrected_cell("ur", tmp_path, files, ["tcp=0,0,145,0,0,0"])
    assert not found.left and [(one.name, one.line) for one in found.overruled] == [("tcp", 2)]
    assert not corrected_cell("ur", tmp_path, files, ["tcp=0,0,200,0,0,0"]).overruled


def test_partly_corrected_program_is_reported_and_held_on_request(tmp_path):
    files = {"a.script": TCP + "movej({q0})\nmovel({p1})\nmovel({p2})\nset_tcp(x)\nmovel({p4})\n"}
    found = corrected_cell("ur", tmp_path, files)
    assert uncorrected(found) == [(6, "unknown_tool")] and not found.held
    assert found.beside_left_mm.tolist() == pytest.approx([found.moved_mm[-1]])
    first, second, *_ = words_of(program_report.blocks(found))
    assert re.findall(r"\d+ (?=\w)", first) == ["3 ", "1 ", "1 "] and f"{found.moved_mm[-1]:.3f} mm" in second
    held = corrected_cell("ur", tmp_path, files, whole=True)
    assert held.held and "--all-or-nothing" in words_of(program_report.blocks(held))[1]


def test_tool_stated_twice_with_other_numbers_is_refused():
    robot = rig_of("ur10e").robot
    for tools, frames in ((["1=0", "1=0,50,200,0,20,10"], []), ([], ["2=0", "2=1,0,0,0,0,0"])):
        with refused("usage", "is given twice, with different numbers"):
            frames_of(robot, tools, frames)
    assert set(frames_of(robot, ["1=0", "1=0,0,0,0,0,0"], []).tools) == {"1"}


def test_tool_that_nothing_uses_or_that_is_in_metres_is_doubted(tmp_path):
    tools, frames = ["1=0,0.05,0.2,0,20,10", "4=0,0,200,0,0,0"], ["2=500,-100,30,0,0,45", "3=0"]
    found = corrected_cell("kuka", tmp_path, {"a.src": HEAD + "PTP {q0}\nPTP {p1}\nEND\n"}, tools, frames)
    doubts = frames_of(rig_of("kuka-kr-10-r1100-2").robot, tools, frames).doubts({*found.named}, None)
    assert [doubt.partition(":")[0] for doubt in doubts] == ["--tool 1", "--tool 4", "--frame 3"]
    assert "206.2 mm" in doubts[0] and "uses" not in doubts[0]


def test_jobs_of_the_second_robot_and_functions_of_other_programs_are_noticed(tmp_path):
    rig, files = yaskawa_files({"a.jbi": job_of(M1, M2)})
    files = {"a.jbi": files["a.jbi"].replace("///GROUP1 RB1", "///GROUP1 RB2")}
    found = corrected_files(rig, tmp_path, files, *YASKAWA_STATED)
    assert len(found.names) == 2 and "RB2" in found.notices[0].text
    text = TCP + 'cam=rpc_factory("xmlrpc","a")\nmovej({q0})\nx=cam.get()\nmovel({p1})\ncam.get()\n'
    found = corrected_cell("ur", tmp_path, {"a.script": text})
    assert not found.left and [(one.line, one.text.split()[0]) for one in found.notices] == [(4, "cam.get")]
    assert program_report.as_object(found)["notices"][0]["line"] == 4


def test_place_in_another_file_is_reported_with_that_file(tmp_path):
    found = case_of("kuka", cases_of("kuka")["LIN_REL of some coordinates in a file that is called"]).corrected(
        tmp_path
    )
    assert "step.src line 2" in " ".join(words_of(program_report.blocks(found)))
    assert [one["file"] for one in program_report.as_object(found)["left"]] == ["step.src"]


def test_all_routines_without_text_are_named_at_once(tmp_path):
    main = selecting(J1, "CALL GRIP", "CALL PART", "CALL GRIP", L2, "$EQZ.$EQ_GUN_MNT=1", L3, L4)
    part, unused = listing("CALL LAMP(1)", name="PART"), listing("CALL ELSEWHERE", name="UNUSED")
    files = {"main.ls": main, "part.ls": part, "unused.ls": unused}
    found = corrected_cell("fanuc", tmp_path, files)
    assert found.missing == ("$EQZ.$EQ_GUN_MNT=1", "GRIP", "LAMP")
    assert program_report.as_object(found)["missing_routines"] == found.missing
    assert "--neutral '$EQZ.$EQ_GUN_MNT=1,GRIP,LAMP'" in " ".join(words_of(program_report.blocks(found)))
    stated = corrected_cell("fanuc", tmp_path, files, neutral=found.missing)
    assert uncorrected(found) and not uncorrected(stated) and not stated.missing


def test_neutral_routines_are_reported(tmp_path):
    found = case_of("fanuc", cases_of("fanuc")["neutral routine: CALL GRIP"]).corrected(tmp_path)
    assert found.neutral == ("GRIP", "Hand open")
    assert "GRIP" in " ".join(words_of(program_report.blocks(found)))
    assert program_report.as_object(found)["neutral_routines"] == found.neutral
    with refused("usage", "a program is a single file"):
        corrected_cell("ur", tmp_path, {"a.script": "movej({q0})\n"}, neutral=["GRIP"])


@pytest.mark.parametrize("names", ["", "GRIP,", "../GRIP", "GRIP{}", "GRIP\nCALL"])
def test_text_that_is_not_the_name_of_a_routine_is_refused(names):
    with pytest.raises(UseError):
        frames_of(rig_of("ur10e").robot, [], [], [names])
