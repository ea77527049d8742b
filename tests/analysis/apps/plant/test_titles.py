from dataclasses import replace

from analysis.apps.plant.history import _programs, title_of  # private: what two programs are called, without runs
from analysis.apps.plant.records import RunRecord

RUN = RunRecord("r", "f", "cell", "2026-11-26T03:00:00+00:00", "yaw", "cw", "left", program="0c441c75")


def test_a_title_names_the_placement_and_how_the_robot_was_corrected():
    assert title_of("yaw cw", "left", "targets") == "yaw cw, placement left, corrected programs"
    assert title_of("radial", "", "") == "radial"


def test_title_has_the_program_only_if_two_were_driven_at_one_placement():
    other = replace(RUN, placement="right", program="2a3ce151")
    assert [title for title, _ in _programs([RUN, other])] == ["yaw cw, placement left", "yaw cw, placement right"]
    changed = replace(RUN, program="2a3ce151")
    assert all("program " in title for title, _ in _programs([RUN, changed]))
