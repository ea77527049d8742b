import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.fit.refine import no_effects, refine
from analysis.diagnosis.fit.responses import NearResponses
from rigs.effects import (
    Backlash,
    Effect,
    JointOffset,
    LinkGeometry,
    ReversalSpike,
    ThermalGrowth,
    TransmissionError,
    bounds,
    size_field,
)
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
def test_size_and_shape_are_found_from_afar(case):
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
def test_fit_begins_within_the_bounds_of_a_rig_file(ppm):
    """Neighbouring forms of an effect stay within the limits of a rig file; 2048 ppm once stopped a diagnosis."""
    begin = ThermalGrowth().model_copy(update={"ppm": ppm})
    (growth,) = refine(holding(healthy(), white(healthy(), 1)), no_background(healthy()), [begin]).effects
    assert abs(getattr(growth, "ppm")) < 2000.0  # noqa: B009


def test_a_play_that_may_not_be_wide_enough_does_not_replace_a_zero():
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
    assert both.effects[0].width_deg < 0.02


def test_two_standard_uncertainties_cover_the_truth():
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
def test_a_play_has_its_width_and_its_whole_height_however_it_is_crossed(roundness):
    """The play of the blind trial's generator: plays side by side, and friction that is approached exponentially."""
    truth = Backlash(axis=1, width_deg=0.05)

    def off(block: Block) -> Array:
        return lagging(block.path.q[:, 0], np.radians(truth.width_deg) / 2, roundness)[:, None]

    shown = healthy().by_joint(1, off)[:, 0]
    linear = holding(healthy(), shown + white(healthy(), 7))
    found = refine(linear, no_background(linear), [Backlash(axis=1, width_deg=0.02)], no_effects(linear))
    (effect,) = found.effects
    assert effect.width_deg == pytest.approx(truth.width_deg, rel=0.015)
    assert effect.preload < 0.02  # no part of it is held by gravity


def test_a_background_that_does_the_same_takes_the_size_and_widens_its_uncertainty():
    truth = JointOffset(axis=3, offset_deg=0.05)
    linear = holding(healthy(), shown_by(healthy(), [truth]) + white(healthy(), 6))
    alone = refine(linear, no_background(linear), [truth])
    twin = linear.columns([truth])
    departures = refine(linear, no_background(linear, twin), [truth])
    assert departures.sd(0)["offset_deg"] == pytest.approx(np.hypot(alone.sd(0)["offset_deg"], 0.05), rel=0.02)
    # A spread of one column is 0.05°; what is plausible of the fault is many times that, and it keeps the size.
    assert departures.effects[0].offset_deg == pytest.approx(0.05, rel=0.5)


GEAR = TransmissionError(axis=4, order=20, amplitude_deg=0.02, phase_deg=179)
STEPS = {"amplitude_deg": 4e-4, "phase_deg": 1.0, "third": 0.002}


def _computed(first: Effect, then: Effect) -> int:
    times: list[int] = []

    def compute() -> Array:
        times.append(1)
        return np.zeros((3, 2))

    near = NearResponses()
    near.of("slopes", first, STEPS, compute)
    near.of("slopes", then, STEPS, compute)
    return len(times)


@pytest.mark.parametrize("change", [{}, {"amplitude_deg": 0.0203}, {"phase_deg": -180.5}, {"third": 0.001}])
def test_a_near_effect_has_the_same_response(change):
    assert _computed(GEAR, GEAR.model_copy(update=change)) == 1


@pytest.mark.parametrize(
    "change", [{"amplitude_deg": 0.021}, {"phase_deg": 177.0}, {"phase_deg": -178.0}, {"order": 20.001}, {"axis": 5}]
)
def test_another_effect_has_a_response_of_its_own(change):
    assert _computed(GEAR, GEAR.model_copy(update=change)) == 2
