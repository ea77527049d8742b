"""Sizes and shapes of effects come back from a simulated response, with uncertainties that hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.fit.background import background_of
from analysis.diagnosis.fit.candidates import HEALTHY, Candidate, columns_for
from analysis.diagnosis.fit.refine import no_effects, refine
from analysis.diagnosis.fit.responses import Linearisation, linearise
from rigs.effects import (
    Backlash,
    Compliance,
    Effect,
    JointOffset,
    LinkGeometry,
    ReversalSpike,
    ServoLag,
    ThermalGrowth,
    TimeLag,
    TransmissionError,
    bounds,
    healthy_size,
    size_field,
)
from rigs.schema.effect import name_of, scaled
from tests.support.diagnosis_cells import Array, healthy, holding, no_background, shown_by, white
from tests.worlds.stranger.play import lagging

CASES: dict[str, tuple[Effect, Effect]] = {
    "a wide play": (Backlash(axis=1, width_deg=0.05, transit=0.4), Backlash(axis=1, width_deg=0.02)),
    "a gear": (
        TransmissionError(axis=1, order=40.3, amplitude_deg=0.02, phase_deg=-120, third=0.2),
        TransmissionError(axis=1, order=40, amplitude_deg=0.012, phase_deg=-90),
    ),
    "a spike": (
        ReversalSpike(axis=2, amplitude_deg=-0.02, decay_s=0.22),
        ReversalSpike(axis=2, amplitude_deg=-0.01, decay_s=0.3),
    ),
    "a length": (LinkGeometry(axis=4, field="d", delta=-1.5), LinkGeometry(axis=4, field="d", delta=-0.3)),
}


@pytest.mark.parametrize("case", CASES)
def test_size_and_shape_are_found_from_afar(case: str) -> None:
    truth, start = CASES[case]
    linear = holding(healthy(), shown_by(healthy(), [truth]) + white(healthy(), 1))
    found = refine(linear, no_background(linear), [start])
    (effect,), sd = found.effects, found.sd(0)
    assert size_field(truth) in sd
    for field, u in sd.items():
        assert abs(getattr(effect, field) - getattr(truth, field)) < 4 * u + 1e-9, (field, effect, sd)
    # What is left is noise again.
    assert np.mean(linear.without_set_up(found.residual) ** 2) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("ppm", [2100.0, -2100.0])
def test_a_fit_begins_within_what_a_rig_file_may_state(ppm: float) -> None:
    """Neighbouring forms of an effect stay within the limits of a rig file; 2048 ppm once stopped a diagnosis."""
    begin = ThermalGrowth().model_copy(update={"ppm": ppm})
    (growth,) = refine(holding(healthy(), white(healthy(), 1)), no_background(healthy()), [begin]).effects
    assert abs(getattr(growth, "ppm")) < 2000.0  # noqa: B009


def test_two_at_once_do_not_disturb_each_other() -> None:
    truths = (Backlash(axis=2, width_deg=0.03, transit=0.2), JointOffset(axis=3, offset_deg=-0.05))
    linear = holding(healthy(), shown_by(healthy(), truths) + white(healthy(), 2))
    starts = (Backlash(axis=2, width_deg=0.02), JointOffset(axis=3, offset_deg=-0.02))
    found = refine(linear, no_background(linear), starts)
    for k, truth in enumerate(truths):
        field = size_field(truth)
        assert abs(getattr(found.effects[k], field) - getattr(truth, field)) < 4 * found.sd(k)[field]
    assert found.sd(0).keys() > {size_field(truths[0])} and list(found.sd(1)) == [size_field(truths[1])]


def test_a_large_effect_is_found_with_the_set_up_that_it_moves() -> None:
    """A joint off by half a degree moves the ball that a fit without it has found."""
    truth = JointOffset(axis=3, offset_deg=0.5)
    linear = holding(healthy(), shown_by(healthy(), [truth]) + white(healthy(), 3))
    found = refine(linear, no_background(linear), [JointOffset(axis=3, offset_deg=0.4)])
    assert getattr(found.effects[0], "offset_deg", 0) == pytest.approx(0.5, abs=0.001)
    assert np.mean(linear.without_set_up(found.residual) ** 2) == pytest.approx(1.0, abs=0.1)


def test_a_play_that_may_not_be_wide_enough_does_not_replace_a_zero() -> None:
    """A backlash whose flank is held by gravity resembles a zero if it is as wide as the linearisation suggests."""
    zero = JointOffset(axis=2, offset_deg=1.5)
    linear = holding(healthy(), shown_by(healthy(), [zero]) + white(healthy(), 6))
    background = no_background(linear)
    right = refine(linear, background, [JointOffset(axis=2, offset_deg=1.4)])
    play = refine(linear, background, [Backlash(axis=2, width_deg=1.0, preload=1.0)])
    moved = play.values + background.posterior(play.fitted_terms).term_means[: len(play.values)]
    for unknown, value in zip(play.unknowns, moved, strict=True):
        low, high = bounds(play.effects[0], unknown.field)
        assert low - 1e-9 <= value <= high + 1e-9, (unknown, value)
    assert background.evidence(right.fitted_terms) > background.evidence(play.fitted_terms) + 100
    # Beside the zero nothing is left for it.
    both = refine(linear, background, [*play.effects, *right.effects])
    assert getattr(both.effects[0], "width_deg", 1.0) < 0.02


@pytest.mark.parametrize("rounds", [1, 2, 8])
@pytest.mark.parametrize("case", [*CASES, "a play for a spike"])
def test_the_tangents_lead_nowhere_beyond_a_limit(case: str, rounds: int) -> None:
    """Not after a fit that was ended early either, in which what belongs at a limit is not there yet."""
    truth = CASES[case][0] if case in CASES else ReversalSpike(axis=1, amplitude_deg=0.1, decay_s=0.1, slow=0.5)
    start = CASES[case][1] if case in CASES else Backlash(axis=1, width_deg=0.1, transit=0.5, preload=0.3)
    linear = holding(healthy(), shown_by(healthy(), [truth]) + white(healthy(), 5))
    found = refine(linear, no_background(linear), [start], rounds=rounds)
    moved = found.values + no_background(linear).posterior(found.fitted_terms).term_means[: len(found.values)]
    held = ~np.isnan(found.to_limit)
    for unknown, value in zip(
        [u for u, out in zip(found.unknowns, held, strict=True) if out], moved[held], strict=True
    ):
        reach = (unknown.expected - 4 * unknown.spread, unknown.expected + 4 * unknown.spread)
        limits = (*bounds(start, unknown.field), unknown.low, *reach)
        assert min(abs(value - limit) for limit in limits) < 1e-6, (unknown, value)


def _without_payload(linear: Linearisation) -> Linearisation:
    models = [replace(block.model, load=replace(block.model.load, payload_kg=0.0)) for block in linear.blocks]
    blocks = [replace(block, model=model) for block, model in zip(linear.blocks, models, strict=True)]
    return linearise(blocks, linear.setups)


@pytest.mark.parametrize("axis", [2, 3])
def test_what_is_at_a_limit_does_not_lead_the_rest_astray(axis: int) -> None:
    """Readings as if less than nothing hung on the arm, which a payload may not be: the rest fits them best. A payload
    that is stated would hardly move."""
    bare_arm = _without_payload(healthy())
    unit = Compliance(axis=axis, deg_per_Nm=1e-5, payload_kg=0.0)
    bare, loaded = bare_arm.columns([unit, unit.model_copy(update={"payload_kg": 5.0})]).T
    linear = holding(bare_arm, 2.0 * bare - 0.8 * (loaded - bare))
    found = refine(linear, no_background(linear), [scaled(unit, 3.0)])
    alone, left = linear.without_set_up(bare), linear.without_set_up(linear.y)
    best = 1e-5 * float(alone @ left) / float(alone @ alone)
    effect, u = found.effects[0], found.sd(0)["deg_per_Nm"]
    assert getattr(effect, "payload_kg", -1.0) == 0.0 and getattr(effect, "deg_per_Nm", 0.0) == pytest.approx(
        best, abs=0.2 * u
    )


def test_a_large_lag_is_right_beside_the_lags_of_a_healthy_arm() -> None:
    """A lag of all joints looks like late stamps, so the readings show only how much more one of them lags."""
    others = [ServoLag(axis=axis, lag_s=0.8 * healthy_size(ServoLag(axis=axis))) for axis in (2, 3, 4, 5, 6)]
    truth = ServoLag(axis=1, lag_s=0.02)
    linear = holding(healthy(), shown_by(healthy(), [truth, *others]) + white(healthy(), 7))
    every = [ServoLag(axis=axis, lag_s=5e-4) for axis in (2, 3, 4, 5, 6)]
    candidates = [Candidate(name_of(one), (one,)) for one in (*every, TimeLag(lag_s=1e-3))]
    columns = columns_for(linear, candidates)
    weight, variance = np.ones(len(linear.y)), columns.variance(HEALTHY)
    found = [
        refine(linear, background_of(columns, weight, variance, mean), [ServoLag(axis=1, lag_s=0.015)])
        for mean in (columns.mean(HEALTHY), np.zeros(len(variance)))
    ]
    off_s = [abs(float(getattr(one.effects[0], "lag_s", 0.0)) - truth.lag_s) for one in found]
    assert off_s[0] < 2 * found[0].sd(0)["lag_s"] and off_s[0] < off_s[1] / 4, off_s


def test_two_standard_uncertainties_cover_the_truth() -> None:
    """Over 20 seeds of white noise, sizes of a play and of an offset: some 38 of 40 within two."""
    truths = (Backlash(axis=1, width_deg=0.01, transit=0.2), JointOffset(axis=3, offset_deg=0.01))
    shown = shown_by(healthy(), truths)
    background = no_background(healthy())
    pulls = []
    for seed in range(20):
        linear = holding(healthy(), shown + white(healthy(), 50 + seed))
        found = refine(linear, background, truths)
        for k, truth in enumerate(truths):
            field = size_field(truth)
            pulls.append((getattr(found.effects[k], field) - getattr(truth, field)) / found.sd(k)[field])
    assert 0.65 < np.sqrt(np.mean(np.square(pulls))) < 1.4
    assert np.mean(np.abs(pulls) < 2) >= 0.85
    assert abs(np.mean(pulls)) < 0.5


@pytest.mark.parametrize("roundness", [0.0, 0.1, 0.2])
def test_a_play_has_its_width_and_its_whole_height_however_it_is_crossed(roundness: float) -> None:
    """The play of the blind trial's generator: plays side by side, and friction that is approached exponentially."""
    truth = Backlash(axis=1, width_deg=0.05)

    def off(block: Block) -> Array:
        return lagging(block.path.q[:, 0], np.radians(truth.width_deg) / 2, roundness)[:, None]

    shown = healthy().by_joint(1, off)[:, 0]
    linear = holding(healthy(), shown + white(healthy(), 7))
    found = refine(linear, no_background(linear), [Backlash(axis=1, width_deg=0.02)], no_effects(linear))
    (effect,) = found.effects
    assert isinstance(effect, Backlash)
    assert effect.width_deg == pytest.approx(truth.width_deg, rel=0.015)
    assert effect.preload < 0.02  # no part of it is held by gravity


def test_a_play_read_with_late_stamps_has_its_width() -> None:
    truth, late = Backlash(axis=1, width_deg=0.05), TimeLag(lag_s=0.002)
    # What late stamps do to the readings of the arm without the play is known.
    shown = shown_by(healthy(), [truth, late]) - shown_by(healthy(), [late])
    linear = holding(healthy(), shown + white(healthy(), 8))
    begun = refine(linear, no_background(linear), [Backlash(axis=1, width_deg=0.04)])
    (effect,) = refine(linear, no_background(linear), begun.effects).effects
    assert isinstance(effect, Backlash)
    # It is 2.4 % too wide where nothing is allowed to come later.
    assert effect.width_deg == pytest.approx(truth.width_deg, rel=0.01)


def test_nothing_named_leaves_the_residual_as_it_is() -> None:
    linear = holding(healthy(), white(healthy(), 4))
    found = refine(linear, no_background(linear), [])
    assert (found.effects, found.unknowns, found.fitted_terms.T.shape) == ((), (), (len(linear.y), 0))
    # What noise moves the set-up by shows in second order.
    np.testing.assert_allclose(found.residual, linear.y, atol=1e-3)


def test_a_background_that_does_the_same_takes_the_size_and_widens_its_uncertainty() -> None:
    truth = JointOffset(axis=3, offset_deg=0.05)
    linear = holding(healthy(), shown_by(healthy(), [truth]) + white(healthy(), 6))
    alone = refine(linear, no_background(linear), [truth])
    twin = linear.columns([truth])
    departures = refine(linear, no_background(linear, twin), [truth])
    assert departures.sd(0)["offset_deg"] == pytest.approx(np.hypot(alone.sd(0)["offset_deg"], 0.05), rel=0.02)
    # A spread of one column is 0.05°; what is plausible of the fault is many times that, and it keeps the size.
    assert getattr(departures.effects[0], "offset_deg", 0.0) == pytest.approx(0.05, rel=0.5)
