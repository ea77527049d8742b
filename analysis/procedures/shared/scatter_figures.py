"""Figures of scatter defined by standards (ISO 9283:1998 clause 7, ISO 230-2:2014 clause 3), and their uncertainty in
repeated tests.

Cube poses: ISO 9283:1998, 7.2.1 AP and 7.2.2 RP of each of P1 … P5; 7.3.2 distance accuracy AD = mean D - D_c and 7.3.3
distance repeatability RD = 3 S of the distances D of each cycle from P2 to P4, S with n - 1, D_c the command. AD and RD
are independent of the instrument's position. u of AP and RP as for all poses (`analysis.procedures.pose`); u
of AD is S / √n by Student's distribution, and u of RD that of a standard deviation. The instrument's errors are
included in neither.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from analysis.procedures.shared.quantity import Quantity, student_factor
from analysis.robot.geometry.iso_cube import Cube
from analysis.robot.kinematics.arm import Array, Integers
from analysis.robot.kinematics.joint_limits import wrapped
from analysis.runs.noise.target_scatter import Scatter

_SEED = 1
"""Different from the sampler's, and fixed, so that a run always gives the same report."""
_SHARE = 0.95
_TESTS = 4
"""Number of simulated tests for every second draw of the scatter: about five hundred in total."""
Plain = Callable[[Array], dict[str, Array]]
"""Figures (...,) by name, ending in the unit, of readings (..., t, k, n) mm, NaN if missing."""


def half_width(off: Array) -> float:
    """Half the limit that contains 95 % of the absolute errors (m,): 2 u contains 95 % of any distribution."""
    return float(np.quantile(np.abs(off), _SHARE)) / 2


def of_scatter(plain: Plain, readings: Array, scatter: Scatter, drift_mm: Array | float = 0.0) -> dict[str, Quantity]:
    """Figures of readings (t, k, n) mm, NaN if missing.

    value: by the standard. u: of its distance from the expectation, in repeated tests with the same scatter about each
    cell's mean. Each draw of the scatter gives several such tests, whose scatter is too small by a known factor. The
    expectation is that of a gauge without quantisation, and the cell means are uniform within a step. drift_mm: drift
    of the readings, not counted as scatter and present in each test.
    """
    rng = np.random.default_rng(_SEED)
    measured = np.isfinite(readings)
    still = np.where(measured, readings - drift_mm, 0.0)
    mean = still.sum(axis=-1, keepdims=True) / np.maximum(measured.sum(axis=-1, keepdims=True), 1)
    middle = np.where(measured, mean + drift_mm, np.nan)
    few = replace(scatter, sd_mm=scatter.sd_mm[::2], tail=scatter.tail[::2]).beneath(rng)
    if scatter.step_mm:
        middle = middle + scatter.step_mm * rng.uniform(-0.5, 0.5, (len(few.tail), *mean.shape))
    tests = [middle + few.again(rng, readings.shape[1:]) for _ in range(_TESTS)]
    figures_without = [plain(test) for test in tests]
    step_mm, figures_with = scatter.step_mm, figures_without
    if step_mm:
        figures_with = [plain(np.round(test / step_mm) * step_mm) for test in tests]
    samples = int(np.isfinite(readings).sum())
    figures = {}
    for name, value in plain(readings).items():
        expected = np.mean([test[name] for test in figures_without], axis=0)
        u = half_width(np.array([test[name] for test in figures_with]) - expected) * np.sqrt(_TESTS / (_TESTS - 1))
        figures[name] = Quantity(float(value), u, name.rsplit("_", 1)[1], samples, scatter.noise)
    return figures


def exact(plain: Plain, readings: Array) -> dict[str, Quantity]:
    samples = int(np.isfinite(readings).sum())
    values = plain(readings)
    return {name: Quantity(float(value), 0.0, name.rsplit("_", 1)[1], samples) for name, value in values.items()}


def assumed(scatter: Scatter | None) -> tuple[str, ...]:
    if scatter is None or scatter.noise != "assumed":
        return ()
    return ("too few targets were repeated to show the scatter, which is assumed; measure each target twice or more",)


def coarse(scatter: Scatter | None) -> tuple[str, ...]:
    if scatter is None or scatter.step_mm <= float(np.median(scatter.sd_mm)):
        return ()
    step = f"readings step by {1e3 * scatter.step_mm:.3g} µm, more than they scatter"
    return (f"{step}: smaller scatter cannot be detected; use a finer gauge",)


RP_VISITS = 30
"""Cycles required by ISO 9283."""
FEWEST_CYCLES = 3
"""Minimum cycles for a standard deviation."""
RANGE_VISITS = 5
"""Approaches per side required by ISO 230-2."""


def rp(x: Array) -> Array:
    """ISO 9283, 7.2.2, position repeatability (...,) mm of attained points x (..., n, d) mm, NaN if missing.

    Mean + 3 S of the distances from their barycentre, S with n - 1.
    """
    away = np.linalg.norm(x - np.nanmean(x, axis=-2, keepdims=True), axis=-1)
    return np.asarray(np.nanmean(away, axis=-1) + 3.0 * np.nanstd(away, axis=-1, ddof=1))


def reversal(x: Array) -> dict[str, Array]:
    """ISO 230-2 figures (...,) of readings x (..., targets, 2, n) mm, sides ↓ (from outside) and ↑ (from
    inside).

    NaN if missing. R↓, R↑, R, largest |B|, mean B = mean of x̄↑ - x̄↓.
    """
    mean, s = np.nanmean(x, axis=-1), np.nanstd(x, axis=-1, ddof=1)
    B = mean[..., 1] - mean[..., 0]
    both = 2 * s.sum(axis=-1) + np.abs(B)
    return {
        "r_out_mm": 4 * s[..., 0].max(axis=-1),
        "r_in_mm": 4 * s[..., 1].max(axis=-1),
        "r_mm": np.maximum(both, 4 * s.max(axis=-1)).max(axis=-1),
        "reversal_mm": np.abs(B).max(axis=-1),
        "reversal_mean_mm": B.mean(axis=-1),
    }


_SAME_RAD = float(np.radians(0.5))
"""Joint tolerance for identifying a cube pose, modulo a turn: reported angles differ from the command."""


def poses_of_cube(q: Array, cube: Cube | None) -> Integers:
    """Pose number 1 … 5 of each row of joints, 0 for other poses."""
    if cube is None or q.shape[1] != cube.q.shape[1]:
        return np.zeros(len(q), dtype=np.int64)
    away = np.abs(wrapped(q[:, None] - cube.q)).max(axis=2)
    return np.where(away.min(axis=1) < _SAME_RAD, 1 + away.argmin(axis=1), 0)


def by_pose(pose: Integers, plain: Callable[[Array], dict[str, Array]]) -> Callable[[Array], dict[str, Array]]:
    def figures(x: Array) -> dict[str, Array]:
        by_name = plain(x)
        for group in np.flatnonzero(pose):
            of_group = plain(x[..., [group], :, :])
            for name in ("ap_mm", "rp_mm"):
                if name in of_group:
                    by_name[name.replace("_mm", f"_p{pose[group]}_mm")] = of_group[name]
        return by_name

    return figures


def distance_figures(pose: Integers, xyz_mm: Array, cube: Cube | None) -> dict[str, Quantity]:
    """AD and RD from positions xyz_mm (n, 3) in order of time, pose (n,) of the cube; empty below three
    cycles."""
    second, fourth = np.flatnonzero(pose == 2), np.flatnonzero(pose == 4)
    if cube is None or not len(second) or len(fourth) < FEWEST_CYCLES:
        return {}
    # Distance of each P4 from the closest P2 in time, in its own cycle.
    nearest = second[np.abs(fourth[:, None] - second).argmin(axis=1)]
    distances, n = np.linalg.norm(xyz_mm[fourth] - xyz_mm[nearest], axis=1), len(fourth)
    s = float(distances.std(ddof=1))
    u = student_factor(n - 1) * s / float(np.sqrt(n))
    return {
        "ad_mm": Quantity(float(distances.mean()) - cube.distance_mm, u, "mm", n),
        "rd_mm": Quantity(3 * s, 3 * s / float(np.sqrt(2 * (n - 1))), "mm", n),
    }
