import numpy as np
import pytest

from analysis.apps.planning import proposal as proposals
from analysis.apps.planning.circle_candidates import circle_candidates
from analysis.apps.planning.plan_report import write
from analysis.apps.planning.proposal import CircleProposal, propose
from analysis.diagnosis.plan.expected import FormInformation, expected_posterior, planned_blocks
from analysis.robot.geometry.driven_programs import circle_program, feasible_tests
from rigs.errors import FileError, RigError
from rigs.load import load
from tests.support.changed_rigs import with_tests
from tests.support.command_line import errors_of, json_of, succeeded
from tests.support.made_once import made_once
from tests.support.refusals import refused

RIG, TEXT = load("paper-fanuc")
CIRCLE = ("yaw", "roll")
SEVERAL = ("100 mm nearer to axis 1, radius 140 mm", "ball 40 mm off axis 6")


@pytest.fixture(scope="module")
def every():
    return circle_candidates(RIG, CIRCLE, 3)[0]


@made_once
def _of_two_circles() -> CircleProposal:
    found, refused_circles = circle_candidates(RIG, CIRCLE, 3)
    some = tuple(one for one in found if one.words in SEVERAL), refused_circles
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(proposals, "circle_candidates", lambda *_: some)
        return propose(RIG, CIRCLE, 3, 120.0)


@pytest.fixture(scope="module")
def proposed():
    return _of_two_circles()


def test_why_a_circle_is_refused_does_not_depend_on_words(monkeypatch):
    _, before = circle_candidates(RIG, CIRCLE, 3)
    assert sum(before.values()) > 0
    said = RigError.__init__
    monkeypatch.setattr(
        RigError, "__init__", lambda error, where, what, remedy, code="": said(error, "a", "b", "c", code)
    )
    assert circle_candidates(RIG, CIRCLE, 3)[1] == before


def test_candidates_start_at_their_posture_and_take_time(every):
    assert len(every) > 5
    assert len({one.words for one in every}) == len(every)
    for one in every[::7]:
        program = circle_program(one.rig, "acw")
        np.testing.assert_allclose(np.degrees(program.q[0]), one.rig.tests.circle.posture_deg, atol=0.01)
        assert one.minutes == pytest.approx(10 + 2 * 2 * 3 * program.t_s[-1] / 60, rel=1e-6)


@pytest.fixture(scope="module")
def circle_alone():
    """A run of each test: what is compared here does not depend on their number."""
    return planned_blocks(RIG, CIRCLE, 1)


def test_information_gives_the_uncertainty_that_the_plan_gives(
    circle_alone,
):
    expected = expected_posterior(*circle_alone)
    forms = FormInformation(expected.candidates)
    known = forms.posterior(forms.of(*circle_alone))
    for name in ("joint_offset 3", "link_geometry 4.a", "wrist_coupling 4>5", "gauge_baseline"):
        (one,) = (one for one in expected.candidates if one.name == name)
        assert known.sd(one) == pytest.approx(expected.sd(one), rel=0.02), name


def test_hidden_errors_of_one_circle_propose_ball_offset_and_radius(
    proposed,
):
    words = [one.candidate.words for one in proposed.circles]
    assert "ball 40 mm off axis 6" in words and len(set(words)) == len(words)
    testable = {name for one in proposed.circles for name in one.testable}
    assert "reversal_spike 6" in testable
    assert len(proposed.after.undetectable) < len(proposed.before.undetectable)
    assert sum(one.candidate.minutes for one in proposed.circles) <= 120


def test_proposed_rig_files_are_valid_and_keep_comments(proposed, tmp_path):
    written = write(proposed, TEXT, tmp_path / "circles")
    assert [path.name for path in written] == [
        f"paper-fanuc-circle-{number}.yaml" for number in range(1, len(proposed.circles) + 1)
    ]
    for path, one in zip(written, proposed.circles, strict=True):
        rig, text = load(path)
        assert rig.tests == one.candidate.rig.tests and rig.robot.tool == one.candidate.rig.robot.tool
        assert feasible_tests(rig, rig.name)[0][0].startswith("circle of")
        assert " Table 1 of Oh 2019" in text
    with pytest.raises(FileError, match="exists already"):
        write(proposed, TEXT, tmp_path / "circles")


def test_command_prints_circles_and_next_step(proposed, tmp_path, monkeypatch):
    monkeypatch.setattr(proposals, "propose", lambda *_: proposed)
    monkeypatch.setenv("COLUMNS", "140")
    out = tmp_path / "circles"
    done = succeeded(f"plan paper-fanuc --tests yaw,roll --propose -o {out}")
    assert "1. " in done.stdout and "detectable" in done.stdout
    first = out / "paper-fanuc-circle-1.yaml"
    assert f"next: rig program {first} --for fanuc --test yaw -o programs\n" in done.stderr
    found = json_of("plan paper-fanuc --tests yaw,roll --propose")
    assert found["circles"][0]["words"] == proposed.circles[0].candidate.words
    assert len(found["after"]["not_testable"]) < len(found["before"]["not_testable"])


def test_wrong_use_is_one_line(tmp_path):
    for options, told in (f"-o {tmp_path}", "--output"), ("--propose --tests radial", "--tests"):
        assert errors_of(f"plan paper-fanuc {options}", exit_code=2).startswith(f"error: {told}: ")
    with refused("rig_file.invalid", "circle as a start"):
        propose(with_tests(RIG, circle=None), CIRCLE, 3, 60.0)
