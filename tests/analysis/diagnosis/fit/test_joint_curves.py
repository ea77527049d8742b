"""Joint curves: their size and smoothness are those of the readings, an arm whose joints err smoothly is known better
than by its constants, and none of its curve is called a gear."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.diagnosis.fit.joint_curves import CurveColumns, JointCurves, curve_columns
from analysis.runs.tables import PoseTable
from rigs.effects import Effect, JointOffset, TransmissionError
from rigs.load import load
from tests.support.diagnosis_cells import found_in, measured
from tests.worlds.arms.independent_arm import Cell, Seen, cell, healthy, least_squares_fit, postures

Array = NDArray[np.float64]
ORDERS = np.arange(1, 61)
WAVES: tuple[Effect, ...] = tuple(
    TransmissionError(axis=2, order=float(order), amplitude_deg=0.005, phase_deg=phase)
    for order in ORDERS
    for phase in (0.0, 90.0)
)


def test_columns_know_their_joints_orders_and_gaps() -> None:
    effects = (JointOffset(axis=1, offset_deg=0.01), *(WAVES[k] for k in (0, 1, 8, 16)))
    found = curve_columns(effects)
    assert found.columns.tolist() == [1, 2, 3, 4] and found.joint.tolist() == [1, 1, 1, 1]
    assert found.order.tolist() == [1, 1, 5, 9] and found.among.tolist() == [4, 4, 4, 4]
    curves = JointCurves((9.0, 2.0, 9.0, 9.0, 9.0, 9.0), 1.0)
    assert found.variance(curves) == pytest.approx([16, 16, 16 / 25, 16 / 81])


def test_a_joint_that_turned_little_has_no_large_waves_that_are_a_zero_as_well() -> None:
    effects = [WAVES[k] for k in (0, 8, 118)]  # of once, 5 and 60 times a turn, of which 19° are 0.05, 0.26 and 3
    widths = JointCurves((9.0, 20.0), 1.0)
    free, held = (curve_columns(effects, turned) for turned in ((), (1.0, 19 / 360)))
    assert held.variance(widths)[0] == 1.0 < free.variance(widths)[0]
    assert held.variance(widths)[1:] == pytest.approx(free.variance(widths)[1:])


def _likelihood(
    X: Array, y: Array, columns: CurveColumns, curves: JointCurves, strength: Array
) -> tuple[float, Array, Array]:
    """The log likelihood of readings (N,) in noise of a strength (1,), by the dense covariance, and its derivatives."""
    variance = columns.variance(curves)
    C = strength * np.eye(len(y)) + (X * variance) @ X.T
    inverse = np.linalg.inv(C)
    weighed = inverse @ y
    slope = 0.5 * variance * ((X.T @ weighed) ** 2 - (X * (inverse @ X)).sum(axis=0))
    of_noise = 0.5 * strength * (weighed @ weighed - np.trace(inverse))
    return -0.5 * float(y @ weighed + np.linalg.slogdet(C)[1]), slope, of_noise


def _drawn(seed: int, width: float, decay: float) -> tuple[Array, Array]:
    """Waves (N, c) of a joint over a third of a turn, and readings (N,) of a curve with a noise of two units."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2.1, 300)
    X = np.repeat(ORDERS, 2) * angle[:, None]
    X = np.where(np.arange(X.shape[1]) % 2 == 0, np.sin(X), np.cos(X))
    size = width * np.repeat(ORDERS, 2) ** -decay * rng.normal(size=X.shape[1])
    return X, X @ size + 2 * rng.normal(size=300)


@pytest.mark.parametrize(("width", "decay"), [(10.0, 1.0), (4.0, 0.6), (15.0, 1.4)])
def test_width_decay_and_noise_are_those_of_the_readings(width: float, decay: float) -> None:
    columns, found, noise = curve_columns(WAVES), [], []
    for seed in range(4):
        X, y = _drawn(seed, width, decay)
        curves, strength = columns.fitted(
            JointCurves((1.0,) * 6), np.array([50.0]), np.array([[0.1], [1e6]]), partial(_likelihood, X, y, columns)
        )
        found.append(curves)
        noise.append(float(strength[0]))
    # What a third of a turn shows of a curve is its size at the orders in the middle.
    middle = [one.widths[1] * 10**-one.decay for one in found]
    assert np.exp(np.mean(np.log(middle))) == pytest.approx(width * 10**-decay, rel=0.35)
    assert np.mean([one.decay for one in found]) == pytest.approx(decay, abs=0.2)
    assert np.mean(noise) == pytest.approx(4.0, rel=0.25)  # begun far above, where all of the curve looks like noise
    assert all(0.4 < one.widths[0] < 1.1 for one in found)  # no readings: about what was expected


def _bumpy(q: Array, rng: np.random.Generator) -> Array:
    """Errors (n, 6) rad over the joints' angles: bumps as wide as 5 to 40°, which are no sum of a few waves."""
    off = np.zeros_like(q)
    for joint in range(5):
        for _ in range(6):
            wide = np.radians(rng.uniform(5, 40))
            size = np.radians(rng.normal(0, 0.012))
            off[:, joint] += size * np.exp(-(((q[:, joint] - rng.uniform(-2, 2)) / wide) ** 2))
    return off


def _poses(seed: int) -> tuple[Array, Array, Cell]:
    rng = np.random.default_rng(seed)
    place = replace(cell("ur10e", healthy(rng), rng), noise_mm=0.03)
    q = postures("ur10e", 500, rng)
    return q, place.seen(q + _bumpy(q, rng), rng).xyz_mm, place


def test_a_bumpy_arm_is_known_better_than_by_constants_and_has_no_gear() -> None:
    rig = load("ur10e")[0].model_copy(update={"effects": ()})
    q, xyz_mm, place = _poses(5)
    left = np.arange(len(q)) % 5 == 0
    runs = [
        measured(PoseTable(q[part], xyz_mm[part], None), "pose", name, rig)
        for part, name in ((~left, "used"), (left, "left"))
    ]
    found = found_in(runs[:1], rig, held_out=runs[1:])
    peer = least_squares_fit(place.arm, Seen(q[~left], xyz_mm[~left]), "joint_offset,link_geometry")
    constants_um = 1e3 * peer.held_out_mm(place.arm, Seen(q[left], xyz_mm[left]), again=False)
    assert found.held_out and found.held_out.calibrated_um < 0.7 * constants_um
    assert not [one for one in found.effects if one.is_confirmed and isinstance(one.effect, TransmissionError)]
    assert found.calibrated and 1 <= found.calibrated.widened < 3
