"""Fit of given effects to simulated runs and to independently generated poses: the true sizes are found within u."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from analysis import calibrate
from analysis.diagnosis.judge.result import Diagnosis, Named
from analysis.procedures.simulate import simulated_run
from analysis.robot.kinematics.arm import Array, arm_of, forward
from analysis.runs.loading import Measured
from rigs.effects import Backlash, Effect, JointOffset, ReversalSpike, TransmissionError, size_field
from rigs.load import load
from tests.support.nightly import cases
from tests.support.pose_runs import pose_run
from tests.worlds.arms.independent_arm import (
    Cell,
    Seen,
    bad_arm,
    bad_zeros,
    cell,
    constants_of,
    flange,
    healthy,
    least_squares_fit,
    postures,
)

LOADED, TEXT = load("paper-fanuc")
RIG = LOADED.model_copy(update={"effects": ()})
ZEROS, DH = "joint_offset", "joint_offset,link_geometry"
NARROW_DEG = (25, 12, 12, 30, 20, 60)


def _runs(truth: tuple[Effect, ...], seed: int, tests: tuple[str, ...] = ("yaw",)) -> list[Measured]:
    ways = {"yaw": ("acw", "cw"), "roll": ("acw", "cw")}
    return [
        simulated_run(RIG, TEXT, test, way, seed, truth)  # type: ignore[arg-type]
        for test in tests
        for way in ways.get(test, (None,))
    ]


def _fitted(runs: list[Measured], words: str) -> Named:
    (one,) = calibrate(runs, words, rig=RIG).effects
    return one


@pytest.mark.parametrize(
    ("truth", "words", "tests"),
    cases(
        [
            (Backlash(axis=1, width_deg=0.02), "backlash:1", ("yaw",)),
            (Backlash(axis=1, width_deg=0.02), "backlash:1", ("repeatability",)),
            (JointOffset(axis=5, offset_deg=-0.1), "joint_offset:5", ("radial",)),
            (ReversalSpike(axis=1, amplitude_deg=-0.03), "reversal_spike:1", ("yaw",)),
        ],
        lambda case: case[2] != ("yaw",),  # a play and a wave are fitted on yaw circles by the contract of every effect
    ),
    ids=lambda value: getattr(value, "effect", value),
)
def test_what_was_planted_comes_out(truth: Effect, words: str, tests: tuple[str, ...]) -> None:
    found = _fitted(_runs((truth,), 1, tests), words)
    field = size_field(truth)
    off = abs(getattr(found.effect, field) - getattr(truth, field))
    assert off < 4 * found.sd[field] and off < 0.1 * abs(getattr(truth, field))


@pytest.mark.parametrize("phase", cases((20.0, 110.0, 200.0, 290.0), ()))
def test_a_gear_error_of_any_phase_is_one_wave(phase: float) -> None:
    truth = TransmissionError(axis=2, order=2, amplitude_deg=0.05, phase_deg=phase)
    runs = _runs((truth,), 2, ("yaw", "roll"))
    found = _fitted(runs, "transmission_error:2:2")
    assert found.effect.amplitude_deg == pytest.approx(0.05, abs=4 * found.sd["amplitude_deg"])  # type: ignore[union-attr]
    turned = (found.effect.phase_deg - phase + 180) % 360 - 180  # type: ignore[union-attr]
    assert abs(turned) < 4 * found.sd["phase_deg"]
    # The phase is that at the joint's zero. Circles drive 48° of the joint, a quarter of a wave, and know the order to
    # 0.27: the phase is as sure as the order lets it be at the end of the stretch, and the wave is known far better.
    driven = np.concatenate([run.table.q[:, 1] for run in runs])
    assert found.sd["phase_deg"] < found.sd["order"] * np.degrees(np.abs(driven).max())
    assert _rms(_wave(found.effect, driven) - _wave(truth, driven)) < 0.05 * _rms(_wave(truth, driven))


def _wave(effect: Effect, q: Array) -> Array:
    """A gear error over the angles q (n,) rad, in degrees, about its mean, which is the joint's zero."""
    wave = effect.amplitude_deg * np.sin(effect.order * q + np.radians(effect.phase_deg))  # type: ignore[union-attr]
    return np.asarray(wave - wave.mean())


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_a_run_of_another_test_judges_with_its_own_set_up() -> None:
    truth = (Backlash(axis=1, width_deg=0.03),)
    found = calibrate(_runs(truth, 3), "backlash:1", rig=RIG, hold_out=_runs(truth, 4, ("radial",)))
    assert found.held_out and not found.held_out.keeps_setup
    assert found.held_out.after_um < 0.5 * found.held_out.before_um


@pytest.mark.parametrize("seeds", cases((range(2), range(2, 12)), (range(2),)))
def test_a_zero_that_is_right_is_as_far_from_zero_as_its_uncertainty_says(seeds: range) -> None:
    away = []
    for seed in seeds:
        found = _fitted([*_runs((), 100 + seed), *_runs((), 200 + seed)], "joint_offset:3")
        away.append(found.effect.offset_deg / found.sd["offset_deg"])  # type: ignore[union-attr]
    assert 0.1 < np.sqrt(np.mean(np.square(away))) < 1.8, away


def _cells(name: str, kind, seeds: range) -> Iterator[tuple[Cell, np.random.Generator]]:
    for seed in seeds:
        rng = np.random.default_rng(seed)
        yield cell(name, kind(rng), rng), rng


def _poses(name: str, seen: Seen, *where: str) -> Measured:
    return pose_run(name, seen.q, seen.xyz_mm, *where)


def _judged(name: str, train: Seen, test: Seen, words: str, *where: str) -> Diagnosis:
    rig = load(name)[0].model_copy(update={"effects": ()})
    return calibrate([_poses(name, train, "train")], words, rig=rig, hold_out=[_poses(name, test, "test", *where)])


@pytest.mark.parametrize("name", ["paper-fanuc", "ur10e"])
def test_the_generator_means_the_same_arm(name: str) -> None:
    """Right arms of both agree, so that nothing below is of another arm."""
    rng = np.random.default_rng(0)
    right = healthy(rng)
    right = replace(right, **{key: 0.0 * getattr(right, key) for key in right.__dataclass_fields__})
    q = postures(name, 20, rng)
    bare = replace(arm_of(load(name)[0].robot), T_world_base=np.eye(4), T_flange_tool=np.eye(4))
    np.testing.assert_allclose(flange(constants_of(name), right, q)[1], forward(bare, q)[:, :3, 3], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "kind", "words"),
    cases(
        [(name, *bad) for name in ("paper-fanuc", "ur10e") for bad in ((bad_zeros, ZEROS), (bad_arm, DH))],
        [("paper-fanuc", bad_zeros, ZEROS), ("ur10e", bad_arm, DH)],
    ),
)
def test_thirty_poses_of_a_bad_arm_give_more_than_plain_least_squares_gives(name: str, kind, words: str) -> None:
    for arm, rng in _cells(name, kind, range(1)):
        train, test = (arm.seen(postures(name, count, rng), rng) for count in (30, 200))
        found = _judged(name, train, test, words).held_out
        peer_um = 1e3 * least_squares_fit(arm.arm, train, words).held_out_mm(arm.arm, test, again=False)
        assert found and found.keeps_setup and found.before_um > 2000
        assert found.calibrated_um < 0.9 * peer_um


def test_from_a_corner_of_the_joints_the_model_holds_about_as_well_elsewhere_as_least_squares() -> None:
    """Of eight cells the model leaves 1.05 times as much, of two 0.99 to 1.08."""
    ours, theirs = [], []
    for arm, rng in _cells("ur10e", bad_zeros, range(2)):
        train = arm.seen(postures("ur10e", 30, rng, NARROW_DEG), rng)
        wide = arm.seen(postures("ur10e", 200, rng), rng)
        found = _judged("ur10e", train, wide, DH, "elsewhere").held_out
        assert found and not found.keeps_setup
        ours.append(found.calibrated_um)
        theirs.append(1e3 * least_squares_fit(arm.arm, train, DH).held_out_mm(arm.arm, wide, again=True))
    assert np.mean(ours) < 1.1 * np.mean(theirs)


def test_wild_poses_are_left_out_and_change_little() -> None:
    ((arm, rng),) = _cells("ur10e", bad_arm, range(1))
    train, test = (arm.seen(postures("ur10e", count, rng), rng) for count in (40, 100))
    spoilt = train.xyz_mm.copy()
    spoilt[[3, 17]] += [[3.0, -2.0, 0.0], [0.0, 0.0, 1.5]]
    sound = _judged("ur10e", train, test, DH)
    found = _judged("ur10e", Seen(train.q, spoilt), test, DH)
    assert any("train: 2 of 40 poses ignored: rows 4 and 18 " in doubt for doubt in found.doubts)
    assert not any("ignored" in doubt for doubt in sound.doubts)
    assert found.held_out and sound.held_out
    assert found.held_out.calibrated_um < 1.1 * sound.held_out.calibrated_um


def test_few_poses_are_no_reason_to_refuse_many_parameters() -> None:
    ((arm, rng),) = _cells("paper-fanuc", bad_zeros, range(1))
    train, test = (arm.seen(postures("paper-fanuc", count, rng), rng) for count in (10, 100))
    found = _judged("paper-fanuc", train, test, DH).held_out
    assert found and found.calibrated_um < 0.25 * found.before_um


@pytest.mark.parametrize("seeds", cases((range(1), range(9)), (range(1),)))
def test_uncertainties_hold_for_what_is_determined_and_for_what_is_not(seeds: range) -> None:
    """Zeros and lengths of a bad arm, each against its own uncertainty, also those determined together only."""
    away = []
    for arm, rng in _cells("ur10e", bad_arm, seeds):
        seen = arm.seen(postures("ur10e", 60, rng), rng)
        rig = load("ur10e")[0].model_copy(update={"effects": ()})
        for one in calibrate([_poses("ur10e", seen)], DH, rig=rig).effects:
            away.append(_in_uncertainties(arm, one))
    assert np.mean(np.array(away) < 2) > 0.85 and np.max(away) < 6


def _in_uncertainties(arm: Cell, one: Named) -> float:
    effect = one.effect
    name = getattr(effect, "field", "offset")
    size = getattr(effect, "offset_deg", getattr(effect, "delta", 0.0))
    truth = getattr(arm.wrong, name)[effect.axis - 1]  # type: ignore[union-attr]
    return float(abs(size - (np.degrees(truth) if name in ("offset", "alpha") else truth)) / one.sd[size_field(effect)])
