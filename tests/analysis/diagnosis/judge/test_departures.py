import numpy as np
import pytest

from analysis.diagnosis.evidence.blocks import Block
from analysis.diagnosis.fit.departures import departure_columns, fewest_columns, similar_columns
from rigs.effects import Backlash, TimeLag, TransmissionError
from rigs.schema.scene import play
from tests.support.diagnosis_cells import Array, healthy

LATE = 3
"""Columns of a joint's effect that comes at another time: stamps may be late, or ever later, or scatter."""
GEAR = TransmissionError(axis=1, order=20, amplitude_deg=0.02, phase_deg=30)


def test_a_gear_has_its_second_and_third_harmonic_in_any_phase():
    linear = healthy()
    found = departure_columns(linear, GEAR)
    assert found.shape[1] == 4 + LATE
    for order in (40.0, 60.0):
        harmonic = linear.columns([GEAR.model_copy(update={"order": order, "phase_deg": 75.0})])[:, 0]
        weights, *_ = np.linalg.lstsq(found, harmonic, rcond=None)
        assert np.linalg.norm(harmonic - found @ weights) < 0.02 * np.linalg.norm(harmonic)
        assert 2 < np.linalg.norm(weights[:4]) < 20
    odd = linear.columns([GEAR.model_copy(update={"order": 33.0})])[:, 0]
    weights, *_ = np.linalg.lstsq(found, odd, rcond=None)
    assert np.linalg.norm(odd - found @ weights) > 0.5 * np.linalg.norm(odd)


def _leaves(found: Array, wanted: Array) -> float:
    """Share of the wanted response that the columns cannot represent."""
    weights, *_ = np.linalg.lstsq(found, wanted, rcond=None)
    return float(np.linalg.norm(wanted - found @ weights) / np.linalg.norm(wanted))


def test_a_play_may_have_wider_and_narrower_ones_in_place_of_a_part_of_it():
    linear = healthy()
    sharp = Backlash(axis=1, width_deg=0.05)
    found = similar_columns(linear, sharp)
    whole, narrower, wider, none = linear.columns(
        [sharp.model_copy(update={"width_deg": width}) for width in (0.05, 0.025, 0.2)]
        + [TransmissionError(axis=1, order=33, amplitude_deg=0.02)]
    ).T
    assert max(_leaves(found, 2 * narrower - whole), _leaves(found, wider / 4 - whole)) < 1e-6
    assert min(_leaves(found, narrower), _leaves(found, none)) > 0.5  # the height of the play is its own


@pytest.mark.parametrize("effect", [Backlash(axis=1, width_deg=0.1), GEAR])
def test_an_effect_of_a_joint_may_come_later_as_everything_does_by_late_stamps(effect):
    linear, late = healthy(), TimeLag(lag_s=0.001)
    together, alone, stamps, none = (linear.residual(each) for each in ([effect, late], [effect], [late], []))
    beyond = together - alone - stamps + none
    found = linear.retimed(effect)[:, :-1]
    assert found.shape == (len(linear.y), 2) and np.linalg.norm(beyond) > 10  # the test shows something
    # Late stamps turn the link too, and with it the direction in which the error shows.
    assert _leaves(found, beyond) < 0.2
    weights, *_ = np.linalg.lstsq(found, -beyond, rcond=None)
    assert sorted(weights) == pytest.approx([0.0, 1.0], abs=0.02)  # a healthy lag, and no rate


def test_stamps_that_scatter_make_a_quick_wave_smaller():
    """The mean over many laps of a wave read at instants that scatter, against the column for the scatter."""
    linear, rng = healthy(), np.random.default_rng(7)

    def wave(q: Array) -> Array:
        turned: Array = np.radians(0.02) * np.sin(120 * q)
        return turned

    def lost(block: Block) -> Array:
        t, q = block.path.t_s, block.path.q[:, 0]
        scatter = rng.normal(0.0, np.median(np.diff(t)) / 4, (200, len(t)))
        mean: Array = np.mean([wave(np.interp(t + one, t, q)) for one in scatter], axis=0)
        return (mean - wave(q))[:, None]

    gear = TransmissionError(axis=1, order=120, amplitude_deg=0.02)
    found, wanted = linear.retimed(gear)[:, -1:], linear.by_joint(1, lost)[:, 0]
    (weight,), *_ = np.linalg.lstsq(found, wanted, rcond=None)
    assert np.linalg.norm(wanted) > 10  # the test shows something
    assert weight == pytest.approx(1.0, abs=0.1)
    assert _leaves(departure_columns(linear, gear), found[:, 0]) < 1e-6


@pytest.mark.parametrize("begin", [-1.0, -0.3, 0.7])
def test_a_run_may_have_begun_anywhere_in_a_play(begin):
    """Until the joint has crossed its play, it stands off by as much; of 0.6 degrees that is a part of the lap."""
    linear, half = healthy(), np.radians(0.3)

    def off(block: Block) -> Array:
        x = block.path.q[:, 1]
        return (play(x, half, begin) - play(x, half))[:, None]

    added = linear.by_joint(2, off)[:, 0]
    found = departure_columns(linear, Backlash(axis=2, width_deg=0.6))
    weights, *_ = np.linalg.lstsq(found, added, rcond=None)
    assert np.linalg.norm(added) > 50
    assert np.linalg.norm(added - found @ weights) < 0.02 * np.linalg.norm(added)
    elsewhere = linear.columns([Backlash(axis=3, width_deg=0.6)])[:, 0]
    weights, *_ = np.linalg.lstsq(found, elsewhere, rcond=None)
    assert np.linalg.norm(elsewhere - found @ weights) > 0.5 * np.linalg.norm(elsewhere)


def test_the_fewest_columns_allow_for_the_same():
    columns = departure_columns(healthy(), Backlash(axis=2, width_deg=0.6))
    fewest = fewest_columns(columns)
    assert fewest.shape[1] < 0.6 * columns.shape[1]
    variance = np.linalg.eigvalsh(columns.T @ columns).max()
    np.testing.assert_allclose(fewest @ fewest.T, columns @ columns.T, atol=1e-6 * variance)
    assert fewest_columns(columns[:, :0]).shape == (len(columns), 0)
