import json

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis.apps.planning import proposal as proposals
from analysis.apps.planning.proposal import (
    CircleCandidate,
    CircleProposal,
    circle_candidates,
    propose,
)
from analysis.apps.planning.proposal_report import write
from analysis.cli import app
from analysis.diagnosis.plan.expected import FormInformation, expected_posterior, planned_blocks
from analysis.robot.geometry.driven_programs import circle_program, feasible_tests
from rigs.errors import FileError, RigError, UseError
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.vocabulary import TestName
from tests.support.command_line import ran
from tests.support.made_once import made_once
from tests.support.refusals import refused

RIG, TEXT = load("paper-fanuc")
CIRCLE: tuple[TestName, ...] = ("yaw", "roll")
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
        assert one.rig.tests.circle
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


def test_information_of_two_sets_of_runs_adds_up(every, circle_alone):
    own, other = circle_alone, planned_blocks(every[0].rig, CIRCLE, 1, " further")
    both = expected_posterior([*own[0], *other[0]], {**own[1], **other[1]})
    forms = FormInformation(both.candidates)
    known = forms.posterior(forms.of(*own) + forms.of(*other))
    for name in ("joint_offset 3", "link_geometry 4.a", "gauge_baseline"):
        one = next(one for one in both.candidates if one.name == name)
        assert known.sd(one) == pytest.approx(both.sd(one), rel=0.05), name


def test_hidden_errors_of_one_circle_propose_ball_offset_and_radius(
    proposed,
):
    words = [one.candidate.words for one in proposed.circles]
    assert "ball 40 mm off axis 6" in words
    testable = {name for one in proposed.circles for name in one.testable}
    assert "reversal_spike 6" in testable
    assert len(proposed.after.undetectable) < len(proposed.before.undetectable)
    assert sum(one.candidate.minutes for one in proposed.circles) <= 120


def test_time_that_is_too_short_proposes_nothing(proposed, every):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(proposals, "circle_candidates", lambda *_: (every, {}))
        patch.setattr(proposals, "judged", lambda _: proposed.before)
        found = propose(RIG, CIRCLE, 3, 5.0)
    assert found.circles == () and found.after is found.before


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
    done = ran("plan", "paper-fanuc", "--tests", "yaw,roll", "--propose", "-o", out)
    assert done.returncode == 0, done.stderr
    assert "1. " in done.stdout and "detectable" in done.stdout
    first = out / "paper-fanuc-circle-1.yaml"
    assert f"next: rig program {first} --for fanuc --test yaw -o programs\n" in done.stderr
    asked = ["plan", "paper-fanuc", "--tests", "yaw,roll", "--propose", "--json"]
    found = json.loads(ran(*asked).stdout)
    assert found["circles"][0]["words"] == proposed.circles[0].candidate.words
    assert len(found["after"]["not_testable"]) < len(found["before"]["not_testable"])


def _without_circle() -> Rig:
    return RIG.model_copy(update={"tests": RIG.tests.model_copy(update={"circle": None})})


def test_wrong_use_is_one_line(tmp_path):
    for options, told in (
        (["-o", str(tmp_path)], "--output: "),
        (["--propose", "--tests", "radial"], "--tests: "),
    ):
        done = CliRunner().invoke(app, ["plan", "paper-fanuc", *options])
        assert isinstance(done.exception, UseError)
        (line,) = done.exception.lines()
        assert line.startswith(told)
    with refused("plan.no_circle"):
        propose(_without_circle(), CIRCLE, 3, 60.0)


def test_the_same_circle_is_not_proposed_twice(proposed):
    chosen: list[CircleCandidate] = [one.candidate for one in proposed.circles]
    assert len({one.words for one in chosen}) == len(chosen)
