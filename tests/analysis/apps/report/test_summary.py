"""Headline and three tiles: the same words for page, window and terminal, and the limits of the evidence first."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from rich.console import Console

from analysis.apps.report.act_words import ActWords
from analysis.apps.report.answer_words import AnswerWords
from analysis.apps.report.diagnosis_screen import StackedBar, as_screen, summary_on_screen
from analysis.apps.report.diagnosis_words import error_size
from analysis.apps.report.summary import Summary, with_driven_error
from analysis.apps.report.summary_words import step_of, summarise
from analysis.apps.report.texts import LANGUAGES, Language, texts_of
from analysis.apps.session.session_state import Answer, Session, SessionAct, SessionCorrection, VerifiedError
from analysis.apps.window.frames import shown_summary
from analysis.correction.deviation import Deviation
from analysis.diagnosis.evidence.movements import Movement
from analysis.diagnosis.judge.acts import Act
from analysis.diagnosis.judge.remains import ResidualSummary, Unexplained
from analysis.diagnosis.judge.result import BudgetPart, Condition, Diagnosis
from analysis.movement.between import with_movements
from rigs.effects import ClockRate, Effect, GaugeBaseline, GaugeScale
from tests.support.handmade_diagnosis import ACTS, APART, LOAD, PLAY, REMASTER, SMALL, ZERO, budget, diagnosis

EN = texts_of("en")
CONDITIONS: tuple[Condition, ...] = get_args(Condition)
MOST_FIGURES = 3
MOVED = Movement("a", "b", "base", 0.999, translation_mm=np.array([0.4, 0.0, 0.0]), u_mm=0.01, alike="plate")


def shown(found: Diagnosis, width: int = 80) -> str:
    console = Console(width=width, file=io.StringIO())
    with console.capture() as text:
        console.print(as_screen(found))
    return text.get()


def fields(summary: Summary) -> list[str]:
    """Every text of a summary, except empty ones."""
    error = summary.error
    texts = [summary.badge, summary.headline, *summary.unknowns, error.title, error.words, error.basis, error.standing]
    texts += [text for cause in summary.causes for text in (cause.name, cause.percent)]
    return list(filter(None, [*texts, summary.next, summary.command]))


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_badge_without_a_fault_is_green_only_within_the_limits(language: Language) -> None:
    """FAIL stood next to a green NO FAULT, on page and screen."""
    texts, tones = texts_of(language), {None: "pass", "pass": "pass", "watch": "watch", "fail": "fail"}
    found = diagnosis("uncalibrated")
    for standing, tone in tones.items():
        judged = replace(found.accuracy, standing=standing, limit="rig_file")
        summary = summarise(replace(found, accuracy=judged), texts)
        assert summary.tone == tone
        assert (summary.badge == texts("badge_uncalibrated")) == (tone == "pass")
    before, after = (Deviation(um=um, u_um=1.0, largest_um=2 * um, runs=2) for um in (9.0, 3.0))
    corrected = summarise(replace(found, accuracy=judged), texts, driven=(before, after))
    assert (corrected.badge, corrected.tone) == (texts("badge_uncalibrated"), "pass"), "limits of before the correction"
    assert summarise(replace(found, condition="undecided", accuracy=judged), texts).badge == texts("badge_undecided")


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("condition", ["named", "ambiguous"])
def test_a_fault_within_the_limits_says_that_the_accuracy_needs_no_repair(
    condition: Condition, language: Language
) -> None:
    """FAULT FOUND of 9 µm stood beside "Accuracy: PASS", with a repair to do next."""
    texts, found = texts_of(language), diagnosis(condition, acts=(REMASTER,))
    step = summarise(found, texts).next
    for standing in (None, "pass", "fail"):
        summary = summarise(replace(found, accuracy=replace(found.accuracy, standing=standing)), texts)
        within = standing == "pass"
        assert summary.badge == ", ".join([texts(f"badge_{condition}"), *[texts("badge_limits_pass")] * within])
        assert summary.headline.endswith(texts("fault_within_limits")) == within
        assert summary.next == (texts("optional_step", step=step) if within else step)
        assert (summary.standing, summary.tone) == (condition, "watch")
    passed = replace(found.accuracy, standing="pass")
    measured_first = summarise(diagnosis(condition, acts=(APART,), accuracy=passed), texts)
    assert measured_first.next == summarise(diagnosis(condition, acts=(APART,)), texts).next


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_error_after_repair_and_correction_says_what_each_gives_alone(language: Language) -> None:
    """Both together gave the figure, and the steps forbade to do both."""
    texts = texts_of(language)
    load = replace(LOAD, place="held_out", removes_um=4.0, removes_u_um=0.5, remains_um=2.3)
    first = replace(REMASTER, place="held_out", removes_um=3.0, removes_u_um=0.5, remains_um=3.4)
    second = replace(first, with_before_um=2.8)
    alone = texts("each_by_itself", corrected="2.3 µm", repaired="2.8 µm")
    assert summarise(diagnosis(acts=(load, first, second)), texts).error.basis.endswith(alone)
    assert "3.4" in summarise(diagnosis(acts=(load, first)), texts).error.basis
    plain = texts("basis_held_out")
    for acts in ((load,), (first,), (load, replace(first, removes_u_um=9.0)), (load, replace(first, place="used"))):
        assert summarise(diagnosis(acts=acts), texts).error.basis == plain


def test_an_unusual_group_is_no_plain_pass() -> None:
    """The headline "nothing unusual" contradicted a budget with an unusual part."""
    part = BudgetPart("gravity", 80.0, 2.0, 0.8, times_usual=9.0, rank="unusual")
    summary = summarise(diagnosis("nothing_unusual", budget=(part,)))
    assert (summary.badge, summary.tone) == (EN("badge_unusual_group"), "watch")
    small = replace(part, share=0.02)
    found = diagnosis("nothing_unusual", budget=(small,))
    assert summarise(found).tone == "pass" and "deflection under load, 9.0 × usual" in AnswerWords(found).headline


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("condition", CONDITIONS)
def test_every_condition_has_a_summary_in_every_language(condition: Condition, language: Language) -> None:
    found = diagnosis(condition)
    for changed in (found, replace(found, only_commanded=True)):
        summary = summarise(changed, texts_of(language))
        for text in fields(summary):
            assert text == text.strip() and not {"{", "}"} & set(text) and not re.search(r"\b(None|nan|inf)\b", text), (
                text
            )
        assert summary.headline and summary.error.now and summary.next


@pytest.mark.parametrize("condition", CONDITIONS)
def test_a_sentence_has_at_most_three_figures(condition: Condition) -> None:
    summary = summarise(diagnosis(condition, only_commanded=True))
    for text in (summary.headline, *summary.unknowns, summary.next):
        for sentence in re.split(r"(?<=[a-z°%])\. ", text):
            figures = re.findall(r"(?<![A-Za-z])(?:axis )?\d[\d.]*(?: ± \d[\d.]*)?", sentence)
            assert len([figure for figure in figures if not figure.startswith("axis")]) <= MOST_FIGURES, sentence


def test_the_headline_is_cause_size_and_certainty() -> None:
    summary = summarise(diagnosis("named"))
    assert summary.headline == "Play of axis 1 (Theta), 0.0521 ± 0.0011 °, certain."
    assert (summary.error.now, summary.error.after) == ("6.3 ± 1.9", "1.9 ± 1.9")
    assert summary.error.title == "Error now → after repair and correction"
    assert summary.error.basis == "Measured with readings that were not used to fit the model."
    assert [(cause.name, cause.percent) for cause in summary.causes] == [
        ("play of axis 1 (Theta)", "90.0 %"), ("scatter between runs and noise", "7.0 %"),
        ("geometry and zeros", "3.0 %"),
    ]  # fmt: skip
    assert summary.next.startswith("Find and repair") and summary.command == ""
    several = summarise(diagnosis("named", effects=(PLAY, PLAY, PLAY)))
    assert several.headline.endswith("certain, and 2 more.")
    usual = summarise(diagnosis("nothing_unusual", effects=(replace(PLAY, doubt="usual"),)))
    assert usual.headline.endswith("certain, normal for this arm.")


def test_effects_that_no_reading_separates_are_named_together() -> None:
    """A gauge that reads 5 % too much was called the other one, 5 % too little, certain."""
    twins = (ZERO.effect,)
    for language in LANGUAGES:
        words = AnswerWords(diagnosis("named"), texts_of(language))
        summary = summarise(diagnosis("named", effects=(replace(PLAY, twins=twins),)), texts_of(language))
        assert words.noun(twins[0]) in summary.headline and texts_of(language)("certain") not in summary.headline
    found = diagnosis("named", effects=(replace(PLAY, twins=twins),))
    noun = AnswerWords(found).noun(twins[0])
    assert noun in AnswerWords(found).headline
    assert noun in ActWords(found).what(Act("repair", "fault", effect=PLAY.effect))


@pytest.mark.parametrize(
    "effect", [GaugeBaseline(delta_mm=2.9), GaugeScale(gauge="g1", relative=0.05), ClockRate(ppm=90)]
)
def test_a_number_of_the_gauges_is_corrected_in_the_rig_file_not_at_the_controller(effect: Effect) -> None:
    """Enter at the controller: distance between the gauges, 2.93 mm."""
    found = diagnosis("named", effects=(replace(PLAY, effect=effect),))
    sentence = ActWords(found).what(Act(effect.DEED, "fault", effect=effect))
    assert "rig file" in sentence and "controller" not in sentence and "remount" not in sentence


def test_an_assumed_noise_is_no_uncertainty_of_the_error() -> None:
    """2.2 ± 14.7 µm stood above runs that nobody had repeated."""
    assumed = summarise(diagnosis("named", repeated=False, shows_noise=False)).error
    assert "±" not in assumed.words and EN("noise_assumed") in assumed.basis
    noisy = replace(diagnosis().train, noise_floor_um=24.6, calibrated_um=3.8)
    small = diagnosis(
        "undecided", repeated=False, shows_noise=False, train=noisy, effects=(replace(PLAY, doubt="usual"),)
    )
    small = replace(small, accuracy=replace(small.accuracy, place="used", calibrated_um=3.8))
    assert summarise(small).error.after == "3.8" and "3.8 µm" in AnswerWords(small).accuracy, "not < 17, by no reading"
    step = replace(LOAD, removes_um=90.0, removes_u_um=1.0, remains_um=10.0, remains_u_um=4.0)
    for repeated in (True, False):
        sentence = ActWords(diagnosis("named", repeated=repeated, shows_noise=False, acts=(step,))).sentence(step)
        assert ("± 4.0" in sentence) == repeated, "the step has the uncertainty of the tile"
    for changes in ({"repeated": True}, {"repeated": False, "shows_noise": True}):
        measured = summarise(diagnosis("named", **changes)).error  # type: ignore[arg-type]
        assert "±" in measured.now and EN("noise_assumed") not in measured.basis


def test_headline_and_causes_state_the_same_probability_and_the_share_separately() -> None:
    """A headline with "28 % likely" above a cause with 99.7 % reads as a contradiction."""
    part = BudgetPart("effect", 1.0, 0.1, 0.997, axis=2, name="joint_offset 2", index=0, odds=ZERO.probability)
    for language in LANGUAGES:
        texts = texts_of(language)
        summary = summarise(diagnosis("ambiguous", effects=(ZERO,), budget=(part,)), texts)
        probability = texts("likely", odds="62 %")
        assert f", {probability}; " in summary.headline and f"({probability})" in summary.causes[0].name
        assert summary.causes[0].percent == "99.7 %" and "%" not in texts("main_causes")
    assert "share of the error" in EN("main_causes")


def test_the_headline_names_the_largest_cause_also_if_it_is_no_fault() -> None:
    fault = replace(PLAY, contribution_um=1.0)
    budget = (
        BudgetPart("gravity", 80.0, 2.0, 0.8, times_usual=9.0, rank="unusual"),
        BudgetPart("effect", 1.0, 0.1, 0.2, axis=1, name="backlash 1", index=0, rank="unusual", odds=1.0),
    )
    found = diagnosis("named", effects=(fault,), budget=budget)
    assert (
        summarise(found).headline == "Deflection under load. Fault: play of axis 1 (Theta), 0.0521 ± 0.0011 °, certain."
    )
    swapped = (replace(budget[0], share=0.4), replace(budget[1], share=0.6))
    assert summarise(replace(found, budget=swapped)).headline.startswith("Play of axis 1")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"condition": "undecided", "effects": (replace(PLAY, doubt="usual"),)}, "too few"),
        ({"condition": "outside_library"}, "is unexplained"),
        ({"condition": "out_of_range"}, "out of range"),
        ({"condition": "not_testable_here"}, "cannot show"),
        ({"condition": "named", "only_commanded": True}, "only commanded angles"),
        ({"condition": "named", "movements": (MOVED,)}, "The base or the plate of the sockets moved"),
        ({"condition": "ambiguous", "acts": (REMASTER, APART)}, "Uncertain: "),
    ],
)
def test_what_is_unknown_comes_before_the_next_step(changes: dict[str, object], expected: str) -> None:
    found = diagnosis(**changes)  # type: ignore[arg-type]
    summary = summarise(found)
    first = " ".join((summary.headline, *summary.unknowns))
    assert expected in first and first.count(expected) == 1
    text = " ".join(shown(found).split())
    assert text.index(expected) < text.index("Do next") < text.index("Details")


def test_a_movement_comes_first_in_badge_headline_and_next_step() -> None:
    sound = diagnosis("nothing_unusual", acts=())
    moved = summarise(with_movements(sound, [MOVED], []))
    assert (moved.badge, moved.standing) == ("MOVED", "moved") and moved.headline.startswith(
        "The base or the plate of the sockets moved by 0.40 ± 0.01 mm"
    )
    assert moved.next.startswith("If all sockets are on one plate, check first")
    assert summarise(with_movements(diagnosis("named"), [MOVED], [])).badge == "MOVED, FAULT FOUND"
    assert with_movements(sound, [], []) == sound


def test_scatter_that_hides_every_error_is_undecided() -> None:
    hidden = diagnosis("nothing_unusual", unexplained=Unexplained(0.0, scatter_um=230.0))
    summary = summarise(hidden)
    assert (summary.badge, summary.standing) == ("UNDECIDED", "undecided"), "not the green of nothing unusual"


def test_with_commanded_angles_alone_a_large_cause_is_not_confirmed() -> None:
    found = diagnosis("undecided", only_commanded=True, effects=(replace(PLAY, doubt="commanded"),))
    summary = summarise(found)
    assert "certain" not in summary.headline and summary.headline.startswith(EN("finding_only_commanded"))
    assert summary.causes[0].name.endswith("(not confirmed)")


@pytest.mark.parametrize("width", [20, 30, 40, 80, 200])
def test_a_terminal_of_any_width_shows_every_letter(width: int) -> None:
    summary = summarise(diagnosis("undecided", effects=(replace(PLAY, doubt="usual"),), acts=(LOAD,)))
    console = Console(width=width, file=io.StringIO())
    with console.capture() as capture:
        for part in summary_on_screen(summary, EN):
            console.print(part)
    lines = capture.get().splitlines()
    assert max(map(len, lines)) <= width
    letters = "".join("".join(lines).split())
    for text in fields(summary):
        assert "".join(text.split()) in letters, text


def test_the_bar_has_a_segment_for_each_share() -> None:
    console = Console(width=20, file=io.StringIO())
    with console.capture() as capture:
        console.print(StackedBar(summarise(diagnosis("named")).causes))
    assert capture.get() == "█" * 18 + "▓" + "▒" + "\n"


def test_a_cause_that_may_be_imitated_is_marked() -> None:
    (first, *_) = summarise(diagnosis("outside_library", effects=(replace(PLAY, doubt="unexplained"),))).causes
    assert first.name == "play of axis 1 (Theta) (not confirmed)"


def test_small_parts_are_one_cause() -> None:
    parts = tuple(BudgetPart("curve", 1.0, 0.1, 0.2, axis=axis, rank="usual") for axis in range(1, 6))
    causes = summarise(diagnosis("nothing_unusual", budget=parts)).causes
    assert [cause.percent for cause in causes] == ["20.0 %", "20.0 %", "20.0 %", "40.0 %"]
    assert causes[-1].name == "other"
    assert summarise(diagnosis("not_testable_here")).causes == ()


def test_the_next_step_is_an_imperative_with_its_command_apart() -> None:
    for condition, acts in ACTS.items():
        for act in acts:
            assert "rig correct" not in step_of(act, diagnosis(condition), EN)
    summary = summarise(diagnosis("uncalibrated", acts=(replace(LOAD, command=("correct", "m.yaml", "-o", "D")),)))
    assert summary.command == "rig correct m.yaml -o D" and summary.next.startswith("Correct the robot:")


def test_an_error_and_its_uncertainty_have_the_same_decimals() -> None:
    assert error_size(126.08, 2.64) == "126.1 ± 2.6"
    assert error_size(126.08, 12.4) == "126 ± 12"
    assert error_size(6.84, 12.4) == "6.8 ± 12.4"
    assert error_size(2.84, 12.4) == "< 12", "as in the tables"
    assert error_size(34.2, 0.0) == "34"
    assert error_size(float("nan"), 1.0) == "–"


def test_the_error_says_where_it_was_measured_or_that_it_is_unknown() -> None:
    found = diagnosis("named")
    used = replace(found, accuracy=replace(found.accuracy, place="used"))
    assert "elsewhere is unknown" in summarise(used).error.basis
    crossed = summarise(replace(used, remains=ResidualSummary(123.0, 45.0, ()))).error.basis
    assert "123 µm" in crossed and "elsewhere is unknown" not in crossed
    judged = summarise(used, judged_elsewhere=(93.0, 1.7)).error
    assert (judged.now, judged.after) == ("93", "1.7") and "a different place" in judged.basis
    assert summarise(diagnosis("not_testable_here")).error.after == ""
    driven = (Deviation(um=93.0, largest_um=200, u_um=1.0, runs=2), Deviation(um=4.0, largest_um=9, u_um=1.0, runs=2))
    assert summarise(found, driven=driven).error.words == "93.0 ± 1.0 → 4.0 ± 1.0 µm rms"
    held = replace(found, rig=found.rig.model_copy(update={"effects": (PLAY.effect,)}))
    assert summarise(held).error.now_label == "error with the model of the rig file"


def test_a_summary_survives_the_file_of_a_session() -> None:
    found = diagnosis("undecided", effects=(replace(PLAY, doubt="usual"),))
    summary = summarise(found)
    answer = Answer(
        runs=2, condition="undecided", standing=None, headline="h", accuracy="a", next_step="n", parts=(), now_um=1,
        calibrated_um=1, noise_um=1, seconds=1, found="f", summary=summary,
        acts=(SessionAct(kind="none", why="sound", words="w"),),
    )  # fmt: skip
    assert Answer.model_validate(answer.model_dump(mode="json", exclude_defaults=True)).summary == summary


def test_a_session_that_corrected_shows_the_measured_error_and_the_step_that_is_open() -> None:
    done = SessionAct(kind="load", why="correction", words="w", step="Correct the robot.")
    still_open = SessionAct(kind="repair", why="fault", words="w", step="Repair it.", command="rig moved")
    answer = Answer(
        runs=2, condition="named", standing=None, headline="h", accuracy="a", next_step="n", parts=(), now_um=1,
        calibrated_um=1, noise_um=1, seconds=1, found="f", summary=summarise(diagnosis("named")),
        acts=(done, still_open),
    )  # fmt: skip
    session = Session.model_construct(answer=answer, judged=None, verified=None, correction=None)
    first = shown_summary(session)
    assert first and first["next"] == "Correct the robot." and first["error"]["size"] == "6.3 ± 1.9 → 1.9 ± 1.9 µm rms"
    before, after = (Deviation(um=um, largest_um=200, u_um=1.0, runs=2) for um in (93.0, 4.0))
    verified = VerifiedError(same_before=before, same_after=after)
    correction = SessionCorrection(way="programs", sentence="s", before_um=93, expected_um=4)
    corrected = shown_summary(session.model_copy(update={"verified": verified, "correction": correction}))
    assert corrected and corrected["command"] == "rig moved"
    assert corrected["next"].startswith("Repair it. Then load the original programs")
    assert corrected["error"]["size"] == "93.0 ± 1.0 → 4.0 ± 1.0 µm rms"
    assert shown_summary(session.model_copy(update={"answer": answer.model_copy(update={"summary": None})})) is None


def test_a_cause_that_is_unlikely_by_itself_is_no_headline() -> None:
    """The headline was a zero with a probability of 4 %, although its rival had 71 %."""
    (rival,) = ZERO.rivals
    other = replace(rival, effect=ZERO.effect.model_copy(update={"axis": 4}), probability=0.25)
    unlikely = replace(ZERO, probability=0.04, rivals=(other, replace(rival, probability=0.71)), doubt="usual")
    part = BudgetPart("effect", 60.0, 1.0, 0.9, index=0, rank="usual")
    found = replace(diagnosis("nothing_unusual"), effects=(unlikely,), budget=(part,))
    summary = summarise(found)
    assert summary.headline.startswith("No single cause: length a of axis 5")
    assert "(71 %)" in summary.headline and summary.headline.index("(25 %)") < summary.headline.index("(4 %)")
    assert summary.causes[0].name.startswith("length a of axis 5") and "4 %" not in summary.causes[0].name


def test_an_assumed_noise_is_no_uncertainty_of_a_driven_error() -> None:
    """A page said 107 ± 18 → < 18 µm of errors of 107 and 3 µm, because no circle was repeated."""
    before, after = (Deviation(um=um, largest_um=3 * um, u_um=0.0, runs=2) for um in (107.0, 2.9))
    error = with_driven_error(summarise(diagnosis("nothing_unusual")), before, after, EN).error
    assert (error.now, error.after) == ("107", "2.9") and error.basis.endswith(EN("noise_assumed"))
    measured = [one.model_copy(update={"u_um": 0.5}) for one in (before, after)]
    error = with_driven_error(summarise(diagnosis("nothing_unusual")), *measured, EN).error
    assert error.after == "2.9 ± 0.5" and EN("noise_assumed") not in error.basis


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_error_has_one_value_in_tile_sentence_and_table(language: Language) -> None:
    """The tile stated an error as < 17 µm, and the details of the same page as 3.8 µm."""
    texts, found = texts_of(language), diagnosis("named")
    noisy = replace(found.train, noise_floor_um=24.6, calibrated_um=3.8)
    judged = replace(found.accuracy, place="used", calibrated_um=3.8, before_there_um=90.0, now_um=90.0)
    found = replace(found, train=replace(noisy, before_um=90.0), accuracy=judged)
    error, words = summarise(found, texts).error, AnswerWords(found, texts)
    assert error.after == "< 17" and error.basis.endswith(texts("error_bounded")), "a bound has its reason"
    cells = words.gap_cells(found.train)
    assert f"{error.after} µm" in words.accuracy and cells["gap_calibrated"] == error.after
    assert error.now == "90 ± 17" and cells["gap_before"] == "90" and "90 µm" in words.accuracy
    assert texts("error_bounded") not in summarise(diagnosis("named"), texts).error.basis


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_small_undecided_part_does_not_hide_what_is_certain(language: Language) -> None:
    """The headline was an undecided 0.7 % of the error, and the certain play of 97 % was not named."""
    texts = texts_of(language)
    play = replace(PLAY, doubt="usual", probability=1.0)
    fault = replace(ZERO.rivals[0], probability=0.06, is_fault=True)
    wave = replace(SMALL, probability=0.94, rivals=(fault,))
    parts = [replace(part, share=share) for part, share in zip(budget((play, wave)), (0.97, 0.007), strict=False)]
    found = diagnosis("undecided", effects=(play, wave), budget=tuple(parts), runs_to_decide=None, acts=(APART,))
    summary, words = summarise(found, texts), AnswerWords(found, texts)
    assert summary.badge == texts("badge_no_certain_fault") and summary.tone == "unjudged"
    first, second = (summary.headline.lower().index(words.noun(one.effect).lower()) for one in (play, wave))
    assert first < second and "0.7 %" in summary.headline and words.noun(fault.effect) in summary.headline
    assert summary.headline.endswith(words.usual_or_faults) and words.usual_or_faults not in summary.unknowns
    fails = replace(found, accuracy=replace(found.accuracy, standing="fail", limit="rig_file"))
    assert summarise(fails, texts).tone == "fail" and texts("badge_limits_fail") in summarise(fails, texts).badge
    plain = found.to_dict()
    assert plain["condition"] == "undecided", "a script reads the same condition"
    large = replace(found, budget=(replace(parts[0], share=0.8), replace(parts[1], share=0.15)))
    unsure = replace(found, effects=(replace(play, probability=0.6), wave))
    scatters = replace(found, unexplained=Unexplained(0.0, scatter_um=230.0))
    for matters in (large, unsure, scatters):
        assert summarise(matters, texts).badge.startswith(texts("badge_undecided"))
    assert not summarise(large, texts).headline.lower().startswith(words.noun(play.effect).lower())
