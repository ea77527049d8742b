"""Calibration of arms that are wrong, by poses of another generator, against plain least squares by another solver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.inference.calibrate import Calibration, calibrate
from analysis.inference.observation import Observation, observe, residuals_of, rms
from analysis.inference.setups import fit_setups
from analysis.kinematics.arm import arm_of, forward
from analysis.model.predict import model_of
from analysis.traces.tables import PoseTable
from rigs.load import load
from tests.support.independent_arm import (
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
from tests.support.nightly import cases

ZEROS, DH = "joint_offset", "joint_offset,link_geometry"
NARROW_DEG = (25, 12, 12, 30, 20, 60)


def _rig(name: str):
    return load(name)[0].model_copy(update={"effects": ()})


def _observed(name: str, poses: Seen, setup: str = "pose") -> Observation:
    one = observe(model_of(_rig(name)), PoseTable(poses.q, poses.xyz_mm, None), setup)
    return replace(one, setup=setup)


def _elsewhere_mm(found: Calibration, name: str, poses: Seen) -> float:
    """Root mean square distance at poses of another placement, whose set-up is fitted."""
    one = _observed(name, poses, "elsewhere")
    return rms(residuals_of(found.after.model, [one], fit_setups([(found.after.model, one)])))


def _cells(name: str, kind, seeds: range):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        yield cell(name, kind(rng), rng), rng


@pytest.mark.parametrize("name", ["paper-fanuc", "ur10e"])
def test_the_generator_means_the_same_arm(name: str) -> None:
    """Right arms of both agree, so that nothing below is of another arm."""
    rng = np.random.default_rng(0)
    right = healthy(rng)
    right = replace(right, **{key: 0.0 * getattr(right, key) for key in right.__dataclass_fields__})
    q = postures(name, 20, rng)
    bare = replace(arm_of(load(name)[0].robot), T_world_base=np.eye(4), T_flange_tool=np.eye(4))
    np.testing.assert_allclose(flange(constants_of(name), right, q)[1], forward(bare, q)[:, :3, 3], atol=1e-9)


@pytest.mark.parametrize("name", ["paper-fanuc", "ur10e"])
@pytest.mark.parametrize(("kind", "words"), [(bad_zeros, ZEROS), (bad_arm, DH)], ids=["zeros", "all constants"])
@pytest.mark.parametrize("seeds", cases((range(1), range(1, 3)), (range(1),)))
def test_thirty_poses_of_a_bad_arm_give_what_plain_least_squares_gives(
    name: str, kind, words: str, seeds: range
) -> None:
    for arm, rng in _cells(name, kind, seeds):
        train, test = (arm.seen(postures(name, count, rng), rng) for count in (30, 200))
        found = calibrate(_rig(name), [_observed(name, train)], [_observed(name, test)], words)
        peer = least_squares_fit(arm.arm, train, words).held_out_mm(arm.arm, test, again=False)
        assert found.before_mm[1] > 2.0
        assert found.after_mm[1] < 1.1 * peer


def test_from_a_corner_of_the_joints_the_model_holds_better_elsewhere_than_least_squares() -> None:
    ours, theirs = [], []
    for arm, rng in _cells("ur10e", bad_zeros, range(2)):
        train = arm.seen(postures("ur10e", 30, rng, NARROW_DEG), rng)
        wide = arm.seen(postures("ur10e", 200, rng), rng)
        found = calibrate(_rig("ur10e"), [_observed("ur10e", train)], [], DH)
        assert found.identified_combinations < 18 and any(one.like for one in found.weak_parameters)
        ours.append(_elsewhere_mm(found, "ur10e", wide))
        theirs.append(least_squares_fit(arm.arm, train, DH).held_out_mm(arm.arm, wide, again=True))
    assert np.mean(ours) < np.mean(theirs)


def test_wild_poses_are_counted_and_change_nothing() -> None:
    (pair,) = _cells("ur10e", bad_arm, range(1))
    arm, rng = pair
    train, test = (arm.seen(postures("ur10e", count, rng), rng) for count in (40, 100))
    spoilt = train.xyz_mm.copy()
    spoilt[[3, 17]] += [[3.0, -2.0, 0.0], [0.0, 0.0, 1.5]]
    sound = calibrate(_rig("ur10e"), [_observed("ur10e", train)], [_observed("ur10e", test)], DH)
    found = calibrate(_rig("ur10e"), [_observed("ur10e", Seen(train.q, spoilt))], [_observed("ur10e", test)], DH)
    assert found.doubts[0] == "pose: 2 of 40 readings are wild and left out"
    assert found.after_mm[1] < 1.1 * sound.after_mm[1]


def test_few_poses_are_no_reason_to_refuse_many_parameters() -> None:
    (pair,) = _cells("paper-fanuc", bad_zeros, range(1))
    arm, rng = pair
    train, test = (arm.seen(postures("paper-fanuc", count, rng), rng) for count in (10, 100))
    found = calibrate(_rig("paper-fanuc"), [_observed("paper-fanuc", train)], [_observed("paper-fanuc", test)], DH)
    assert found.after_mm[1] < 0.25 * found.before_mm[1]


@pytest.mark.parametrize("seeds", cases((range(3), range(3, 9)), (range(3),)))
def test_uncertainties_hold_for_what_is_determined_and_for_what_is_not(seeds: range) -> None:
    """Zeros and lengths of a bad arm, each against its own uncertainty, including those that are determined only
    together."""
    away = []
    for arm, rng in _cells("ur10e", bad_arm, seeds):
        found = calibrate(_rig("ur10e"), [_observed("ur10e", arm.seen(postures("ur10e", 60, rng), rng))], [], DH)
        away += _in_uncertainties(arm, found)
    assert np.mean(np.array(away) < 2) > 0.85 and np.max(away) < 6


def _in_uncertainties(arm: Cell, found: Calibration) -> list[float]:
    away = []
    for one in found.effects:
        effect = one.effect
        name = getattr(effect, "field", "offset")
        degrees = name in ("offset", "alpha")
        size = getattr(effect, "offset_deg", getattr(effect, "delta", 0.0))
        truth = getattr(arm.wrong, name)[effect.axis - 1]  # type: ignore[union-attr]
        (sd,) = one.sd.values()
        away.append(abs(size - (np.degrees(truth) if degrees else truth)) / sd)
    return away


def test_where_the_model_was_not_measured_is_said() -> None:
    (pair,) = _cells("ur10e", bad_zeros, range(1))
    arm, rng = pair
    train = arm.seen(postures("ur10e", 30, rng, NARROW_DEG), rng)
    wide = arm.seen(postures("ur10e", 50, rng), rng)
    found = calibrate(_rig("ur10e"), [_observed("ur10e", train)], [_observed("ur10e", wide)], ZEROS)
    low, high = found.covered[0]
    assert -25 <= low < -20 and 20 < high <= 25
    assert sum("outside" in doubt for doubt in found.doubts) == 6
