"""The effect of the program before a target on tool, frame, displacement and posture, in the cases of each maker.

In each case the robot has another tool, frame, displacement or posture than the nearby text suggests, or has not.
"""

import re

import pytest

from tests.analysis.apps.correct.programs.cases import case_of, cases_of
from tests.support.nightly import cases

MAKERS = ("ur", "kuka", "abb", "fanuc", "yaskawa", "linuxcnc")
CASES = {f"{maker}: {name}": (maker, text) for maker in MAKERS for name, text in cases_of(maker).items()}


@pytest.mark.parametrize("name", CASES)
def test_exactly_the_certain_targets_are_corrected(name, tmp_path):
    case = case_of(*CASES[name])
    assert case.left_in(case.corrected(tmp_path)) == case.left


JOBS = [name for name, (maker, _) in CASES.items() if maker == "yaskawa"]


@pytest.mark.parametrize("name", cases(JOBS, JOBS[::10]))
def test_lines_of_a_job_may_end_in_carriage_return(name, tmp_path):
    case = case_of(*CASES[name])
    assert case.left_in(case.corrected(tmp_path, "\r")) == case.left


@pytest.mark.parametrize("name", [name for name, (maker, _) in CASES.items() if maker == "linuxcnc"])
def test_only_complete_lines_of_g_code_change(name, tmp_path):
    case = case_of(*CASES[name])
    lines = {int(place.partition(":")[2]) for place, _ in case.left}
    before, after = case.files["a.ngc"], case.corrected(tmp_path).files["a.ngc"].decode()
    for number, (old, new) in enumerate(zip(before.splitlines(), after.splitlines(), strict=True), start=1):
        is_target = len(re.findall(r"(?<!\w)[XYZABC]-?\d+\.\d", old)) == 6 and "G10" not in old
        assert (old != new) == ((is_target and number not in lines) or number == 7), old
