"""Calibration on simulated runs: what was planted comes out, within its uncertainty, whatever its bounds and phase."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.inference.calibrate import calibrate, parse_effects
from analysis.inference.observation import Observation, observe
from analysis.model.predict import model_of
from analysis.simulation.simulate import simulate
from rigs.effects import (
    VOCABULARY,
    Backlash,
    Effect,
    JointOffset,
    ReversalSpike,
    ThermalGrowth,
    TransmissionError,
    healthy_size,
    size_field,
)
from rigs.errors import FileError, UseError
from rigs.load import load
from tests.support.nightly import cases

RIG = load("paper-fanuc")[0].model_copy(update={"effects": ()})
MODEL = model_of(RIG)


def _observed(truth: tuple[Effect, ...], seed: int, tests: tuple[str, ...] = ("yaw",)) -> list[Observation]:
    found = []
    for number, test in enumerate(tests):
        for k, direction in enumerate(("acw", "cw") if test in ("yaw", "roll") else (None,)):
            table = simulate(RIG, test, direction, 10 * seed + 2 * number + k, truth)  # type: ignore[arg-type]
            observations = observe(MODEL, table, test)
            found.append(observations)
    return found


@pytest.mark.parametrize(
    ("truth", "words", "tests"),
    [
        (Backlash(axis=1, width_deg=0.02), "backlash:1", ("yaw",)),
        (Backlash(axis=1, width_deg=0.02), "backlash:1", ("repeatability",)),
        (JointOffset(axis=5, offset_deg=-0.1), "joint_offset:5", ("radial",)),
        (ReversalSpike(axis=1, amplitude_deg=-0.03), "reversal_spike:1", ("yaw",)),
    ],
    ids=lambda value: getattr(value, "effect", value),
)
def test_what_was_planted_comes_out(truth: Effect, words: str, tests: tuple[str, ...]) -> None:
    found = calibrate(RIG, _observed((truth,), 1, tests), [], words)
    (fitted,) = found.effects
    field = size_field(truth)
    off = getattr(fitted.effect, field) - getattr(truth, field)
    assert abs(off) < 4 * fitted.sd[field] and abs(off) < 0.1 * abs(getattr(truth, field))
    assert found.after_mm[0] < 0.2 * found.before_mm[0]


def test_a_size_that_ends_at_the_bound_of_a_rig_file_is_reported() -> None:
    """With a time constant of 600 s nothing a rig file allows grows as fast as 300 ppm with 60 s."""
    truth = ThermalGrowth(ppm=300, time_constant_s=60)
    found = calibrate(RIG, _observed((truth,), 1), [], "thermal_growth")
    assert found.doubts[0].startswith("thermal_growth ends at the limit of a rig file, 2000 ppm: the robot may err by")
    within = calibrate(RIG, _observed((JointOffset(axis=5, offset_deg=-0.1),), 1, ("radial",)), [], "joint_offset:5")
    assert not any("limit of a rig file" in doubt for doubt in within.doubts)


def test_a_shape_that_was_not_given_is_reported_as_held() -> None:
    found = calibrate(RIG, _observed((ReversalSpike(axis=1, amplitude_deg=-0.03),), 1), [], "reversal_spike:1")
    assert any(doubt.startswith("reversal_spike 1: its decay_s was held at 0.3") for doubt in found.doubts)
    given = calibrate(RIG, _observed((Backlash(axis=1, width_deg=0.02),), 1), [], "backlash:1")
    assert not any("was held" in doubt for doubt in given.doubts)


def test_a_ball_far_from_its_place_is_no_effect() -> None:
    assert RIG.tests.circle
    circle = RIG.tests.circle.model_copy(update={"eccentricity_mm": (3.0, -4.0, 2.0)})
    rig = RIG.model_copy(update={"tests": RIG.tests.model_copy(update={"circle": circle})})
    observations = [observe(MODEL, simulate(rig, "yaw", way, None), "yaw") for way in ("cw", "acw")]
    found = calibrate(RIG, observations, [], "joint_offset:3,backlash:1")
    assert max(found.before_mm[0], found.after_mm[0]) < 1e-4
    for fitted in found.effects:
        assert abs(getattr(fitted.effect, size_field(fitted.effect))) < 1e-4


@pytest.mark.parametrize("phase", cases((20.0, 110.0, 200.0, 290.0), (20.0, 290.0)))
def test_a_gear_error_of_any_phase_is_one_wave(phase: float) -> None:
    truth = TransmissionError(axis=2, order=2, amplitude_deg=0.05, phase_deg=phase)
    found = calibrate(RIG, _observed((truth,), 2, ("yaw", "roll")), [], "transmission_error:2:2")
    (fitted,) = found.effects
    assert fitted.effect.amplitude_deg == pytest.approx(0.05, abs=4 * fitted.sd["amplitude_deg"])  # type: ignore[union-attr]
    turned = (fitted.effect.phase_deg - phase + 180) % 360 - 180  # type: ignore[union-attr]
    assert abs(turned) < 4 * fitted.sd["phase_deg"] < 20


@pytest.mark.parametrize("count", cases((4, 12), (4,)))
def test_uncertainties_cover_the_wander_and_the_scatter_of_runs(count: int) -> None:
    """Nothing planted: over many pairs of runs the fitted offset is about as far from zero as its uncertainty says."""
    away = []
    for seed in range(count):
        found = calibrate(RIG, [*_observed((), 100 + seed), *_observed((), 200 + seed)], [], "joint_offset:3")
        assert found.scatter.source == "measured"
        (fitted,) = found.effects
        away.append(fitted.effect.offset_deg / fitted.sd["offset_deg"])  # type: ignore[union-attr]
    assert 0.3 < np.sqrt(np.mean(np.square(away))) < 1.8, away


def test_the_scatter_of_a_run_without_repeats_is_assumed_wide_and_reported_as_assumed() -> None:
    known = calibrate(RIG, [*_observed((), 100), *_observed((), 200)], [], "joint_offset:3")
    assumed = calibrate(RIG, _observed((), 100), [], "joint_offset:3")
    assert assumed.scatter.source == "assumed"
    assert assumed.covariance[0, 0] > 4 * known.covariance[0, 0]


@pytest.mark.parametrize(("truth", "words", "tests"), [
    (JointOffset(axis=5, offset_deg=-0.1), "joint_offset:5", ("radial",)),
    (Backlash(axis=1, width_deg=0.02), "backlash:1", ("yaw",)),
], ids=["radial", "yaw"])  # fmt: skip
def test_wild_readings_are_counted_and_change_little(truth: Effect, words: str, tests: tuple[str, ...]) -> None:
    rng = np.random.default_rng(7)
    sound = _observed((truth,), 1, tests)
    spoilt, count = [], 0
    for one in sound:
        values = one.values.copy()
        rows = rng.permutation(np.arange(10, len(values) - 10))[: max(2, len(values) // 100)]
        values[rows] += rng.choice([-1.0, 1.0], (len(rows), 1)) * rng.uniform(0.1, 1.0, (len(rows), 1))
        spoilt.append(replace(one, values=values))
        count += len(rows)
    (clean,), found = calibrate(RIG, sound, [], words).effects, calibrate(RIG, spoilt, [], words)
    (fitted,) = found.effects
    field = size_field(truth)
    assert 0.8 * count <= sum(found.weighting.wild) <= 1.5 * count
    assert abs(getattr(fitted.effect, field) - getattr(clean.effect, field)) < clean.sd[field]
    assert "are wild and left out" in found.doubts[0]


def test_a_run_of_another_test_judges_with_its_own_set_up() -> None:
    truth = (Backlash(axis=1, width_deg=0.03),)
    found = calibrate(RIG, _observed(truth, 3), _observed(truth, 4, ("radial",)), "backlash:1")
    assert found.after_mm[1] < 0.3 * found.before_mm[1]


def test_readings_that_the_set_up_takes_up_alone_are_reported() -> None:
    (whole,) = _observed((), 5, ("repeatability",))
    few = replace(whole, rows=whole.rows[:4], values=whole.values[:4])
    with pytest.raises(FileError, match="4 readings are too few for the 4 terms of the set-up"):
        calibrate(RIG, [few], [], "joint_offset")


def test_a_parameter_that_is_hardly_determined_does_not_take_up_what_no_effect_explains() -> None:
    """The zero of axis 6 has little effect on the circle; a gear error that is not fitted could move it by degrees."""
    truth = (
        Backlash(axis=1, width_deg=0.02),
        Backlash(axis=5, width_deg=0.015),
        TransmissionError(axis=4, order=8, amplitude_deg=0.012, phase_deg=40),
    )
    assert RIG.tests.circle
    circle = RIG.tests.circle.model_copy(update={"eccentricity_mm": (0.6, -0.4, 0.1)})
    rig = RIG.model_copy(update={"tests": RIG.tests.model_copy(update={"circle": circle})})
    observed = [observe(MODEL, simulate(rig, "yaw", way, 6, truth), "yaw") for way in ("acw", "cw")]
    found = calibrate(RIG, observed, [], "backlash:1,joint_offset")
    for fitted in found.effects:
        field = size_field(fitted.effect)
        assert abs(getattr(fitted.effect, field)) < 5 * healthy_size(fitted.effect), fitted.effect


def test_parameters_are_counted_by_what_is_distinguished() -> None:
    """30 parameters from a few targets: most of them are held by what is known beforehand, and said to be."""
    truth = (Backlash(axis=1, width_deg=0.05),)
    observed = _observed(truth, 5, ("repeatability",))
    found = calibrate(RIG, observed, [], "joint_offset,link_geometry,backlash")
    assert 0 < found.identified_combinations < 15 < len(found.weak_parameters)
    assert found.after_mm[0] < 0.2 * found.before_mm[0]


@pytest.mark.parametrize(
    ("words", "count"),
    [
        ("joint_offset", 6),
        ("link_geometry", 18),
        ("link_geometry:3", 3),
        ("link_geometry:3.beta", 1),
        ("transmission_error:4:2", 2),
        ("transmission_error", 24),
        ("backlash:1, backlash:1 ,time_lag", 2),
        ("gauge_scale", 2),
        ("wrist_coupling:4.5,ball_form:3,vibration:8.5,gauge_cyclic:g1:0.5", 7),
    ],
)
def test_words_stand_for_effects(words: str, count: int) -> None:
    assert len(parse_effects(words)) == count


@pytest.mark.parametrize(
    "word",
    [
        *("backlsh", "backlash:x", "backlash:1-3", "backlash:7", "backlash:1.a", "backlash:1:2", "joint_offset:²"),
        *("link_geometry:q.a", "transmission_error:4:abc", "transmission_error:4:0", "time_lag:3", "gauge_scale:g3"),
        *("wrist_coupling", "ball_form", "vibration", "gauge_cyclic:g1", "ball_form:99"),
    ],
)
def test_words_that_stand_for_none_say_how_to_write_it(word: str) -> None:
    with pytest.raises(UseError, match="--fit"):
        parse_effects(word)


@pytest.mark.parametrize("name", ["time_lag", "clock_rate", "servo_lag", "reversal_spike"])
@pytest.mark.parametrize("test", ["radial", "repeatability"])
def test_a_robot_that_stands_shows_no_lag(name: str, test: str) -> None:
    """At a target the robot has stood for a while: effects of time are gone there."""
    fields = {"axis": 1} if "axis" in VOCABULARY[name].model_fields else {}
    effect = VOCABULARY[name].model_validate(fields)
    large = effect.model_copy(update={size_field(effect): 10 * healthy_size(effect)})
    nothing = simulate(RIG, test, None, None, ()).g_mm  # type: ignore[arg-type, union-attr]
    shown = simulate(RIG, test, None, None, (large,)).g_mm  # type: ignore[arg-type, union-attr]
    assert np.abs(shown - nothing).max() < 0.02
