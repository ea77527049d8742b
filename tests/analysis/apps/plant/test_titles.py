from dataclasses import replace

from analysis.apps.plant.history import programs_of
from analysis.apps.plant.records import RunRecord

RUN = RunRecord("r", "f", "cell", "2026-11-26T03:00:00+00:00", "yaw", "cw", "left", program="0c441c75")


def titles(*runs: RunRecord) -> list[str]:
    return [title for title, _ in programs_of(runs)]


def test_a_title_names_the_placement_and_how_the_robot_was_corrected():
    assert titles(replace(RUN, corrected="targets")) == ["yaw cw, placement left, corrected programs"]
    assert titles(replace(RUN, test="radial", direction="", placement="")) == ["radial"]


def test_title_has_the_program_only_if_two_were_driven_at_one_placement():
    other = replace(RUN, placement="right", program="2a3ce151")
    assert titles(RUN, other) == ["yaw cw, placement left", "yaw cw, placement right"]
    changed = replace(RUN, program="2a3ce151")
    assert titles(RUN, changed) == [
        "yaw cw, placement left, program 0c441c75",
        "yaw cw, placement left, program 2a3ce151",
    ]
