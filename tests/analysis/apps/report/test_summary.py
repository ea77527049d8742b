"""Headline and three tiles: the same words for page, window and terminal, and the limits of the evidence first."""

import re
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from analysis.apps.report.act_words import ActWords
from analysis.apps.report.answer_words import AnswerWords
from analysis.apps.report.diagnosis_words import error_size
from analysis.apps.report.summary_words import Summary, summarise, with_driven_error
from analysis.apps.report.texts import LANGUAGES, keys_of, texts_of
from analysis.apps.session.session_state import Answer, Session, SessionAct, SessionCorrection, VerifiedError
from analysis.apps.window.frames import shown_summary
from analysis.correction.deviation import Deviation
from analysis.diagnosis.judge.acts import Act
from analysis.diagnosis.judge.budget_part import BudgetPart, GroupMember
from analysis.diagnosis.judge.residuals import Residual
from analysis.diagnosis.judge.result import Condition, Movement
from analysis.movement.between import with_movements
from rigs.effects import ThermalGrowth, TransmissionError
from tests.support.every import in_every_language
from tests.support.handmade_calibration import calibrated_model
from tests.support.handmade_diagnosis import (
    ACTS,
    APART,
    LOAD,
    PLAY,
    REMASTER,
    REPAIR,
    SMALL,
    ZERO,
    budget,
    diagnosis,
    judged,
)

EN = texts_of("en")
CONDITIONS = get_args(Condition)
DRIVEN = (Deviation(um=93.0, largest_um=200, u_um=1.0, runs=2), Deviation(um=4.0, largest_um=9, u_um=1.0, runs=2))
MOVED = Movement("a", "b", "base", 0.999, translation_mm=np.array([0.4, 0.0, 0.0]), u_mm=0.01, alike="plate")


MANY = BudgetPart("constants", 80.0, 2.0, 0.8, times_usual=1.0, rank="usual")
USUAL = diagnosis("uncalibrated", effects=(replace(PLAY, doubt="usual"),), acts=(LOAD,))


def fields(summary: Summary) -> list[str]:
    """Every text of a summary, except empty ones."""
    error = summary.error
    texts = [summary.badge, summary.headline, *summary.unknowns, error.title, error.words, error.basis, error.standing]
    texts += [text for cause in summary.causes for text in (cause.name, cause.percent)]
    return list(filter(None, [*texts, summary.next, summary.command]))


def test_first_line_without_a_fault_is_green_only_within_the_limits():
    tones = {None: "pass", "pass": "pass", "watch": "watch", "fail": "fail"}
    found = diagnosis("uncalibrated")
    for standing, tone in tones.items():
        found = judged(found, standing=standing, limit="rig_file")
        assert summarise(found).tone == tone
    assert with_driven_error(summarise(found), *DRIVEN, EN).tone == "pass"
    assert summarise(replace(found, condition="undecided")).tone == "unjudged"


@pytest.mark.parametrize("condition", ["named", "ambiguous"])
def test_a_fault_within_the_limits_needs_no_repair(condition):
    found = diagnosis(condition, acts=(REMASTER,))
    for standing in (None, "pass", "fail"):
        summary = summarise(judged(found, standing=standing))
        is_within = standing == "pass"
        for text, key in (
            (summary.headline, "fault_within_limits"),
            (summary.headline, "do_nothing_necessary"),
            (summary.next, "optional_step"),
        ):
            assert (key in keys_of(text)) == is_within
        assert (summary.standing, summary.tone) == (condition, "watch")
    measured_first = diagnosis(condition, acts=(APART,))
    assert summarise(judged(measured_first, standing="pass")).next == summarise(measured_first).next


@in_every_language
def test_error_after_repair_and_correction_is_given_for_each_alone(language):
    """The figure assumed both steps, although the text forbade to combine them."""
    texts = texts_of(language)
    load = replace(LOAD, place="held_out", removes_um=4.0, removes_u_um=0.5, remains_um=2.3)
    first = replace(REMASTER, place="held_out", removes_um=3.0, removes_u_um=0.5, remains_um=3.4)
    second = replace(first, with_before_um=2.8)
    alone = texts("each_by_itself", corrected="2.3 µm", repaired="2.8 µm")
    assert summarise(diagnosis(acts=(load, first, second)), texts).error.basis.endswith(alone)
    assert "3.4" in summarise(diagnosis(acts=(load, first)), texts).error.basis
    cancelling = replace(second, removes_um=-2.0, with_before_um=0.3)
    alone = texts("each_by_itself", corrected="2.3 µm", repaired="0.3 µm")
    assert summarise(diagnosis(acts=(load, first, second, cancelling)), texts).error.basis.endswith(alone)
    plain = texts("basis_held_out")
    for acts in ((load,), (first,), (load, replace(first, removes_u_um=9.0)), (load, replace(first, place="used"))):
        assert summarise(diagnosis(acts=acts), texts).error.basis == plain


def test_an_unusual_group_is_no_plain_pass():
    """The headline "nothing unusual" contradicted a budget with an unusual part."""
    part = BudgetPart("gravity", 80.0, 2.0, 0.8, times_usual=9.0, rank="unusual")
    summary = summarise(diagnosis("nothing_unusual", budget=(part,)))
    assert (keys_of(summary.badge), summary.tone) == (("badge_unusual_group",), "watch")
    usual = BudgetPart("constants", 60.0, 2.0, 0.5, rank="usual", members=(GroupMember(ZERO.effect, 50.0, 0.3),))
    headline = summarise(diagnosis("nothing_unusual", budget=(usual, replace(part, share=0.4)))).headline
    assert headline.startswith(AnswerWords(diagnosis("nothing_unusual", budget=(usual, part))).condition_sentence[:-1])
    small = replace(part, share=0.02)
    found = diagnosis("nothing_unusual", budget=(small,))
    assert summarise(found).tone == "pass" and "finding_unusual_group" in keys_of(AnswerWords(found).condition_sentence)


@pytest.mark.parametrize(
    ("u_um", "badge", "keys"), [(148.0, "badge_cause_open", ("size_uncertain",)), (30.0, "badge_cause_found", ())]
)
def test_a_likely_cause_that_is_not_certain_says_that_its_size_is_uncertain(u_um, badge, keys):
    """The badge read "CAUSE NOT CERTAIN", and the sentence only "probability > 99.9 %"."""
    member = GroupMember(ZERO.effect, 600.0, 0.9995, 30.0)
    part = BudgetPart("curve", 618.0, u_um, 0.8, axis=3, rank="usual", members=(member,))
    summary = summarise(diagnosis("nothing_unusual", budget=(part,)))
    assert keys_of(summary.badge) == (badge,) and "probable_member" in keys_of(summary.headline)
    assert tuple(key for key in keys_of(summary.headline) if key == "size_uncertain") == keys
    assert ("618 ± 148 µm" in summary.headline) == bool(keys)


def test_certain_member_with_a_small_share_of_its_group_is_not_the_cause():
    member = GroupMember(ZERO.effect, 58.0, 0.9995, 5.0, share=0.08)
    part = BudgetPart("constants", 661.0, 32.0, 0.94, rank="usual", members=(member,))
    found = diagnosis("nothing_unusual", budget=(part,))
    assert keys_of(summarise(found).badge) != ("badge_cause_found",)
    assert AnswerWords(found).noun(ZERO.effect) not in summarise(found).headline
    assert AnswerWords(found).likely_members(part) == ""


@pytest.mark.parametrize(("standing", "key"), [(None, "act_none_sound"), ("pass", "act_none_sound_within")])
def test_only_an_error_that_was_judged_is_within_the_limits(standing, key):
    found = diagnosis("nothing_unusual", acts=(Act("none", "sound", (0,)),))
    assert key in keys_of(summarise(judged(found, standing=standing)).next)


@pytest.mark.parametrize("doubt", ["unexplained", "commanded"])
def test_a_probable_effect_that_another_cause_may_imitate_says_so(doubt):
    named = replace(PLAY, doubt=doubt, probability=0.9995)
    summary = summarise(diagnosis("nothing_unusual", effects=(named,)))
    assert keys_of(summary.badge) == ("badge_cause_open",)
    assert {"not_confirmed_because", f"doubt_{doubt}"} <= set(keys_of(summary.headline))
    assert EN("not_confirmed") in summary.causes[0].name


@in_every_language
@pytest.mark.parametrize("condition", CONDITIONS)
def test_every_condition_has_a_summary_in_every_language(condition, language):
    found = diagnosis(condition)
    for changed in (found, replace(found, only_commanded=True)):
        summary = summarise(changed, texts_of(language))
        for text in fields(summary):
            assert text == text.strip() and not {"{", "}"} & set(text) and not re.search(r"\b(None|nan|inf)\b", text), (
                text
            )
        assert summary.headline and summary.error.now and summary.next


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (diagnosis("named"), ("cause_found", "size_fault", "do_now_repair_axis")),
        (diagnosis("named", acts=(LOAD,)), ("cause_found", "size_fault", "do_now_load_first")),
        (diagnosis("ambiguous", effects=(ZERO,), acts=(LOAD,)), ("cause_open", "likely", "do_now_load_fault")),
        (diagnosis("undecided", acts=(LOAD,)), ("undecided", "finding_undecided", "do_now_load_open")),
        (diagnosis("outside_library", acts=(LOAD,)), ("outside_library", "finding_unexplained", "do_now_load_rest")),
        (diagnosis("ambiguous", effects=(ZERO,)), ("cause_open", "likely", "do_now_measure")),
        (USUAL, ("cause_found", "size_usual", "do_now_load")),
        (replace(USUAL, condition="nothing_unusual"), ("cause_found", "size_usual", "do_now_load")),
        (diagnosis("uncalibrated", budget=(MANY,), acts=(LOAD,)), ("uncalibrated", "size_usual", "do_now_load")),
        (diagnosis("nothing_unusual"), ("sound", "finding_nothing_unusual", "do_now_none")),
        (diagnosis("outside_library"), ("outside_library", "finding_unexplained", "do_now_unexplained")),
        (diagnosis("out_of_range"), ("out_of_range", "finding_out_of_range", "do_now_check")),
        (diagnosis("undecided"), ("undecided", "finding_undecided", "do_now_few_runs")),
        (diagnosis("not_testable_here"), ("not_testable_here", "finding_not_testable_here", "do_now_measure")),
        (with_movements(diagnosis("nothing_unusual"), [MOVED], []), ("moved", "moved_between", "do_now_moved")),
    ],
)
def test_the_first_line_says_whether_the_cause_is_known_its_class_and_the_act(found, expected):
    summary = summarise(found)
    assert keys_of(summary.badge) == (f"badge_{expected[0]}",)
    keys = [key for key in keys_of(summary.headline) if key in expected]
    assert keys == list(expected[1:])
    first, _, _ = summary.headline.partition(f"{summary.action}.")
    assert first.endswith("; ")


def test_the_label_of_the_later_error_names_only_the_acts_of_the_list():
    """A mounting without a gain is no act of the list, and reaching targets from one side is no repair."""
    load = replace(LOAD, removes_um=4.0, removes_u_um=0.5, remains_um=2.3)
    idle = Act("mount", "fault", effect=PLAY.effect, removes_um=0.1, removes_u_um=0.01, remains_um=6.2)
    for acts, key in (
        ((load, idle), "error_after_correction"),
        ((load, replace(load, kind="approach")), "error_after_correction"),
        ((load, replace(load, kind="repair")), "error_after_correction_repair"),
    ):
        assert keys_of(summarise(diagnosis(acts=acts)).error.after_label) == (key,)


def test_a_correction_that_compensates_all_faults_is_the_only_act_of_the_tile():
    """A zero can be entered or corrected, but play cannot, so its repair belongs to the later error."""
    acts = (replace(LOAD, remains_um=2.7, remains_u_um=0.4), REMASTER)
    alone = summarise(diagnosis("ambiguous", effects=(ZERO,), acts=acts)).error
    assert keys_of(alone.after_label) == ("error_after_correction",) and alone.after == "2.7 ± 0.4"
    both = summarise(diagnosis("named", effects=(PLAY,), acts=acts)).error
    assert keys_of(both.after_label) == ("error_after_correction_repair",) and both.after != alone.after


@pytest.mark.parametrize("share", [1.0, 0.99])
def test_an_error_that_no_act_certainly_reduces_is_stated_once(share):
    found = diagnosis(acts=(REMASTER,))
    assert summarise(found).error.after
    error = summarise(judged(found, calibrated_um=share * found.accuracy.before_there_um)).error
    assert error.after == "" and "→" not in error.words + error.title


def test_effects_that_no_reading_separates_are_named_together():
    """A gauge that reads 5 % too much was called the other one, 5 % too little, certain."""
    twins = (ZERO.effect,)
    for language in LANGUAGES:
        words = AnswerWords(diagnosis("named"), texts_of(language))
        summary = summarise(diagnosis("named", effects=(replace(PLAY, twins=twins),)), texts_of(language))
        assert words.noun(twins[0]) in summary.headline and keys_of(summary.badge) == ("badge_cause_found",)
    found = diagnosis("named", effects=(replace(PLAY, twins=twins),))
    assert AnswerWords(found).noun(twins[0]) in ActWords(found).what(Act("repair", "fault", effect=PLAY.effect))


def test_an_assumed_noise_is_no_uncertainty_of_the_error():
    """2.2 ± 14.7 µm stood above runs that nobody had repeated."""
    assumed = summarise(diagnosis("named", repeated=False, shows_noise=False)).error
    assert "±" not in assumed.words and EN("noise_assumed") in assumed.basis
    noisy = replace(diagnosis().train, noise_floor_um=24.6, calibrated_um=3.8)
    small = diagnosis(
        "undecided", repeated=False, shows_noise=False, train=noisy, effects=(replace(PLAY, doubt="usual"),)
    )
    small = judged(small, place="used", calibrated_um=3.8)
    assert AnswerWords(small).gap_cells(small.train)["gap_calibrated"] == "3.8"
    step = replace(LOAD, removes_um=90.0, removes_u_um=1.0, remains_um=10.0, remains_u_um=4.0)
    for repeated in (True, False):
        sentence = ActWords(diagnosis("named", repeated=repeated, shows_noise=False, acts=(step,))).sentence(step)
        assert ("± 4.0" in sentence) == repeated
    for changes in ({"repeated": True}, {"repeated": False, "shows_noise": True}):
        measured = summarise(diagnosis("named", **changes)).error
        assert "±" in measured.now and EN("noise_assumed") not in measured.basis


def test_headline_and_causes_state_the_same_probability_and_the_share_separately():
    """A headline with "28 % likely" above a cause with 99.7 % reads as a contradiction."""
    part = BudgetPart("effect", 1.0, 0.1, 0.997, axis=2, name="joint_offset 2", index=0, odds=ZERO.probability)
    for language in LANGUAGES:
        texts = texts_of(language)
        summary = summarise(diagnosis("ambiguous", effects=(ZERO,), budget=(part,)), texts)
        probability = texts("likely", odds="62 %")
        assert probability in summary.headline and f"({probability})" in summary.causes[0].name
        assert summary.causes[0].percent == "99.7 %"


def test_the_headline_names_the_largest_cause_also_if_it_is_no_fault():
    fault = replace(PLAY, contribution_um=1.0)
    budget = (
        BudgetPart("gravity", 80.0, 2.0, 0.8, times_usual=9.0, rank="unusual"),
        BudgetPart("effect", 1.0, 0.1, 0.2, axis=1, name="backlash 1", index=0, rank="unusual", odds=1.0),
    )
    found = diagnosis("named", effects=(fault,), budget=budget)
    keys = keys_of(summarise(found).headline)
    assert keys.index("part_gravity") < keys.index("also_a_fault") or keys[0] == "also_a_fault"
    swapped = (replace(budget[0], share=0.4), replace(budget[1], share=0.6))
    assert "also_a_fault" not in keys_of(summarise(replace(found, budget=swapped)).headline)


def test_corrected_robot_needs_nothing_and_lists_the_other_way_with_its_error():
    """A corrected robot with an error of 2.9 µm was to be re-mastered, which left 46.5 µm."""
    master = SessionAct(kind="remaster", why="fault", words="w", corrected="c", step="B.", remains_um=46.5)
    done = SessionAct(kind="load", why="correction", words="w", step="A.", remains_um=3.0)
    answer = answered(summarise(diagnosis("named")), done, master)
    before, after = (Deviation(um=um, largest_um=200, u_um=0.1, runs=2) for um in (93.0, 2.9))
    correction = SessionCorrection(way="programs", sentence="s", before_um=93, expected_um=4)
    for standing, key in (("pass", "act_none_corrected"), ("fail", "act_none_corrected_fail")):
        verified = VerifiedError(same_before=before, same_after=after, standing=standing)
        session = Session.model_construct(answer=answer, judged=None, verified=verified, correction=correction)
        assert keys_of(session.summary.next) == (key,)
        assert (session.to_do, session.instead) == ((), ("c",))


@in_every_language
def test_size_that_is_not_determined_is_not_stated(language):
    """Order and amplitude of a wave trade over a small range, but its change of the readings is certain."""
    texts = texts_of(language)
    gear = TransmissionError(axis=1, order=1.5, amplitude_deg=0.05)
    wave = replace(PLAY, effect=gear, sd={"amplitude_deg": 0.04}, contribution_um=68.0, u_um=2.0, doubt="unsure")
    growth = replace(PLAY, effect=ThermalGrowth(ppm=100.0), sd={"ppm": 10.0}, contribution_um=2.0)
    parts = [replace(part, share=share) for part, share in zip(budget((wave, growth)), (0.95, 0.006), strict=False)]
    summary = summarise(diagnosis("named", effects=(growth, wave), budget=_numbered(parts, (1, 0))), texts)
    assert keys_of(summary.badge) == ("badge_cause_found",)
    keys = keys_of(summary.headline)
    assert keys.index("smooth_error") < keys.index("size_fault") and "68.0 ± 2.0 µm" in summary.headline


def _numbered(parts, indices):
    return tuple(replace(part, index=index) for part, index in zip(parts, indices, strict=True))


@pytest.mark.parametrize(("healthy", "badge"), [(0.75, "badge_cause_found"), (0.2, "badge_cause_open")])
def test_certain_part_leads_although_its_name_is_open(healthy, badge):
    """The headline was CAUSE NOT CERTAIN, probability 24 %, about a zero of 50 sigma with 80 % of the error."""
    zero = replace(ZERO, rivals=(), probability=0.24, doubt="usual", alternatives={"healthy": healthy})
    part = BudgetPart("effect", 95.0, 1.9, 0.8, axis=5, index=0, rank="usual", odds=0.24)
    summary = summarise(diagnosis("nothing_unusual", effects=(zero,), budget=(part,)))
    assert keys_of(summary.badge) == (badge,)
    assert ("possible_member" in keys_of(summary.headline)) == (badge == "badge_cause_found")


@pytest.mark.parametrize(("rival", "leads"), [(0.36, True), (0.1, False)])
def test_small_fault_does_not_lead_over_a_large_part_of_which_the_name_is_open(rival, leads):
    """The growth of the ball link, 0.3 % of the error, led over a gear error of axis 1 or a reversal error, 93 %."""
    open_cause = replace(
        ZERO, doubt="usual", rivals=(replace(ZERO.rivals[0], probability=rival),), alternatives={"healthy": 0.02}
    )
    large = BudgetPart("effect", 5.1, 3.0, 0.93, axis=5, name="joint_offset 5", index=1, rank="undecided", odds=0.62)
    small = BudgetPart("effect", 0.3, 0.05, 0.003, axis=1, name="backlash 1", index=0, rank="unusual", odds=1.0)
    found = diagnosis("named", effects=(PLAY, open_cause), budget=(large, small))
    summary = summarise(found)
    assert keys_of(summary.badge) == ("badge_cause_open" if leads else "badge_cause_found",)
    assert ("also_a_fault" in keys_of(summary.headline)) == leads


@pytest.mark.parametrize(("um", "badge"), [(1.0, "badge_cause_found"), (3.0, "badge_outside_library")])
def test_cause_leads_if_it_explains_much_more_than_remains_unexplained(um, badge):
    model = calibrated_model(judged=None)
    residual = Residual(um, 0.06, is_material=True)
    found = diagnosis("outside_library", effects=(PLAY,), residual=residual, calibrated=model, acts=(REPAIR,))
    summary = summarise(found)
    assert keys_of(summary.badge) == (badge,)
    assert ("size_fault" in keys_of(summary.headline)) == (badge == "badge_cause_found")


def test_a_movement_comes_first_in_badge_headline_and_next_step():
    sound = diagnosis("nothing_unusual", acts=())
    for found in (sound, diagnosis("named")):
        moved = summarise(with_movements(found, [MOVED], []))
        assert keys_of(moved.badge) == ("badge_moved",) and moved.standing == "moved"
        assert keys_of(moved.headline)[0] == "moved_between"
        assert "check_act_base_or_plate" in keys_of(moved.next)
    assert with_movements(sound, [], []) == sound


def test_with_commanded_angles_alone_a_large_cause_is_not_confirmed():
    found = diagnosis("undecided", only_commanded=True, effects=(replace(PLAY, doubt="commanded"),))
    assert keys_of(summarise(found).headline)[0] == "finding_only_commanded"


def test_small_parts_are_one_cause():
    parts = tuple(BudgetPart("curve", 1.0, 0.1, 0.2, axis=axis, rank="usual") for axis in range(1, 6))
    causes = summarise(diagnosis("nothing_unusual", budget=parts)).causes
    assert [cause.percent for cause in causes] == ["20.0 %", "20.0 %", "20.0 %", "40.0 %"]
    assert keys_of(causes[-1].name) == ("other_causes",)
    assert summarise(diagnosis("not_testable_here")).causes == ()


def test_the_next_step_is_an_imperative_with_its_command_apart():
    for condition, acts in ACTS.items():
        for act in acts:
            assert "rig correct" not in ActWords(diagnosis(condition), EN).imperative(act)
    summary = summarise(diagnosis("uncalibrated", acts=(replace(LOAD, command=("correct", "m.yaml", "-o", "D")),)))
    assert summary.command == "rig correct m.yaml -o D" and keys_of(summary.next)[0].startswith("do_load")


def test_an_error_and_its_uncertainty_have_the_same_decimals():
    assert error_size(126.08, 2.64) == "126.1 ± 2.6"
    assert error_size(126.08, 12.4) == "126 ± 12"
    assert error_size(6.84, 12.4) == "6.8 ± 12.4"
    assert error_size(2.84, 12.4) == "< 12"
    assert error_size(34.2, 0.0) == "34"
    assert error_size(float("nan"), 1.0) == "–"


def test_error_names_its_region_or_is_unknown():
    found = diagnosis("named")
    used = judged(found, place="used")
    assert keys_of(summarise(used).error.basis)[0] == "basis_used"
    predicted = replace(used, accuracy=replace(used.accuracy, left_out_um=4.5, left_out_u_um=0.4))
    left_out = summarise(predicted).error
    assert (keys_of(left_out.basis)[0], left_out.after) == ("basis_left_out", "4.5 ± 0.4")
    smaller = replace(used, accuracy=replace(used.accuracy, left_out_um=0.5, left_out_u_um=0.1))
    assert summarise(smaller).error.after == summarise(used).error.after
    assert summarise(diagnosis("not_testable_here")).error.after == ""
    assert with_driven_error(summarise(found), *DRIVEN, EN).error.words == "93.0 ± 1.0 → 4.0 ± 1.0 µm rms"
    held = replace(found, rig=found.rig.model_copy(update={"effects": (PLAY.effect,)}))
    assert keys_of(summarise(held).error.now_label) == ("error_left_by_model",)


def answered(summary: Summary, *acts: SessionAct) -> Answer:
    return Answer(
        runs=2, condition="named", standing=None, headline="h", accuracy="a", next_step="n", parts=(), now_um=1,
        calibrated_um=1, noise_um=1, seconds=1, found="f", summary=summary, acts=acts,
    )  # fmt: skip


def test_a_summary_survives_the_file_of_a_session():
    summary = summarise(diagnosis("undecided", effects=(replace(PLAY, doubt="usual"),)))
    answer = answered(summary, SessionAct(kind="none", why="sound", words="w"))
    assert Answer.model_validate(answer.model_dump(mode="json", exclude_defaults=True)).summary == summary


def test_a_session_that_corrected_shows_the_measured_error_and_the_step_that_is_open():
    done = SessionAct(kind="load", why="correction", words="w", step="A.", action="a")
    still_open = SessionAct(kind="repair", why="fault", words="w", step="B.", action="b", command="rig moved")
    answer = answered(summarise(diagnosis("named")), done, still_open)
    session = Session.model_construct(answer=answer, judged=None, verified=None, correction=None)
    first = shown_summary(session)
    assert first["next"] == "A." and first["error"]["size"] == "6.3 ± 1.9 → 1.9 ± 1.9 µm rms"
    before, after = (Deviation(um=um, largest_um=200, u_um=1.0, runs=2) for um in (93.0, 4.0))
    verified = VerifiedError(same_before=before, same_after=after)
    correction = SessionCorrection(way="programs", sentence="s", before_um=93, expected_um=4)
    verified_session = session.model_copy(update={"verified": verified, "correction": correction})
    assert [(side.place, side.before, side.after) for side in verified_session.sides] == [("same", before, after)]
    both = verified.model_copy(update={"elsewhere_before": before})
    other = session.model_copy(update={"verified": both, "correction": correction}).sides[-1]
    assert (other.place, other.before, other.after) == ("elsewhere", before, None)
    corrected = shown_summary(verified_session)
    assert corrected["next"] == EN("act_none_corrected") and corrected["command"] == ""
    assert f"; {EN('do_now_none')}." in corrected["headline"]
    assert corrected["error"]["size"] == "93.0 ± 1.0 → 4.0 ± 1.0 µm rms"
    fails = verified.model_copy(update={"standing": "fail"})
    failing = shown_summary(verified_session.model_copy(update={"verified": fails}))
    assert failing["command"] == "rig moved"
    assert failing["next"] == f"B. {EN('then_without_programs')}" and "; b." in failing["headline"]
    assert shown_summary(session.model_copy(update={"answer": answer.model_copy(update={"summary": None})})) is None


def test_a_cause_that_is_unlikely_by_itself_is_no_headline():
    """The headline was a zero with a probability of 4 %, although its rival had 71 %."""
    (rival,) = ZERO.rivals
    other = replace(rival, effect=ZERO.effect.model_copy(update={"axis": 4}), probability=0.25)
    unlikely = replace(ZERO, probability=0.04, rivals=(other, replace(rival, probability=0.71)), doubt="usual")
    part = BudgetPart("effect", 60.0, 1.0, 0.9, index=0, rank="usual")
    found = replace(diagnosis("nothing_unusual"), effects=(unlikely,), budget=(part,))
    summary = summarise(found)
    assert keys_of(summary.headline)[0] == "one_of"
    assert "(71 %)" in summary.headline and summary.headline.index("(25 %)") < summary.headline.index("(4 %)")
    assert summary.causes[0].name.startswith("length a of axis 5") and "4 %" not in summary.causes[0].name


def test_an_assumed_noise_is_no_uncertainty_of_a_driven_error():
    """A page said 107 ± 18 → < 18 µm of errors of 107 and 3 µm, because no circle was repeated."""
    before, after = (Deviation(um=um, largest_um=3 * um, u_um=0.0, runs=2) for um in (107.0, 2.9))
    error = with_driven_error(summarise(diagnosis("nothing_unusual")), before, after, EN).error
    assert (error.now, error.after) == ("107", "2.9") and error.basis.endswith(EN("noise_assumed"))
    measured = [one.model_copy(update={"u_um": 0.5}) for one in (before, after)]
    error = with_driven_error(summarise(diagnosis("nothing_unusual")), *measured, EN).error
    assert error.after == "2.9 ± 0.5" and EN("noise_assumed") not in error.basis


@in_every_language
def test_an_error_has_one_value_in_tile_sentence_and_table(language):
    """The tile stated an error as < 17 µm, and the details of the same page as 3.8 µm."""
    texts, found = texts_of(language), diagnosis("named")
    noisy = replace(found.train, noise_floor_um=24.6, calibrated_um=3.8)
    found = replace(found, train=replace(noisy, before_um=90.0))
    found = judged(found, place="used", calibrated_um=3.8, before_there_um=90.0, now_um=90.0)
    error, words = summarise(found, texts).error, AnswerWords(found, texts)
    assert error.after == "< 17" and error.basis.endswith(texts("error_bounded"))
    cells = words.gap_cells(found.train)
    assert cells["gap_calibrated"] == error.after
    assert error.now == "90 ± 17" and cells["gap_before"] == "90" and "90 µm" in words.accuracy
    assert texts("error_bounded") not in summarise(diagnosis("named"), texts).error.basis


@in_every_language
def test_small_undecided_part_does_not_hide_certain_ones(language):
    """The headline was an undecided 0.7 % of the error, and the certain play of 97 % was not named."""
    texts = texts_of(language)
    play = replace(PLAY, doubt="usual", probability=1.0)
    fault = replace(ZERO.rivals[0], probability=0.06, is_fault=True)
    wave = replace(SMALL, probability=0.94, rivals=(fault,))
    parts = [replace(part, share=share) for part, share in zip(budget((play, wave)), (0.97, 0.007), strict=False)]
    found = diagnosis("undecided", effects=(play, wave), budget=tuple(parts), runs_to_decide=None, acts=(APART,))
    summary, words = summarise(found, texts), AnswerWords(found, texts)
    assert keys_of(summary.badge) == ("badge_cause_found",) and summary.tone == "unjudged"
    first, second = (summary.headline.lower().index(words.noun(one.effect).lower()) for one in (play, wave))
    assert first < second and "0.7 %" in summary.headline and words.noun(fault.effect) in summary.headline
    assert summary.headline.endswith(words.usual_or_faults) and words.usual_or_faults not in summary.unknowns
    assert summarise(judged(found, standing="fail", limit="rig_file"), texts).tone == "fail"
    plain = found.to_dict()
    assert plain["condition"] == "undecided"
    large = replace(found, budget=(replace(parts[0], share=0.8), replace(parts[1], share=0.15)))
    unsure = replace(found, effects=(replace(play, probability=0.6), wave))
    scatters = replace(found, residual=Residual(0.0, scatter_um=230.0))
    for matters in (large, unsure, scatters):
        assert keys_of(summarise(matters, texts).badge) == ("badge_undecided",)
    assert not summarise(large, texts).headline.lower().startswith(words.noun(play.effect).lower())
