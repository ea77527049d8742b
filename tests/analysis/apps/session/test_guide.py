"""A complete session: undisturbed, killed at each step, with rejected runs, and with runs of other users."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest

from analysis.apps.report.blocks import as_object
from analysis.apps.report.texts import texts_of
from analysis.apps.session import session_report as report
from analysis.apps.session.session_answer import end_blocks
from analysis.apps.session.session_state import Session, SessionDirectory
from rigs.load import load
from tests.support.nightly import cases
from tests.support.session_cell import (
    NAMED,
    Killed,
    MortalPlace,
    Oracle,
    Screen,
    Simulated,
    begun,
    cell_file,
    gone_on,
)

_MOST_LIVES = 80
AIMS = cases(("check", "faults"), ("check",))
"""Aims of the tested sessions. The quick run uses only `check`, which skips correction and verification and takes a
tenth
of the time.
"""


@pytest.fixture
def place(tmp_path):
    return tmp_path / "session"


def _blank_page(_: Session, __: object, place: SessionDirectory, ___: object) -> Path:
    page = place.directory / report.PAGE
    page.write_text(" " * 20_000)
    return page


@pytest.fixture
def page_at_once(monkeypatch):
    """Write the page without charts, which take most of a session's time."""
    monkeypatch.setattr(report, "write_report", _blank_page)


@dataclass(frozen=True)
class Whole:
    """A complete session with its driver, questions, messages and page."""

    session: Session
    place: Path
    driver: Simulated
    oracle: Oracle
    screen: Screen
    shown: list[object]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    place = folder / "session"
    begun(cell_file(folder), place)
    driver, oracle, screen = Simulated(place), Oracle(), Screen()
    shown = []

    def page(session: Session, rig: object, at: SessionDirectory, diagnosis: object) -> Path:
        shown.append(diagnosis)
        return _blank_page(session, rig, at, diagnosis)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report, "write_report", page)
        return Whole(gone_on(place, driver, oracle, screen=screen), place, driver, oracle, screen, shown)


def finished(session: Session, place: Path) -> None:
    """Check that a session is complete: no open step, a smaller error, and a page."""
    assert not any(step.is_open for step in session.steps)
    assert (place / session.report).stat().st_size > 10_000
    if session.aim == "check":
        assert session.verified is None and session.correction is None
        return
    for before, after in (
        (session.verified.same_before, session.verified.same_after),
        (session.verified.elsewhere_before, session.verified.elsewhere_after),
    ):
        assert after.um < 0.3 * before.um


def test_session_measures_diagnoses_corrects_and_verifies(whole):
    session = whole.session
    finished(session, whole.place)
    assert whole.driver.stages == ["yaw", "other", "yaw"]
    assert session.correction.way in ("entries", "programs")
    found, judges = len(session.runs_for("find")), len(session.runs_for("judge"))
    assert whole.oracle.asked[-2:] == [(found, judges), (found + judges, 0)], "the place that judged joins afterwards"
    assert session.answer.joined == judges and session.judged.judges == judges
    keys = [key for block in as_object(end_blocks(session, whole.place)) for key in block.get("keys", ())]
    assert {"before_after", "about_before_after"} <= set(keys) and f"is_now_{session.correction.way}" in keys


def test_page_contains_charts(whole):
    place = SessionDirectory(whole.place)
    (place.directory / report.PAGE).unlink()  # an empty page, which rig does not replace
    correction = whole.session.correction
    assert correction.same and correction.work
    unknown = correction.work.model_copy(update={"unknown": 0.82})
    session = whole.session.model_copy(update={"correction": correction.model_copy(update={"work": unknown})})
    page = report.write_report(session, load(whole.session.rig_file)[0], place)
    text = page.read_text()
    assert page.stat().st_size > 10_000 and "data:image/svg" in text
    assert texts_of("en").not_known(0.82) in text
    assert f"to {correction.same.text}" in correction.sentence
    key = "rms_without_u" if correction.same.u_um is None else "rms_and_u_of"
    assert texts_of("en")(key, error=correction.same) in text


@pytest.mark.cpu_limit(150)
@pytest.mark.usefixtures("page_at_once")
def test_session_killed_at_each_step_gives_the_same_result(whole, place, tmp_path):
    begun(cell_file(tmp_path), place)
    mortal = Simulated(place)
    for life in range(_MOST_LIVES):
        before = SessionDirectory(place).read()
        try:
            session = gone_on(place, mortal, Oracle(), MortalPlace(place, before=life % 2 == 0))
        except Killed:
            now = SessionDirectory(place).read()
            assert life % 2 or now == before, "a state that was not written is not there"
            continue
        break
    else:
        pytest.fail("it never came to the end")
    finished(session, place)
    assert mortal.driven == whole.driver.driven, "no program is driven twice: its run is found and taken"
    same = {"tries", "began"}
    assert [step.model_dump(exclude=same) for step in session.steps] == [
        step.model_dump(exclude=same) for step in whole.session.steps
    ]
    assert session.verified == whole.session.verified and not session.left_alone


@pytest.mark.usefixtures("page_at_once")
def test_ambiguous_diagnosis_schedules_the_separating_test(place, tmp_path):
    begun(cell_file(tmp_path), place)
    ambiguous = NAMED.model_copy(update={"condition": "ambiguous", "next_test": "roll on the circle"})
    driver = Simulated(place)
    with SessionDirectory(place) as held:
        session = held.read()
        held.write(session.model_copy(update={"minutes": 30.0}))
    session = gone_on(place, driver, Oracle([ambiguous] * 6 + [NAMED]))
    assert "roll" in driver.stages and driver.stages.index("roll") < driver.stages.index("other")
    roll = [step.program for step in session.steps if step.test == "roll"]
    assert roll == ["p05-roll-acw", "p06-roll-cw"] * 2
    finished(session, place)


@pytest.mark.usefixtures("page_at_once")
@pytest.mark.parametrize("aim", AIMS)
def test_runs_of_other_users_are_ignored(aim, place, tmp_path):
    begun(cell_file(tmp_path), place, aim=aim)
    driver = Simulated(place)
    with pytest.raises(Killed):
        gone_on(place, driver, Oracle(), MortalPlace(place, before=True))
    run = next((place / "runs").iterdir())
    other = run.with_name("20250101T000000Z_somebody")
    shutil.copytree(run, other)
    manifest = (other / "manifest.json").read_text().replace("p01-yaw-acw", "somebody")
    (other / "manifest.json").write_text(manifest)
    copy = run.with_name("20270101T000002Z_copied")
    shutil.copytree(run, copy)  # under the name of a program that has another run to come
    (place / "runs" / "20250101T000001Z_broken").mkdir()
    (place / "runs" / "20250101T000001Z_broken" / "manifest.json").write_text("{}")
    session = gone_on(place, driver, Oracle())
    assert set(session.left_alone) == {other.name, copy.name, "20250101T000001Z_broken"}
    finished(session, place)
